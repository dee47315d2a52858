//! The sample's reflectance as the kernels of interreflection see it.

use crate::numerics::batch::LANES;
use crate::reflectance::{LUMINANCE, Reflectance, specular};
use crate::vector::Vec3;
use dataset::specification::Tint;
use std::f64::consts::FRAC_1_PI;

/// A material in a frame (u, v, z) of the sample's plane.
#[derive(Clone, Copy, Debug)]
pub struct Surface {
    /// The lobe's exponents.
    pub n_u: f64,
    /// The one along the other axis.
    pub n_v: f64,
    /// Index of refraction.
    pub ior: f64,
    /// The Lambertian reflectance over pi.
    pub lambert: [f64; 3],
    /// The lobe's u axis in the frame.
    axis: [f64; 2],
    /// Before the lobe's power.
    scale: f64,
    hue: bool,
    rgb0: [f64; 3],
    rgb90: [f64; 3],
}

/// The tint toward a viewer but for Fresnel's reflectance.
#[derive(Clone, Copy, Debug, Default)]
pub struct Toward {
    rgb: [f64; 3],
    /// The same with 1 for the largest.
    hue: [f64; 3],
    /// One over the luminance of the hue; 1 for black.
    per_luminance: f64,
    largest: f64,
}

/// The same toward a viewer a lane: 0 to 2 the colour, 3 to 5 the hue, then the others.
#[derive(Clone, Copy, Debug)]
pub struct Towards([[f64; LANES]; 8]);

impl Towards {
    /// Toward viewers at these cosines.
    #[inline(always)]
    pub fn new(surface: &Surface, cos_o: &[f64; LANES]) -> Self {
        let mut all = [[0.0; LANES]; 8];
        for i in 0..LANES {
            let Toward {
                rgb: [r, g, b],
                hue: [hr, hg, hb],
                per_luminance,
                largest,
            } = surface.toward(cos_o[i]);
            for (lanes, number) in all
                .iter_mut()
                .zip([r, g, b, hr, hg, hb, per_luminance, largest])
            {
                lanes[i] = number;
            }
        }
        Self(all)
    }

    /// The one of a lane.
    #[inline(always)]
    pub fn at(&self, i: usize) -> Toward {
        let Self([r, g, b, hr, hg, hb, per_luminance, largest]) = self;
        Toward {
            rgb: [r[i], g[i], b[i]],
            hue: [hr[i], hg[i], hb[i]],
            per_luminance: per_luminance[i],
            largest: largest[i],
        }
    }
}

impl Surface {
    /// The material in a frame whose u axis is `u_axis`.
    pub fn new(reflectance: &Reflectance, [cos, sin]: [f64; 2]) -> Self {
        let lobe = &reflectance.lobe;
        let axis = lobe.to_surface(Vec3::new(1.0, 0.0, 0.0));
        let share = reflectance.specular_share;
        let (kind, rgb90) = reflectance.tint_model();
        Self {
            n_u: lobe.n_u,
            n_v: lobe.n_v,
            ior: reflectance.ior,
            lambert: reflectance
                .rgb0
                .map(|channel| (1.0 - share) * FRAC_1_PI * channel),
            axis: [axis.x * cos + axis.y * sin, axis.y * cos - axis.x * sin],
            scale: share * 0.25 * FRAC_1_PI * lobe.normalization,
            hue: kind == Tint::Hue,
            rgb0: reflectance.rgb0,
            rgb90,
        }
    }

    /// The specular part of f cos_i but for its tint. A light below the horizon gives 0.
    #[inline(always)]
    pub fn specular(&self, wi: &Vec3, wo: &Vec3) -> f64 {
        let (x, y, z) = (wi.x + wo.x, wi.y + wo.y, wi.z + wo.z);
        let [cos, sin] = self.axis;
        let (u, v) = (cos * x + sin * y, cos * y - sin * x);
        let half2 = [u * u, v * v, z * z + f64::MIN_POSITIVE];
        let cos_i = if wi.z > 0.0 { wi.z } else { 0.0 };
        let larger = if cos_i > wo.z { cos_i } else { wo.z };
        let larger = if larger > 0.0 { larger } else { 1.0 };
        specular::at_half_vector(self.scale, [self.n_u, self.n_v], half2, cos_i, larger)
    }

    /// Minus the logarithm of the lobe's power for a half vector in a frame along its axes.
    #[inline(always)]
    pub fn depth(&self, u: f64, v: f64, z: f64) -> f64 {
        let (u2, v2, z2) = (u * u, v * v, z * z + f64::MIN_POSITIVE);
        let tangential = u2 + v2 + f64::MIN_POSITIVE;
        specular::depth([self.n_u, self.n_v], [u2, v2], tangential / z2)
    }

    /// What the tint toward a viewer at `cos_o` is made of before Fresnel's reflectance is known.
    #[inline(always)]
    pub fn toward(&self, cos_o: f64) -> Toward {
        let sin_o = 1.0 - cos_o;
        let r = self.rgb90[0] * sin_o + self.rgb0[0] * cos_o;
        let g = self.rgb90[1] * sin_o + self.rgb0[1] * cos_o;
        let b = self.rgb90[2] * sin_o + self.rgb0[2] * cos_o;
        let largest = if r > g { r } else { g };
        let largest = if largest > b { largest } else { b };
        let dark = largest <= 0.0;
        let scale = 1.0 / if dark { 1.0 } else { largest };
        let (hr, hg, hb) = (r * scale, g * scale, b * scale);
        let luminance = LUMINANCE[0] * hr + LUMINANCE[1] * hg + LUMINANCE[2] * hb;
        Toward {
            rgb: [r, g, b],
            hue: [hr, hg, hb],
            per_luminance: 1.0 / if dark { 1.0 } else { luminance },
            largest,
        }
    }

    /// The tint toward a viewer: [`crate::reflectance::tint`] without branches.
    #[inline(always)]
    pub fn tint(&self, fresnel: f64, toward: &Toward) -> [f64; 3] {
        let Toward {
            rgb: [r, g, b],
            hue: [hr, hg, hb],
            per_luminance,
            largest,
        } = *toward;
        let dark = largest <= 0.0;
        let brightest = fresnel * per_luminance;
        let over = brightest > 1.0;
        let saturation = (1.0 - fresnel) / if over { brightest - fresnel } else { 1.0 };
        let hue = |full: f64| {
            let value = if over {
                fresnel + saturation * (full - fresnel)
            } else {
                full
            };
            if dark { fresnel } else { value }
        };
        let (hr, hg, hb) = (
            hue(hr * brightest),
            hue(hg * brightest),
            hue(hb * brightest),
        );
        [
            if self.hue { hr } else { fresnel * r },
            if self.hue { hg } else { fresnel * g },
            if self.hue { hb } else { fresnel * b },
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use dataset::Material;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_surface_is_the_model(
            roughness in 20.0..100.0f64, anisotropy in 0.0..1.0f64, angle_deg in 0.0..180.0f64,
            rotation in 0.0..6.0f64, ior in 1.0..10.0f64,
            rgb0 in prop::array::uniform3(0.0..1.0f64), rgb90 in prop::array::uniform3(0.0..1.0f64),
            i in prop::array::uniform2(-2.0..2.0f64), o in prop::array::uniform2(-2.0..2.0f64),
        ) {
            let material = Material { roughness, anisotropy, angle_deg, ior, rgb0, rgb90 };
            let [wi, wo] = [i, o].map(|[x, y]| Vec3::new(x, y, 1.0).normalized());
            let (sin, cos) = libm::sincos(rotation);
            let rotated = |w: Vec3| Vec3::new(w.x * cos + w.y * sin, w.y * cos - w.x * sin, w.z);
            for kind in [Tint::Hue, Tint::Product] {
                let reflectance = Reflectance::new(&material, 0.0, kind);
                let surface = Surface::new(&reflectance, [cos, sin]);
                let expected = reflectance.evaluate(wi, wo);
                let fresnel = crate::reflectance::fresnel::reflectance(wi.z, ior);
                let tint = surface.tint(fresnel, &surface.toward(wo.z));
                for channel in 0..3 {
                    let found = surface.specular(&rotated(wi), &rotated(wo)) * tint[channel]
                        + surface.lambert[channel] * wi.z;
                    let off = (found - expected[channel] * wi.z).abs();
                    prop_assert!(off < 1e-11 * (1.0 + found), "{} {}", found, expected[channel]);
                }
            }
        }
    }
}
