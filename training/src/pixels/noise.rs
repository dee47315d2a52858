//! A camera's noise: Gaussian. Training draws a standard deviation for each material and epoch, as in
//! the paper's section 5 ("standard deviation between 0 and 4"); an evaluation states one.

use crate::keystream::{Purpose, keystream};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal, Uniform};

/// The seed of the noise that estimators are judged with: the same for all of them.
const JUDGED_SEED: u64 = 0;

/// The largest standard deviation, in steps of an 8-bit code. The paper names no unit; 4 makes sense
/// for 8-bit codes alone.
pub const NOISE_CODES_MAX: f32 = 4.0;

/// Steps of an 8-bit code from black to white.
pub const CODE_STEPS: f32 = 255.0;

/// Noise that photographs are read with.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Noise {
    /// None.
    Exact,
    /// In training: of a standard deviation drawn for each material and epoch, up to
    /// [`NOISE_CODES_MAX`]. Outside of it, none.
    Augmentation {
        /// The training's seed.
        seed: u64,
    },
    /// Wherever photographs are read: of this standard deviation in steps of an 8-bit code. Every
    /// estimator that reads codes of one kind reads the same photographs.
    Camera {
        /// 0 or more.
        steps: f32,
    },
}

impl Noise {
    /// Adds the noise of material `material` to its codes, in epoch `epoch` of a training, and clips
    /// them to `0..=code_max`.
    pub fn add(self, codes: &mut [f32], code_max: f32, epoch: Option<u32>, material: u32) {
        match (self, epoch) {
            (Self::Exact, _) | (Self::Augmentation { .. }, None) => {}
            (Self::Augmentation { seed }, Some(epoch)) => {
                augment(codes, code_max, seed, epoch, material);
            }
            (Self::Camera { steps }, _) => {
                let rng = keystream(JUDGED_SEED, Purpose::Judged, u64::from(material));
                add_normal(codes, code_max, steps / CODE_STEPS, rng);
            }
        }
    }
}

fn augment(codes: &mut [f32], code_max: f32, seed: u64, epoch: u32, material: u32) {
    let stream = u64::from(epoch) << 32 | u64::from(material);
    let mut rng = keystream(seed, Purpose::Noise, stream);
    let Ok(deviations) = Uniform::new(0.0, NOISE_CODES_MAX / CODE_STEPS) else {
        unreachable!("the range is not empty");
    };
    let deviation = deviations.sample(&mut rng);
    add_normal(codes, code_max, deviation, rng);
}

fn add_normal(codes: &mut [f32], code_max: f32, deviation: f32, mut rng: ChaCha8Rng) {
    for code in codes {
        let noise: f32 = StandardNormal.sample(&mut rng);
        *code = (*code + deviation * noise).clamp(0.0, code_max);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn noise(seed: u64, epoch: u32, material: u32) -> Vec<f32> {
        let mut codes = vec![0.5; 2000];
        Noise::Augmentation { seed }.add(&mut codes, 1.0, Some(epoch), material);
        codes
    }

    fn camera(steps: f32, epoch: Option<u32>, material: u32) -> Vec<f32> {
        let mut codes = vec![0.5; 2000];
        Noise::Camera { steps }.add(&mut codes, 1.0, epoch, material);
        codes
    }

    #[test]
    fn deviations_are_uniform_and_a_function_of_seed_epoch_and_material() {
        assert_eq!(noise(1, 2, 3), noise(1, 2, 3));
        for other in [noise(2, 2, 3), noise(1, 3, 3), noise(1, 2, 4)] {
            assert_ne!(noise(1, 2, 3), other);
        }
        let deviations: Vec<f64> = (0..400)
            .map(|material| {
                let squares = noise(7, 0, material).into_iter();
                let squares = squares.map(|code| f64::from(code - 0.5) * f64::from(code - 0.5));
                (squares.sum::<f64>() / 2000.0).sqrt() * f64::from(CODE_STEPS)
            })
            .collect();
        // Uniform over 0 to 4: the mean of 400 is off 2 by 0.058 in one standard deviation.
        let mean = deviations.iter().sum::<f64>() / 400.0;
        assert!((mean - 2.0).abs() < 0.23, "{mean}");
        assert!(deviations.iter().all(|deviation| *deviation < 4.3));
        assert!(deviations.iter().any(|deviation| *deviation > 3.8));
    }

    #[test]
    fn a_camera_has_the_noise_that_is_stated_in_every_epoch() {
        assert_eq!(camera(4.0, None, 3), camera(4.0, Some(7), 3));
        assert_ne!(camera(4.0, None, 3), camera(4.0, None, 4));
        assert_eq!(camera(0.0, None, 3), vec![0.5; 2000]);
        let squares = camera(4.0, None, 3).into_iter();
        let squares = squares.map(|code| f64::from(code - 0.5) * f64::from(code - 0.5));
        let deviation = (squares.sum::<f64>() / 2000.0).sqrt() * f64::from(CODE_STEPS);
        // Of 2000 it is off 4 by 0.063 in one standard deviation.
        assert!((deviation - 4.0).abs() < 0.25, "{deviation}");
    }

    #[test]
    fn only_training_is_augmented() {
        let mut codes = vec![0.5; 8];
        Noise::Augmentation { seed: 1 }.add(&mut codes, 1.0, None, 3);
        Noise::Exact.add(&mut codes, 1.0, Some(2), 3);
        assert_eq!(codes, vec![0.5; 8]);
    }

    #[test]
    fn codes_stay_in_their_range() {
        let mut codes = [0.0, 1.0].repeat(500);
        Noise::Camera { steps: 4.0 }.add(&mut codes, 1.0, None, 0);
        assert!(codes.iter().all(|code| (0.0..=1.0).contains(code)));
    }
}
