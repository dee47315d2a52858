//! A label as a distribution over bins: a Gaussian around the label's position, cut off at nine
//! bins, as in the paper's section 4.3 ("we apply a Gaussian filter of radius nine").

use super::BINS;
use serde::{Deserialize, Serialize};

/// The standard deviation of the Gaussian, in bins: the paper's radius is three of them.
pub const SIGMA_BINS: f64 = 3.0;

/// Positions further away than this get no weight, in bins.
pub const RADIUS_BINS: f64 = 9.0;

/// What happens to the weight that the Gaussian would put beside the range.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Ends {
    /// It is dropped, and the rest is scaled to a sum of 1.
    Renormalise,
    /// The range is a circle: it lands at the other end.
    Wrap,
    /// It is mirrored at the end of the range, as SciPy's filters do by default. Bins 1 to 3 are
    /// then not the most probable of their own targets.
    Reflect,
}

/// How labels become targets.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Smoothing {
    /// The standard deviation in bins, above 0.
    pub sigma_bins: f64,
    /// At the ends of a range that is not a circle: [`Ends::Renormalise`] or [`Ends::Reflect`].
    pub ends: Ends,
}

impl Default for Smoothing {
    fn default() -> Self {
        Self {
            sigma_bins: SIGMA_BINS,
            ends: Ends::Renormalise,
        }
    }
}

/// Standard deviations that a smoothing may have, in bins. Below, a target away from the middle of a
/// bin has no weight left.
pub const SIGMA_RANGE_BINS: [f64; 2] = [0.1, 100.0];

impl Smoothing {
    /// Whether its targets are distributions.
    pub fn is_sound(&self) -> bool {
        let [least, most] = SIGMA_RANGE_BINS;
        (least..=most).contains(&self.sigma_bins)
    }

    /// The target of a label at `centre`, a position in bins from -0.5 to 99.5 (bin b is at b), on
    /// a circle or not. The sum is 1.
    pub fn target(&self, centre: f64, circular: bool) -> [f64; BINS] {
        let gauss = |distance: f64| {
            if distance.abs() <= RADIUS_BINS {
                libm::exp(-distance * distance / (2.0 * self.sigma_bins * self.sigma_bins))
            } else {
                0.0
            }
        };
        let length = BINS as f64;
        let ends = if circular { Ends::Wrap } else { self.ends };
        let weights: [f64; BINS] = std::array::from_fn(|bin| {
            let bin = bin as f64;
            let inside = gauss(bin - centre);
            match ends {
                Ends::Renormalise => inside,
                Ends::Wrap => inside + gauss(bin - centre + length) + gauss(bin - centre - length),
                Ends::Reflect => {
                    let below = gauss(-1.0 - bin - centre);
                    inside + below + gauss(2.0 * length - 1.0 - bin - centre)
                }
            }
        });
        let sum: f64 = weights.iter().sum();
        weights.map(|weight| weight / sum)
    }
}

/// The entropy of a distribution in nats: the least cross-entropy that logits can have with it.
pub fn entropy(distribution: &[f64]) -> f64 {
    let term = |&p: &f64| if p > 0.0 { -p * libm::log(p) } else { 0.0 };
    distribution.iter().map(term).sum()
}
