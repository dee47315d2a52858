//! What the bulb sends to a point of the chart off one line of the sample, where the lobe is narrower
//! along the line than the bulb looks.
//!
//! The line mirrors each part of the bulb at a place of its own. Where the line ends amid these places,
//! a cubature of points over the bulb sees a step for each of them. So here the outline of what the
//! line mirrors is exact, and what is left to the rules is smooth.
//!
//! Everything is in the frame (u, v, z) of [`super::transfer`], and lines run along u. The bulb is cut
//! into arcs about the line: a direction wi has a sine w = wi_u to the line's normal plane and an
//! azimuth beta about the line, and dwi = dw dbeta. With receiver and bulb turned about the line into
//! one plane, the receiver to the other side, what the line mirrors are straight rays. One that passes
//! the bulb's centre at y of its radius R meets the line at u(y), and there h_u vanishes on a whole
//! arc. The lobe falls within a width kappa of u(y), so
//!
//! ```text
//! integral du dw = integral dx integral dy kappa dw/dy    at u = u(y) + kappa x,
//! ```
//!
//! where x runs over the lobe's widths, and y over the bulb, for each x as far as u lies on the line: a
//! closed form gives both ends. Seen from a point of the sample, with the bulb's centre at the latitude
//! l and its angular radius a, the arc of y lies at a latitude l' with sin(l' - l) = y sin(a), and ends
//! at
//!
//! ```text
//! 1 - cos(beta) = sin(a)^2 (1 - y^2) / ((cos(l' - l) + cos(a)) cos(l') cos(l)).
//! ```
//!
//! The arc's length has a root at either end. With y = s sqrt(2 - s^2) it is smooth in s, because
//! sqrt(1 - y^2) = 1 - s^2.

#![allow(
    clippy::needless_range_loop,
    reason = "loops over lanes of several arrays: the compiler turns no other form into vectors"
)]

use super::bulb::Bulb;
use super::surface::Surface;
use super::transfer::Receiver;
use crate::numerics::batch::{Batch, LANES};
use crate::numerics::elementary::log1p;
use crate::numerics::gauss::GaussRule;
use crate::numerics::instructions::kernel;
use crate::numerics::tolerance::Midpoints;
use crate::reflectance::fresnel;
use crate::vector::Vec3;
use std::f64::consts::FRAC_1_PI;

/// A line of the sample: v, its weight, the least and largest u.
pub type PlainLineBatch = Batch<4>;

/// The rules for every line.
#[derive(Clone, Copy)]
pub struct ArcRules {
    /// Over x.
    pub across: Midpoints,
    /// Over s.
    pub arcs: &'static GaussRule,
    /// Along an arc.
    pub along: &'static GaussRule,
}

impl ArcRules {
    /// Evaluations that a line takes.
    pub fn size(&self) -> usize {
        self.across.count * self.arcs.size() * self.along.size()
    }
}

/// A number for each lane.
type Lanes = [f64; LANES];

/// Zeros.
const ZERO: Lanes = [0.0; LANES];

/// What does not change from line to line.
#[derive(Clone, Copy)]
struct Transport<'a> {
    receiver: &'a Receiver,
    surface: &'a Surface,
    bulb: &'a Bulb,
}

/// The lines of a block.
struct Lines<'a> {
    v: &'a Lanes,
    weight: &'a Lanes,
    ends: [&'a Lanes; 2],
    /// How far the receiver is from the line, and the bulb's centre.
    from_receiver: Lanes,
    from_bulb: Lanes,
    /// The lobe's width along the line, where it is widest on what the line mirrors: kappa.
    width: Lanes,
}

impl<'a> Lines<'a> {
    #[inline(always)]
    fn new(block: [&'a Lanes; 4], transport: Transport<'_>) -> Self {
        let [v, weight, low, high] = block;
        let (c, b) = (transport.receiver.position, transport.bulb.centre);
        let mut lines = Self {
            v,
            weight,
            ends: [low, high],
            from_receiver: ZERO,
            from_bulb: ZERO,
            width: ZERO,
        };
        for i in 0..LANES {
            let (to_receiver, to_bulb) = (c.y - v[i], b.y - v[i]);
            lines.from_receiver[i] = (to_receiver * to_receiver + c.z * c.z).sqrt();
            lines.from_bulb[i] = (to_bulb * to_bulb + b.z * b.z).sqrt();
        }
        for y in [-1.0, 0.0, 1.0] {
            for i in 0..LANES {
                let width = lines.width_at(i, y, transport);
                lines.width[i] = if width > lines.width[i] {
                    width
                } else {
                    lines.width[i]
                };
            }
        }
        lines
    }

    /// Where the line mirrors rays that pass the bulb's centre at `y` of its radius.
    #[inline(always)]
    fn mirror(&self, i: usize, y: f64, transport: Transport<'_>) -> f64 {
        let from = transport.receiver.position.x;
        let along = transport.bulb.centre.x - from;
        let across = self.from_receiver[i] + self.from_bulb[i];
        let off = transport.bulb.radius * y;
        let free = (along * along + across * across - off * off).sqrt();
        // The tangent of the angle to the centre and the one between.
        let tangent = (along * free + off * across) / (across * free - off * along);
        from + self.from_receiver[i] * tangent
    }

    /// At which part of its radius rays pass the bulb's centre that the line mirrors at u.
    #[inline(always)]
    fn passes(&self, i: usize, u: f64, transport: Transport<'_>) -> f64 {
        let from = transport.receiver.position.x;
        let along = transport.bulb.centre.x - from;
        let near = self.from_receiver[i];
        let across = near + self.from_bulb[i];
        let x = u - from;
        (x * across - along * near) / ((x * x + near * near).sqrt() * transport.bulb.radius)
    }

    /// The lobe's width along the line where it mirrors those rays.
    #[inline(always)]
    fn width_at(&self, i: usize, y: f64, transport: Transport<'_>) -> f64 {
        let (c, b) = (transport.receiver.position, transport.bulb.centre);
        let u = self.mirror(i, y, transport);
        let (near, far) = (self.from_receiver[i], self.from_bulb[i]);
        let (to_receiver, to_bulb) = (c.x - u, b.x - u);
        let per_receiver = 1.0 / (to_receiver * to_receiver + near * near).sqrt();
        let per_bulb = 1.0 / (to_bulb * to_bulb + far * far).sqrt();
        let h_v = (c.y - self.v[i]) * per_receiver + (b.y - self.v[i]) * per_bulb;
        let h_z = c.z * per_receiver + b.z * per_bulb;
        // Far out along its other axis a lobe is wider along this one.
        let t = h_v * h_v / (h_z * h_z) + 1e-12;
        let width = h_z * (t / (transport.surface.n_u * log1p(t))).sqrt();
        let (cos_receiver, cos_bulb) = (near * per_receiver, far * per_bulb);
        let turns = cos_receiver * cos_receiver * per_receiver + cos_bulb * cos_bulb * per_bulb;
        width / turns
    }
}

/// s of a y, which counts between -1 and 1.
#[inline(always)]
fn s_of(y: f64) -> f64 {
    let y = if y > -1.0 { y } else { -1.0 };
    let y = if y < 1.0 { y } else { 1.0 };
    y / (1.0 + (1.0 - y * y).sqrt()).sqrt()
}

/// An arc for each line.
struct Arcs {
    /// From the sample to the receiver.
    wo: [Lanes; 3],
    /// wi_u, and the length of what is left of wi.
    w: Lanes,
    radial: Lanes,
    /// The direction of the bulb's centre in the line's normal plane.
    meridian: [Lanes; 2],
    /// The sine of the azimuth at which the arc ends, counted from there.
    end: Lanes,
    /// What a unit of the model times a unit of the sine brings to the receiver.
    scale: Lanes,
}

impl Arcs {
    /// The arcs at a node over s, between ends, and at one over x.
    #[inline(always)]
    fn new(
        lines: &Lines<'_>,
        transport: Transport<'_>,
        (x, weight_x): (f64, f64),
        [low, high]: [&Lanes; 2],
        (node, weight_s): (f64, f64),
    ) -> Self {
        let mut arcs = Self {
            wo: [ZERO; 3],
            w: ZERO,
            radial: ZERO,
            meridian: [ZERO; 2],
            end: ZERO,
            scale: ZERO,
        };
        let [mut u, mut y, mut chord] = [ZERO; 3];
        for i in 0..LANES {
            let length = high[i] - low[i];
            let s = low[i] + node * length;
            let root = (2.0 - s * s).sqrt();
            y[i] = s * root;
            chord[i] = 1.0 - s * s;
            u[i] = lines.mirror(i, y[i], transport) + x * lines.width[i];
            let area = lines.weight[i] * weight_x * lines.width[i];
            arcs.scale[i] = area * weight_s * length * (2.0 * chord[i] / root);
        }
        arcs.send(lines, transport, &u);
        arcs.see(lines, transport.bulb, &u, &y, &chord);
        arcs
    }

    /// The directions to the receiver, and what arrives there.
    #[inline(always)]
    fn send(&mut self, lines: &Lines<'_>, transport: Transport<'_>, u: &Lanes) {
        let Receiver {
            position: c,
            normal: n,
        } = *transport.receiver;
        for i in 0..LANES {
            let (x, y) = (c.x - u[i], c.y - lines.v[i]);
            let inverse = 1.0 / (x * x + y * y + c.z * c.z).sqrt();
            let (x, y, z) = (x * inverse, y * inverse, c.z * inverse);
            let facing = -(n.x * x + n.y * y + n.z * z);
            let facing = if facing > 0.0 { facing } else { 0.0 };
            self.wo[0][i] = x;
            self.wo[1][i] = y;
            self.wo[2][i] = z;
            self.scale[i] *= FRAC_1_PI * z * facing * inverse * inverse;
        }
    }

    /// The arcs as the sample sees them.
    #[inline(always)]
    fn see(&mut self, lines: &Lines<'_>, bulb: &Bulb, u: &Lanes, y: &Lanes, chord: &Lanes) {
        let b = bulb.centre;
        for i in 0..LANES {
            let (to_u, to_v) = (b.x - u[i], b.y - lines.v[i]);
            let inverse = 1.0 / (to_u * to_u + to_v * to_v + b.z * b.z).sqrt();
            let sin = bulb.radius * inverse;
            let cos = (1.0 - sin * sin).sqrt();
            let sin_off = sin * y[i];
            let cos_off = (1.0 - sin_off * sin_off).sqrt();
            let centre = to_u * inverse;
            let centre_radial = (1.0 - centre * centre).sqrt();
            let radial = centre_radial * cos_off - centre * sin_off;
            let reach2 = sin * chord[i] * (sin * chord[i]);
            let one_less_cos = reach2 / ((cos_off + cos) * radial * centre_radial);
            let end = (one_less_cos * (2.0 - one_less_cos)).sqrt();
            self.w[i] = centre * cos_off + centre_radial * sin_off;
            self.radial[i] = radial;
            self.end[i] = end;
            self.meridian[0][i] = to_v * (inverse / centre_radial);
            self.meridian[1][i] = b.z * (inverse / centre_radial);
            // dw/dy and the sine's range.
            self.scale[i] *= bulb.radiance * (radial * sin / cos_off) * end;
        }
    }

    /// Adds what a node along the arcs, at a part of their half length, sends to the receiver.
    #[inline(always)]
    fn add(&self, (part, weight): (f64, f64), surface: &Surface, sums: &mut [Lanes; 3]) {
        let [mut wi_v, mut wi_z, mut light] = [ZERO; 3];
        for i in 0..LANES {
            let sin = part * self.end[i];
            let cos = (1.0 - sin * sin).sqrt();
            let [v, z] = [self.meridian[0][i], self.meridian[1][i]];
            wi_v[i] = self.radial[i] * (cos * v - sin * z);
            wi_z[i] = self.radial[i] * (cos * z + sin * v);
            light[i] = self.scale[i] * weight / cos;
        }
        for i in 0..LANES {
            let wi = Vec3 {
                x: self.w[i],
                y: wi_v[i],
                z: wi_z[i],
            };
            let wo = Vec3 {
                x: self.wo[0][i],
                y: self.wo[1][i],
                z: self.wo[2][i],
            };
            light[i] *= surface.specular(&wi, &wo);
        }
        let mut tints = [ZERO; 3];
        for i in 0..LANES {
            let fresnel = fresnel::reflectance(wi_z[i], surface.ior);
            let [r, g, b] = surface.tint(fresnel, &surface.toward(self.wo[2][i]));
            tints[0][i] = r;
            tints[1][i] = g;
            tints[2][i] = b;
        }
        for channel in 0..3 {
            for i in 0..LANES {
                sums[channel][i] += light[i] * tints[channel][i];
            }
        }
    }
}

/// The body of the kernel for one block.
#[inline(always)]
fn add_block(lines: &Lines<'_>, transport: Transport<'_>, rules: ArcRules, sums: &mut [Lanes; 3]) {
    for (x, weight_x) in rules.across.nodes() {
        let mut ends = [ZERO; 2];
        for side in 0..2 {
            for i in 0..LANES {
                let u = lines.ends[side][i] - x * lines.width[i];
                ends[side][i] = s_of(lines.passes(i, u, transport));
            }
        }
        for node in rules.arcs.on(0.0, 1.0) {
            let ends = ends.each_ref();
            let arcs = Arcs::new(lines, transport, (x, weight_x), ends, node);
            for along in rules.along.on(-1.0, 1.0) {
                arcs.add(along, transport.surface, sums);
            }
        }
    }
}

kernel! {
    /// What the bulb sends to the receiver along each line: irradiance over pi, by channel. The surface is
    /// all specular.
    pub fn from_bulb_by_arcs(
        batch: &PlainLineBatch,
        receiver: &Receiver,
        surface: &Surface,
        rules: ArcRules,
        bulb: &Bulb,
        sums: &mut [[[f64; LANES]; 3]],
    ) {
        let transport = Transport { receiver, surface, bulb };
        for (block, sums) in batch.blocks().zip(sums) {
            let lines = Lines::new(block, transport);
            *sums = [ZERO; 3];
            add_block(&lines, transport, rules, sums);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hybrid::interreflection::bulb_transfer::{BulbRule, Scratch, from_bulb};
    use crate::hybrid::interreflection::sources::disc;
    use crate::hybrid::interreflection::transfer::Along;
    use crate::numerics::instructions::Instructions;
    use crate::numerics::tolerance::Tolerance;
    use crate::reflectance::Reflectance;
    use dataset::Material;
    use dataset::specification::Tint;
    use proptest::prelude::*;

    /// Rings of the cubature over the bulb that arcs are compared with, and parts of the line.
    const RINGS: usize = 32;
    const PARTS: usize = 48;

    fn by_arcs(line: [f64; 4], transport: Transport<'_>, error: f64) -> f64 {
        let tolerance = Tolerance::new(error);
        let rules = ArcRules {
            across: tolerance.midpoints(),
            arcs: GaussRule::of(tolerance.points_of_arcs()),
            along: GaussRule::of(tolerance.points(2.0, 0.0)),
        };
        let mut batch = PlainLineBatch::default();
        batch.push(line);
        let Transport {
            receiver,
            surface,
            bulb,
        } = transport;
        let mut sums = [[[0.0; LANES]; 3]];
        let set = Instructions::widest();
        from_bulb_by_arcs(set, &batch, receiver, surface, rules, bulb, &mut sums);
        sums[0][0][0]
    }

    /// The same by points of the bulb, each with a rule over every part of the line.
    fn by_points([v, weight, low, high]: [f64; 4], transport: Transport<'_>) -> f64 {
        let mut lines = PlainLineBatch::default();
        let end = |part: usize| low + (high - low) * part as f64 / PARTS as f64;
        for part in 0..PARTS {
            lines.push([v, weight, end(part), end(part + 1)]);
        }
        let Transport {
            receiver,
            surface,
            bulb,
        } = transport;
        let along = Along {
            rule: GaussRule::of(8),
            reach: None,
        };
        let set = Instructions::widest();
        let rule = BulbRule {
            disc: &disc(RINGS),
            along,
        };
        let scratch = &mut Scratch::default();
        from_bulb(set, &lines, rule, receiver, surface, bulb, scratch)[0]
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(48))]

        /// Lines that end anywhere amid what mirrors the bulb, and bulbs of all sizes that are cut into arcs.
        #[test]
        fn arcs_send_what_many_points_of_the_bulb_send(
            position in (-0.1..0.1f64, 0.05..0.2f64, 0.01..0.15f64),
            towards in (-0.5..0.5f64, -0.8..0.2f64, 0.2..0.9f64),
            sine in 0.01..0.15f64, lobe_share in 0.1..0.5f64, n_v in 0.5..60.0f64,
            v in -0.05..0.04f64, ends in (-1.5..1.5f64, 0.2..3.0f64), ior in 1.3..8.0f64,
        ) {
            let receiver = Receiver {
                position: Vec3::new(position.0, position.1, position.2),
                normal: Vec3::new(0.0, -0.6, -0.8).normalized(),
            };
            let centre = Vec3::new(towards.0, towards.1, towards.2);
            // All of the bulb is above the sample.
            let radius = (sine * centre.length()).min(0.9 * centre.z);
            let bulb = Bulb { centre, radius, radiance: 1.0 / (radius * radius), x_axis: [1.0, 0.0] };
            let material = Material {
                roughness: 50.0, anisotropy: 0.0, angle_deg: 0.0, ior, rgb0: [0.5; 3], rgb90: [0.5; 3],
            };
            let mut reflectance = Reflectance::new(&material, 0.0, Tint::Product);
            // The lobe's width in the half vector's slope, as a share of the bulb's.
            let per_width = 2.0 * centre.length() / (radius * lobe_share);
            reflectance.lobe.n_u = per_width * per_width;
            reflectance.lobe.n_v = n_v;
            let surface = Surface::new(&reflectance, [1.0, 0.0]);
            let transport = Transport { receiver: &receiver, surface: &surface, bulb: &bulb };
            let lanes = [[v; LANES], [1.0; LANES], ZERO, ZERO];
            let lines = Lines::new(lanes.each_ref(), transport);
            let half = 0.5 * (lines.mirror(0, 1.0, transport) - lines.mirror(0, -1.0, transport));
            let middle = lines.mirror(0, 0.0, transport);
            let low = middle + ends.0 * half;
            let line = [v, 1.0, low, low + ends.1 * half];
            let whole = [v, 1.0, middle - 9.0 * half, middle + 9.0 * half];
            let scale = by_arcs(whole, transport, 1e-4);
            let found = by_arcs(line, transport, 1e-8);
            let expected = by_points(line, transport);
            let off = (found - expected).abs() / scale;
            // Points across a wide lobe step over a line's end beside the outline, and the model bends where
            // both cosines are equal.
            prop_assert!(off < 1e-2, "{found} {expected} of {scale}");
        }
    }
}
