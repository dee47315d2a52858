//! A completed material: the record that everything else is derived from.

use crate::Fingerprint;
use dataset::CompletedView;
use serde::{Deserialize, Serialize};

/// What was reported of a material when it was completed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Completion {
    /// The material's index.
    pub material: u32,
    /// Every view of the specification, in order.
    pub views: Vec<CompletedView>,
    /// Wall-clock time of rendering.
    pub seconds: f64,
    /// The full name of the worker.
    pub worker: String,
}

impl Completion {
    /// What it is compared with another rendering by: images and statistics.
    pub fn fingerprint(&self) -> Fingerprint {
        Fingerprint::of(&self.views)
    }

    /// Bytes of all images; no more than can be counted, whatever a damaged record says.
    pub fn bytes(&self) -> u64 {
        let bytes = self.views.iter().map(|view| view.bytes);
        bytes.fold(0, u64::saturating_add)
    }
}

#[cfg(any(test, feature = "testing"))]
impl Completion {
    /// A material of one view whose digest is that of these bytes, by nobody.
    pub fn sample(material: u32, image: &[u8]) -> Self {
        let statistics = dataset::ErrorStatistics {
            mean: 0.1,
            p95: 0.2,
            max: 0.3,
            within_target: 0.9,
            samples: 64,
            evaluations: 7,
        };
        Self {
            material,
            views: vec![CompletedView {
                digest: dataset::Digest::of(image),
                bytes: 5,
                statistics,
                pixels: Some(dataset::PixelStatistics {
                    sample_share: 0.25,
                    brightness_mean: 0.1,
                    brightness_p99: 0.75,
                    dark_share: 0.5,
                    above_white_share: 0.0,
                }),
            }],
            seconds: 0.25,
            worker: String::new(),
        }
    }
}
