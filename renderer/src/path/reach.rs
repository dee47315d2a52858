//! What paths have met of the chart, seen in the sample.

use super::interval::UNSEEN;

/// A path that met the chart with this share of what one may carry there shows what is to be met. Chosen.
const SHOWS: f64 = 0.1;

/// What paths that went on from the sample to the chart have met, and what those that did not may have left out.
#[derive(Clone, Copy, Debug)]
pub struct Reach {
    /// The most that a path carried that met the chart, as a share of its radiance.
    pub met: f64,
    /// Of all that went on from the sample.
    pub unmet: Unmet,
}

/// At most what is on the way to the chart, as a share of its radiance, were it hidden nowhere.
#[derive(Clone, Copy, Debug)]
pub struct Unmet {
    /// All of it.
    pub share: f64,
    /// What one path carries that goes to the chart.
    pub weight: f64,
}

impl Unmet {
    /// Where no path goes to the chart.
    pub const NOTHING: Self = Self {
        share: 0.0,
        weight: 0.0,
    };

    /// Where only the weight of a path is known.
    pub fn unknown(weight: f64) -> Self {
        Self {
            share: f64::INFINITY,
            weight,
        }
    }
}

impl Default for Reach {
    fn default() -> Self {
        Self::NONE
    }
}

impl Reach {
    /// Of no path.
    pub const NONE: Self = Self {
        met: 0.0,
        unmet: Unmet::NOTHING,
    };

    /// Notes what a path may leave out.
    pub fn note(&mut self, unmet: Unmet) {
        self.unmet.share = self.unmet.share.max(unmet.share);
        self.unmet.weight = self.unmet.weight.max(unmet.weight);
    }

    /// At most the share of a pixel's light that goes to the chart, `paths` paths not having met it. Paths that are
    /// aimed at all of it may meet it where the lobe sends nothing.
    pub fn unseen(&self, paths: u32) -> f64 {
        let Unmet { share, weight } = self.unmet;
        if self.met > 0.0 && self.met >= SHOWS * weight {
            return 0.0;
        }
        share.min(UNSEEN / f64::from(paths) * weight)
    }
}
