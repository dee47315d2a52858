//! The integrand at the points of the rule.

use crate::numerics::batch::{Batch, LANES, total};
use crate::numerics::elementary::{exp, log1p};
use crate::numerics::instructions::kernel;
use crate::reflectance::fresnel;
use crate::vector::Vec3;

/// Points of the rule: p, q, 1 beyond the tint's knee and else 0; then in each channel the chart's
/// light times the rule's weight where the light stands higher than the viewer, and where lower.
pub type PieceBatch = Batch<9>;

kernel! {
    /// In each channel the integral of the light times the lobe and Fresnel's reflectance, and of
    /// the same with what that exceeds the tint's knee by.
    pub fn integrals(
        batch: &PieceBatch,
        wo: Vec3,
        exponents: [f64; 2],
        ior: f64,
        knee: f64,
    ) -> [[f64; 3]; 2] {
        let per_viewer = 1.0 / wo.z;
        let mut sums = [[[0.0; LANES]; 3]; 2];
        for [p, q, beyond_knee, r_high, g_high, b_high, r_low, g_low, b_low] in batch.blocks() {
            let (mut value, mut shade, mut beyond) = ([0.0; LANES], [0.0; LANES], [0.0; LANES]);
            for i in 0..LANES {
                let (p2, q2) = (p[i] * p[i], q[i] * q[i]);
                let t = p2 + q2;
                let inverse = 1.0 / (1.0 + t);
                let cos_i = 2.0 * (wo.x * p[i] + wo.y * q[i] + wo.z) * inverse - wo.z;
                // Points that a piece is told by can lie beyond it, and below the horizon.
                let cos_i = if cos_i > 0.0 { cos_i } else { 0.0 };
                // At the normal the quotient is 0/0 and the product 0.
                let exponent = (exponents[0] * p2 + exponents[1] * q2) / (t + f64::MIN_POSITIVE);
                let power = exp(-0.5 * exponent * log1p(t));
                let fresnel = fresnel::reflectance(cos_i, ior);
                let lobe = power * inverse * inverse.sqrt();
                value[i] = lobe * fresnel;
                beyond[i] = lobe * (fresnel - knee) * beyond_knee[i];
                shade[i] = cos_i * per_viewer;
            }
            let light = [(r_high, r_low), (g_high, g_low), (b_high, b_low)];
            for (channel, (high, low)) in light.into_iter().enumerate() {
                for i in 0..LANES {
                    let light = high[i] + shade[i] * low[i];
                    sums[0][channel][i] += value[i] * light;
                    sums[1][channel][i] += beyond[i] * light;
                }
            }
        }
        sums.map(|channels| channels.map(total))
    }
}
