//! What a point source sends to a point of the chart off one line of the sample.
//!
//! Everything is in a frame (u, v, z) of the sample's plane. A line of constant v is integrated
//! over u in a variable t with u = nearest + delta sinh t, where `nearest` is the point of the line
//! nearest to the receiver and `delta` its distance: in t the integrand stays smooth however close
//! the receiver comes to the sample. Where the lobe is narrow along u, the rule covers only the
//! part of the line that the lobe reaches, whose middle is the one root of h_u.

#![allow(
    clippy::needless_range_loop,
    reason = "loops over lanes of several arrays: the compiler turns no other form into vectors"
)]

use super::surface::{Surface, Toward};
use crate::numerics::batch::LANES;
use crate::numerics::elementary::{asinh, exp, log1p};
use crate::numerics::gauss::GaussRule;
use crate::reflectance::fresnel;
use crate::vector::Vec3;
use std::f64::consts::FRAC_1_PI;

/// What arrives at the receiver by block and channel: irradiance over pi.
pub type LineSums = Vec<[[f64; LANES]; 3]>;

/// A point of the chart that receives light.
#[derive(Clone, Copy, Debug)]
pub struct Receiver {
    /// Where.
    pub position: Vec3,
    /// The normal of the chart's front.
    pub normal: Vec3,
}

/// The rule along every line.
#[derive(Clone, Copy)]
pub struct Along {
    /// The rule.
    pub rule: &'static GaussRule,
    /// How many widths of the lobe it covers on either side of h_u = 0; `None` for all of the line.
    pub reach: Option<f64>,
}

/// The light from a source at a point of the sample.
pub struct Light {
    pub wi: Vec3,
    /// Radiance times solid angle.
    pub weight: f64,
    /// The irradiance.
    pub irradiance: f64,
}

/// A family of point sources, told apart by three numbers.
pub trait Sources {
    fn light(&self, source: [f64; 3], u: f64, v: f64) -> Light;

    /// A point that the light at (u, v) comes from.
    fn origin(&self, source: [f64; 3], u: f64, v: f64) -> Vec3;
}

/// The lines of a block as the kernels see them.
pub struct Lines<'a> {
    pub v: &'a [f64; LANES],
    pub sources: [&'a [f64; LANES]; 3],
    pub nearest: [f64; LANES],
    pub delta: [f64; LANES],
    pub low: [f64; LANES],
    pub high: [f64; LANES],
}

impl<'a> Lines<'a> {
    #[inline(always)]
    pub fn new(block: [&'a [f64; LANES]; 7], receiver: &Receiver) -> Self {
        let [v, _, low, high, x, y, z] = block;
        let c = receiver.position;
        let mut lines = Self {
            v,
            sources: [x, y, z],
            nearest: [0.0; LANES],
            delta: [0.0; LANES],
            low: [0.0; LANES],
            high: [0.0; LANES],
        };
        for i in 0..LANES {
            let nearest = if c.x < high[i] { c.x } else { high[i] };
            let nearest = if nearest > low[i] { nearest } else { low[i] };
            let (off_u, off_v) = (c.x - nearest, c.y - v[i]);
            let delta = (off_u * off_u + off_v * off_v + c.z * c.z).sqrt();
            let inverse = 1.0 / delta;
            lines.nearest[i] = nearest;
            lines.delta[i] = delta;
            lines.low[i] = asinh((low[i] - nearest) * inverse);
            lines.high[i] = asinh((high[i] - nearest) * inverse);
        }
        lines
    }

    /// About where on each line h_u vanishes. Light from a point goes to the receiver as off a mirror that holds
    /// the line: with both turned about it into one plane, the root parts the way along the line as their
    /// distances from it do. Where the light's point depends on the root, two steps come near it.
    #[inline(always)]
    fn roots<S: Sources>(&self, receiver: &Receiver, sources: &S) -> [f64; LANES] {
        const STEPS: usize = 2;
        let c = receiver.position;
        let mut roots = self.nearest;
        for _ in 0..STEPS {
            for i in 0..LANES {
                let origin = sources.origin(self.source(i), roots[i], self.v[i]);
                let (y, z) = (origin.y - self.v[i], origin.z);
                let from_source = (y * y + z * z).sqrt();
                let y = c.y - self.v[i];
                let from_receiver = (y * y + c.z * c.z).sqrt();
                roots[i] =
                    (origin.x * from_receiver + c.x * from_source) / (from_source + from_receiver);
            }
        }
        for i in 0..LANES {
            roots[i] = asinh((roots[i] - self.nearest[i]) / self.delta[i]);
        }
        roots
    }

    /// Cuts each line to the part that the lobe reaches, about a bracket of the root of h_u.
    #[inline(always)]
    pub fn narrow<S: Sources>(
        &mut self,
        receiver: &Receiver,
        surface: &Surface,
        sources: &S,
        reach: f64,
    ) {
        /// Corrections of the ends.
        const CORRECTIONS: usize = 3;
        let [mut a, mut b, middle] = self.first_ends(receiver, surface, sources, reach);
        // The slope is no linear function of t: move the ends to where the lobe really is so low.
        let depth = 0.5 * reach * reach;
        for _ in 0..CORRECTIONS {
            for i in 0..LANES {
                let root = middle[i];
                let at = self.clamped(i, a[i]);
                let [u, v, z] = self.half(i, at, receiver, sources);
                a[i] = root + widening(depth, surface.depth(u, v, z)) * (a[i] - root);
            }
            for i in 0..LANES {
                let root = middle[i];
                let at = self.clamped(i, b[i]);
                let [u, v, z] = self.half(i, at, receiver, sources);
                b[i] = root + widening(depth, surface.depth(u, v, z)) * (b[i] - root);
            }
        }
        for i in 0..LANES {
            self.low[i] = if a[i] > self.low[i] {
                a[i]
            } else {
                self.low[i]
            };
            self.high[i] = if b[i] < self.high[i] {
                b[i]
            } else {
                self.high[i]
            };
            self.high[i] = if self.high[i] > self.low[i] {
                self.high[i]
            } else {
                self.low[i]
            };
        }
    }

    /// The ends of what the lobe reaches of each line, if its slope is a linear function of t, and the
    /// middle.
    #[inline(always)]
    fn first_ends<S: Sources>(
        &self,
        receiver: &Receiver,
        surface: &Surface,
        sources: &S,
        reach: f64,
    ) -> [[f64; LANES]; 3] {
        /// The step of a difference quotient, in t.
        const STEP: f64 = 1e-4;
        /// The most that a root is corrected by, in t.
        const CORRECTION_MAX: f64 = 0.1;
        let roots = self.roots(receiver, sources);
        let [mut a, mut b, mut middle] = [[0.0; LANES]; 3];
        for i in 0..LANES {
            let root = self.clamped(i, roots[i]);
            let [u0, v0, z0] = self.half(i, root - STEP, receiver, sources);
            let [u1, _, z1] = self.half(i, root + STEP, receiver, sources);
            let [before, after] = [u0 / z0, u1 / z1];
            let slope = (before - after) * (0.5 / STEP);
            let slope = if slope > 1e-9 { slope } else { 1e-9 };
            let correction = 0.5 * (before + after) / slope;
            let correction = if correction > -CORRECTION_MAX {
                correction
            } else {
                -CORRECTION_MAX
            };
            let correction = if correction < CORRECTION_MAX {
                correction
            } else {
                CORRECTION_MAX
            };
            let root = self.clamped(i, root + correction);
            // Far out along its other axis a lobe is wider along this one.
            let t = v0 * v0 / (z0 * z0) + 1e-12;
            let width = reach * (t / (surface.n_u * log1p(t))).sqrt() / slope;
            a[i] = root - width;
            b[i] = root + width;
            middle[i] = root;
        }
        [a, b, middle]
    }

    /// A t of a line, or the end next to it.
    #[inline(always)]
    fn clamped(&self, i: usize, t: f64) -> f64 {
        let t = if t > self.low[i] { t } else { self.low[i] };
        if t < self.high[i] { t } else { self.high[i] }
    }

    /// Where a t lies.
    #[inline(always)]
    fn u(&self, i: usize, t: f64) -> (f64, f64) {
        let e = exp(t);
        let inverse = 1.0 / e;
        let (sinh, cosh) = (0.5 * (e - inverse), 0.5 * (e + inverse));
        (self.nearest[i] + self.delta[i] * sinh, self.delta[i] * cosh)
    }

    #[inline(always)]
    fn source(&self, i: usize) -> [f64; 3] {
        [self.sources[0][i], self.sources[1][i], self.sources[2][i]]
    }

    /// The sum of the directions to light and receiver.
    #[inline(always)]
    fn half<S: Sources>(&self, i: usize, t: f64, receiver: &Receiver, sources: &S) -> [f64; 3] {
        let (u, _) = self.u(i, t);
        let wi = sources.light(self.source(i), u, self.v[i]).wi;
        let c = receiver.position;
        let (x, y) = (c.x - u, c.y - self.v[i]);
        let inverse = 1.0 / (x * x + y * y + c.z * c.z).sqrt();
        [wi.x + x * inverse, wi.y + y * inverse, wi.z + c.z * inverse]
    }
}

/// By how much an end moves away from the root, 1 to 4, if the lobe has fallen by `fallen` there.
#[inline(always)]
fn widening(depth: f64, fallen: f64) -> f64 {
    let factor = (depth / (fallen + 1e-9)).sqrt();
    let factor = if factor < 1.0 { 1.0 } else { factor };
    if factor < 4.0 { factor } else { 4.0 }
}

/// Points of the sample, one a lane, and what they send to the receiver.
pub struct Sent {
    pub u: [f64; LANES],
    /// The direction to the receiver.
    pub wo: [[f64; LANES]; 3],
    /// Irradiance over pi there for a unit of radiance, with the rule's weights.
    pub form: [f64; LANES],
}

impl Sent {
    /// At nodes of the rule along lines: shares of their lengths, and their weights.
    #[inline(always)]
    pub fn new(
        lines: &Lines<'_>,
        weight_v: &[f64; LANES],
        [nodes, weights_t]: [&[f64; LANES]; 2],
        receiver: &Receiver,
    ) -> Self {
        let [mut u, mut weight, mut form] = [[0.0; LANES]; 3];
        for i in 0..LANES {
            let length = lines.high[i] - lines.low[i];
            let (at, du) = lines.u(i, lines.low[i] + nodes[i] * length);
            u[i] = at;
            weight[i] = weight_v[i] * weights_t[i] * length * du;
        }
        let mut wo = [[0.0; LANES]; 3];
        let (c, n) = (receiver.position, receiver.normal);
        for i in 0..LANES {
            let (x, y) = (c.x - u[i], c.y - lines.v[i]);
            let inverse = 1.0 / (x * x + y * y + c.z * c.z).sqrt();
            let (x, y, z) = (x * inverse, y * inverse, c.z * inverse);
            let facing = -(n.x * x + n.y * y + n.z * z);
            let facing = if facing > 0.0 { facing } else { 0.0 };
            form[i] = FRAC_1_PI * weight[i] * z * facing * inverse * inverse;
            wo[0][i] = x;
            wo[1][i] = y;
            wo[2][i] = z;
        }
        Self { u, wo, form }
    }
}

/// Adds what arrives at the receiver off such points of the light that reaches each.
#[inline(always)]
pub fn add_light(
    light: impl Fn(usize) -> Light,
    sent: &Sent,
    surface: &Surface,
    toward: impl Fn(usize) -> Toward,
    sums: &mut [[f64; LANES]; 3],
) {
    // Several short loops: the compiler does not vectorise one long one.
    let mut wi = [[0.0; LANES]; 3];
    let [mut specular, mut irradiance] = [[0.0; LANES]; 2];
    for i in 0..LANES {
        let found = light(i);
        wi[0][i] = found.wi.x;
        wi[1][i] = found.wi.y;
        wi[2][i] = found.wi.z;
        specular[i] = found.weight * sent.form[i];
        irradiance[i] = found.irradiance * sent.form[i];
    }
    for i in 0..LANES {
        let [wi, wo] = [&wi, &sent.wo].map(|w| Vec3 {
            x: w[0][i],
            y: w[1][i],
            z: w[2][i],
        });
        specular[i] *= surface.specular(&wi, &wo);
    }
    let mut tints = [[0.0; LANES]; 3];
    for i in 0..LANES {
        let fresnel = fresnel::reflectance(wi[2][i], surface.ior);
        let [r, g, b] = surface.tint(fresnel, &toward(i));
        tints[0][i] = r;
        tints[1][i] = g;
        tints[2][i] = b;
    }
    for channel in 0..3 {
        for i in 0..LANES {
            let lambert = surface.lambert[channel] * irradiance[i];
            sums[channel][i] += specular[i] * tints[channel][i] + lambert;
        }
    }
}

/// Adds the nodes of a rule along lines, each of which has its own source.
#[inline(always)]
pub fn add_nodes<S: Sources>(
    lines: &Lines<'_>,
    weight_v: &[f64; LANES],
    rule: &GaussRule,
    receiver: &Receiver,
    surface: &Surface,
    sources: &S,
    sums: &mut [[f64; LANES]; 3],
) {
    for (node, weight_t) in rule.on(0.0, 1.0) {
        let node = [&[node; LANES], &[weight_t; LANES]];
        let sent = Sent::new(lines, weight_v, node, receiver);
        let light = |i: usize| sources.light(lines.source(i), sent.u[i], lines.v[i]);
        let toward = |i: usize| surface.toward(sent.wo[2][i]);
        add_light(light, &sent, surface, toward, sums);
    }
}
