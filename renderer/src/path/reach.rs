//! What paths have met of the chart, seen in the sample.

use super::interval::UNSEEN;

/// Whether any of some paths went on from the sample to the chart, and how far from the lobe's
/// centre the chart began for them.
#[derive(Clone, Copy, Debug)]
pub struct Reach {
    pub hit: bool,
    /// The least negative logarithm of the lobe on the chart, over its peak.
    pub log_lobe: f64,
}

impl Default for Reach {
    fn default() -> Self {
        Self::NONE
    }
}

impl Reach {
    /// Of no path.
    pub const NONE: Self = Self {
        hit: false,
        log_lobe: f64::INFINITY,
    };

    /// At most the share of a pixel's light that goes to the chart, `paths` paths not having met it.
    pub fn unseen(&self, paths: u32) -> f64 {
        if self.hit {
            0.0
        } else {
            UNSEEN / f64::from(paths) * libm::exp(-self.log_lobe)
        }
    }
}
