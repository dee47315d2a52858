//! What a file claims of itself: a file may come from anybody, and nothing is allocated for a
//! network that it does not hold.

use super::ModelOptions;
use crate::labels::target::SIGMA_RANGE_BINS;
use crate::network::architecture::SIDES;

impl ModelOptions {
    /// What is wrong with options that a file of this many bytes brings, if anything is.
    pub(super) fn fault(&self, bytes: usize) -> Option<String> {
        let training = &self.training;
        let architecture = training.architecture;
        let Some(weights) = architecture.weights(training.variant) else {
            let [least, most] = SIDES;
            return Some(format!(
                "no network has the sizes {architecture:?}: sides are multiples of 4 from {least} \
                 to {most}"
            ));
        };
        if weights.saturating_mul(4) > bytes as u64 {
            return Some(format!(
                "its network has {weights} weights, for which {bytes} bytes are too few"
            ));
        }
        if self.identity.side != architecture.side {
            let read = self.identity.side;
            let side = architecture.side;
            return Some(format!(
                "its network reads {side} pixels a side and was trained on {read}"
            ));
        }
        if !training.smoothing.is_sound() {
            let [least, most] = SIGMA_RANGE_BINS;
            let sigma = training.smoothing.sigma_bins;
            return Some(format!(
                "targets of a deviation of {sigma} bins, where {least} to {most} are sound"
            ));
        }
        match self.scene() {
            Err(error) => return Some(error.to_string()),
            Ok(scene) if scene.hash().to_string() != self.identity.specification => {
                return Some("its specification is not the one that it names".to_owned());
            }
            Ok(scene) => {
                let views = self.identity.views;
                let count = scene.views.len();
                if views[0] == views[1] || views.iter().any(|&view| view as usize >= count) {
                    return Some(format!("the views {views:?} of {count}"));
                }
            }
        }
        let there = self.normalisations.each_ref().map(Option::is_some);
        if there != training.variant.trunks() {
            let name = training.variant.name();
            return Some(format!("its normalisations are not those of {name}"));
        }
        let normalisations = self.normalisations.iter().flatten();
        let mut unsound = normalisations.filter(|normalisation| !normalisation.is_sound());
        unsound
            .next()
            .map(|normalisation| format!("a normalisation of {normalisation:?}"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::data::Identity;
    use crate::fit::options::Preset;
    use crate::network::Architecture;
    use crate::pixels::normalisation::Normalisation;
    use crate::variant::Variant;
    use dataset::Specification;
    use dataset::specification::{SampleMesh, Shape};

    const MIB: usize = 1 << 20;

    fn options() -> ModelOptions {
        ModelOptions {
            training: Preset::Cpu.options(Variant::Cnn0),
            identity: Identity {
                specification: Specification::preset().hash().to_string(),
                renderer_version: String::new(),
                views: [5, 8],
                side: Architecture::CPU.side,
            },
            pairs: String::new(),
            specification: Specification::preset().to_json(),
            normalisations: [
                Some(Normalisation::Channels {
                    mean: [0.5; 6],
                    deviation: [0.25; 6],
                }),
                None,
            ],
        }
    }

    #[track_caller]
    fn refused(change: impl FnOnce(&mut ModelOptions), words: &str) {
        let mut options = options();
        change(&mut options);
        let fault = options.fault(4 * MIB).expect("a fault");
        assert!(fault.contains(words), "{fault:?} does not say {words:?}");
    }

    #[test]
    fn what_a_training_writes_has_no_fault() {
        assert_eq!(options().fault(4 * MIB), None);
    }

    /// A model names the mesh that its images show, and is read where nobody has that mesh.
    #[test]
    fn the_specification_of_a_mesh_is_read_without_the_mesh() {
        let mut shaped = Specification::preset();
        let mesh = SampleMesh::of_bytes(b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n".to_vec());
        shaped.sample.shape = Shape::Mesh;
        shaped.sample.mesh = Some(mesh.unwrap());
        let mut options = options();
        options.identity.specification = shaped.hash().to_string();
        options.specification = shaped.to_json();
        assert_eq!(options.fault(4 * MIB), None);
        let json = serde_json::to_string(&options).unwrap();
        let read: ModelOptions = serde_json::from_str(&json).unwrap();
        let scene = read.scene().unwrap();
        assert_eq!(scene.hash(), shaped.hash());
        assert!(scene.sample.loaded_mesh().is_none());
    }

    #[test]
    fn networks_that_the_file_cannot_hold_are_refused() {
        refused(|o| o.training.architecture.hidden[0] = 1 << 40, "sizes");
        refused(|o| o.training.architecture.hidden[0] = 1 << 16, "too few");
        refused(|o| o.training.architecture.filters[1] = 0, "sizes");
        refused(|o| o.training.architecture.side = 30, "multiples of 4");
        refused(|o| o.training.architecture.side = 1 << 31, "multiples of 4");
        refused(|o| o.training.architecture.side = 16, "16 pixels");
        assert!(options().fault(3 * MIB).is_some(), "862,680 weights");
    }

    #[test]
    fn numbers_that_would_become_none_are_refused() {
        for sigma in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            refused(|o| o.training.smoothing.sigma_bins = sigma, "deviation");
        }
        refused(|o| o.specification.clear(), "specification");
        refused(|o| o.identity.specification.clear(), "specification");
        refused(|o| o.identity.views = [5, 14], "views");
        refused(|o| o.normalisations = [None, None], "those of cnn0");
        refused(|o| o.normalisations.swap(0, 1), "those of cnn0");
        for deviation in [0.0, f32::NAN] {
            let channels = |o: &mut ModelOptions| {
                o.normalisations[0] = Some(Normalisation::Channels {
                    mean: [0.5; 6],
                    deviation: [deviation; 6],
                });
            };
            refused(channels, "normalisation");
        }
    }
}
