"""brdfarm's reflectance model as a BSDF of Mitsuba: renderer/src/reflectance, in 32 bits.

The model's table of errata holds here too. Mitsuba traces from the camera, so its `wi` points to
the viewer and its `wo` to the light: the opposite of brdfarm's names. Here they are `viewer` and
`light`. The model is not reciprocal: Fresnel's term sees the light, the colour the viewer.

Set a variant of Mitsuba before this module is imported: a BSDF derives from a class of the variant.
"""

import math

import drjit as dr
import mitsuba as mi

LUMINANCE = (0.2126, 0.7152, 0.0722)
UNIFORM_MIN = 2.0**-33  # Below any 32-bit sample but 0, whose logarithm is not finite.


def log1p(x):
    """log(1 + x) to the last digits of a small x >= 0 (Kahan's quotient)."""
    one_plus = 1 + x
    rest = one_plus - 1
    return dr.select(rest == 0, x, x * dr.log(one_plus) / dr.select(rest == 0, 1, rest))


def minus_expm1(x):
    """1 - exp(x) to the last digits of an x <= 0 near 0."""
    power = dr.exp(x)
    log_power = dr.log(power)
    near = power > 0.5
    quotient = (1 - power) * x / dr.select(near & (log_power != 0), log_power, 1)
    return dr.select(near, dr.select(power == 1, -x, quotient), 1 - power)


class Reflectance(mi.BSDF):
    """Properties: roughness, anisotropy, angle_deg (with the view's turn), ior, rgb0, rgb90.

    Only the tint `hue` is here. The numbers are opaque to the compiler, so that one kernel serves
    all materials; whether there is a Lambertian part is not.
    """

    def __init__(self, properties):
        mi.BSDF.__init__(self, properties)
        roughness = properties["roughness"]
        base = 0.001 + 0.00999 * roughness
        n_u = base**-3
        n_v = (base + properties["anisotropy"] ** 3) ** -3
        share = (100 - roughness) / 10 if roughness > 90 else 1.0
        angle = math.radians(properties["angle_deg"])

        opaque = lambda value: dr.opaque(mi.Float, value)
        self.n_u, self.n_v = opaque(n_u), opaque(n_v)
        self.root_u, self.root_v = opaque(math.sqrt(n_u + 1)), opaque(math.sqrt(n_v + 1))
        self.normalization = opaque(math.sqrt((n_u + 1) * (n_v + 1)))
        self.sin_psi, self.cos_psi = opaque(math.sin(angle)), opaque(math.cos(angle))
        self.ior = opaque(properties["ior"])
        self.rgb0, self.rgb90 = (
            mi.Color3f(*(opaque(properties[name][channel]) for channel in range(3)))
            for name in ("rgb0", "rgb90")
        )
        self.mixed = share < 1
        self.share = opaque(share)

        flags = mi.BSDFFlags.GlossyReflection | mi.BSDFFlags.FrontSide
        if self.mixed:
            flags |= mi.BSDFFlags.DiffuseReflection
        self.m_components = [flags]
        self.m_flags = flags

    def power(self, half):
        """(n.h)^e of a half vector of any length, from its tangential part."""
        u = self.cos_psi * half.x + self.sin_psi * half.y
        v = self.cos_psi * half.y - self.sin_psi * half.x
        u2, v2 = u * u, v * v
        tangential = u2 + v2
        exponent = (self.n_u * u2 + self.n_v * v2) / dr.select(tangential > 0, tangential, 1)
        return dr.exp(-0.5 * exponent * log1p(tangential / (half.z * half.z)))

    def tint(self, cos_light, cos_viewer):
        perpendicular = (self.ior - cos_light) / (self.ior + cos_light)
        parallel = (self.ior * cos_light - 1) / (self.ior * cos_light + 1)
        fresnel = 0.5 * (parallel * parallel + perpendicular * perpendicular)

        colour = dr.lerp(self.rgb90, self.rgb0, cos_viewer)
        largest = dr.max(colour)
        black = largest <= 0
        chromaticity = colour / dr.select(black, 1, largest)
        luminance = sum(weight * chromaticity[i] for i, weight in enumerate(LUMINANCE))
        brightest = fresnel / dr.select(black, 1, luminance)
        saturation = (1 - fresnel) / dr.select(brightest > 1, brightest - fresnel, 1)
        desaturated = fresnel + saturation * (chromaticity * brightest - fresnel)
        hue = dr.select(brightest <= 1, chromaticity * brightest, desaturated)
        return dr.select(black, mi.Color3f(fresnel), hue)

    def value_and_density(self, viewer, light):
        """f cos_light and the density of `sample`, for directions above the surface."""
        half = viewer + light
        length = dr.norm(half)
        lobe = self.normalization * self.power(half)
        foreshortening = light.z / dr.maximum(light.z, viewer.z)
        specular = lobe / (4 * dr.pi * length) * foreshortening
        value = self.tint(light.z, viewer.z) * specular
        density = lobe / (4 * dr.pi * length)
        if self.mixed:
            diffuse = (1 - self.share) * dr.inv_pi * light.z
            value = self.share * value + diffuse * self.rgb0
            density = self.share * density + diffuse
        return value, density

    def sample_half(self, point):
        sin_turn, cos_turn = dr.sincos(dr.two_pi * point.x)
        u, v = self.root_v * cos_turn, self.root_u * sin_turn
        scale = dr.rsqrt(u * u + v * v)
        cos_phi, sin_phi = u * scale, v * scale
        exponent = self.n_u * cos_phi * cos_phi + self.n_v * sin_phi * sin_phi
        log_cos = dr.log(dr.maximum(point.y, UNIFORM_MIN)) / (exponent + 1)
        sin_theta = dr.sqrt(minus_expm1(2 * log_cos))
        h_u, h_v = sin_theta * cos_phi, sin_theta * sin_phi
        return mi.Vector3f(
            self.cos_psi * h_u - self.sin_psi * h_v,
            self.sin_psi * h_u + self.cos_psi * h_v,
            dr.exp(log_cos),
        )

    def sample(self, context, si, sample1, sample2, active=True):
        viewer = si.wi
        half = self.sample_half(sample2)
        light = 2 * dr.dot(half, viewer) * half - viewer
        if self.mixed:
            light = dr.select(
                sample1 < self.share, light, mi.warp.square_to_cosine_hemisphere(sample2)
            )
        above = active & (viewer.z > 0) & (light.z > 0)
        value, density = self.value_and_density(viewer, light)
        if self.mixed:
            weight = value / density
        else:
            # In closed form: the quotient of two numbers of up to 1e9 has lost digits.
            foreshortening = light.z / dr.maximum(light.z, viewer.z)
            weight = self.tint(light.z, viewer.z) * foreshortening

        drawn = mi.BSDFSample3f()
        drawn.wo = light
        drawn.pdf = dr.select(above, density, 0)
        drawn.eta = 1.0
        drawn.sampled_type = mi.UInt32(+self.m_flags)
        drawn.sampled_component = mi.UInt32(0)
        return drawn, dr.select(above, weight, 0)

    def eval_pdf(self, context, si, wo, active=True):
        above = active & (si.wi.z > 0) & (wo.z > 0)
        value, density = self.value_and_density(si.wi, wo)
        return dr.select(above, value, 0), dr.select(above, density, 0)

    def eval(self, context, si, wo, active=True):
        return self.eval_pdf(context, si, wo, active)[0]

    def pdf(self, context, si, wo, active=True):
        return self.eval_pdf(context, si, wo, active)[1]

    def traverse(self, callback):
        pass

    def to_string(self):
        return "Reflectance[]"


mi.register_bsdf("brdfarm", Reflectance)
