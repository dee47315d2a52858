//! A camera's noise: Gaussian, of one standard deviation for each material and epoch, as in the
//! paper's section 5 ("standard deviation between 0 and 4").

use crate::keystream::{Purpose, keystream};
use rand_distr::{Distribution, StandardNormal, Uniform};

/// The largest standard deviation, in steps of an 8-bit code. The paper names no unit; 4 makes sense
/// for 8-bit codes alone.
pub const NOISE_CODES_MAX: f32 = 4.0;

/// Steps of an 8-bit code from black to white.
pub const CODE_STEPS: f32 = 255.0;

/// Adds the noise of material `material` in epoch `epoch` to its codes, and clips them to
/// `0..=code_max`.
pub fn add_noise(codes: &mut [f32], code_max: f32, seed: u64, epoch: u32, material: u32) {
    let stream = u64::from(epoch) << 32 | u64::from(material);
    let mut rng = keystream(seed, Purpose::Noise, stream);
    let Ok(deviations) = Uniform::new(0.0, NOISE_CODES_MAX / CODE_STEPS) else {
        unreachable!("the range is not empty");
    };
    let deviation = deviations.sample(&mut rng);
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
        add_noise(&mut codes, 1.0, seed, epoch, material);
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
    fn codes_stay_in_their_range() {
        let mut codes = [0.0, 1.0].repeat(500);
        add_noise(&mut codes, 1.0, 0, 0, 0);
        assert!(codes.iter().all(|code| (0.0..=1.0).contains(code)));
    }
}
