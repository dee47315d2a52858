//! Codes as numbers around 0: each channel by its mean and deviation, or whitened.
//!
//! Whitening removes the correlation of colours (paper, section 4.1): CNN_w reads whitened
//! photographs, CNN_0 does not. It is ZCA over the three colours, x = C^(-1/2) (c - mean), so that
//! the result is as close to the codes as uncorrelated colours of variance 1 can be.

use super::CHANNELS;
use nalgebra::{Matrix3, SymmetricEigen, Vector3};
use serde::{Deserialize, Serialize};

/// Added to the variance of colours, as codes squared: an image of one colour stays finite.
const VARIANCE_FLOOR: f64 = 1e-6;

/// How codes become a network's input.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Normalisation {
    /// By channel.
    Channels {
        /// Mean code of each of the six channels over the training split.
        mean: [f32; CHANNELS],
        /// Standard deviation of each channel.
        deviation: [f32; CHANNELS],
    },
    /// One whitening for all images and both views.
    Whitened(Whitening),
    /// A whitening for each view of each material, from its own pixels.
    WhitenedByImage,
}

/// x = matrix (c - mean), for the three colours of a pixel.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Whitening {
    /// Mean code of red, green and blue.
    pub mean: [f32; 3],
    /// Rows of the symmetric matrix C^(-1/2).
    pub matrix: [[f32; 3]; 3],
}

/// Sums over pixels from which normalisations follow. Sums of parts add up to the sums of the whole.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Moments {
    pixels: f64,
    sum: [f64; CHANNELS],
    square: [f64; CHANNELS],
    // Products of colours of both views: red-green, red-blue, green-blue.
    product: [f64; 3],
}

impl Moments {
    /// Of one material's codes: six planes of the same length.
    pub fn of(codes: &[f32]) -> Self {
        let length = codes.len() / CHANNELS;
        let mut moments = Self {
            pixels: length as f64,
            ..Self::default()
        };
        let planes: Vec<&[f32]> = codes.chunks_exact(length).collect();
        for (channel, plane) in planes.iter().enumerate() {
            for &code in *plane {
                let code = f64::from(code);
                moments.sum[channel] += code;
                moments.square[channel] += code * code;
            }
        }
        for view in planes.chunks_exact(3) {
            for (pair, (one, other)) in [(0, 1), (0, 2), (1, 2)].into_iter().enumerate() {
                let products = view[one].iter().zip(view[other]);
                moments.product[pair] += products
                    .map(|(&a, &b)| f64::from(a) * f64::from(b))
                    .sum::<f64>();
            }
        }
        moments
    }

    /// Adds the sums of other pixels.
    pub fn add(&mut self, other: &Self) {
        self.pixels += other.pixels;
        let pairs = self.sum.iter_mut().zip(other.sum);
        let squares = self.square.iter_mut().zip(other.square);
        let products = self.product.iter_mut().zip(other.product);
        for (sum, more) in pairs.chain(squares).chain(products) {
            *sum += more;
        }
    }

    /// Each channel to mean 0 and variance 1.
    pub fn channels(&self) -> Normalisation {
        let mean = self.sum.map(|sum| sum / self.pixels);
        let deviation = std::array::from_fn(|channel| {
            let variance = self.square[channel] / self.pixels - mean[channel] * mean[channel];
            (variance.max(0.0) + VARIANCE_FLOOR).sqrt() as f32
        });
        Normalisation::Channels {
            mean: mean.map(|mean| mean as f32),
            deviation,
        }
    }

    /// The colours of both views to mean 0 and the identity as covariance.
    pub fn whitening(&self) -> Whitening {
        let count = 2.0 * self.pixels;
        let of_both = |sums: [f64; CHANNELS]| -> [f64; 3] {
            std::array::from_fn(|colour| (sums[colour] + sums[colour + 3]) / count)
        };
        whitening(
            of_both(self.sum),
            of_both(self.square),
            self.product.map(|sum| sum / count),
        )
    }
}

/// The whitening of colours with these means of c, c^2, and red-green, red-blue, green-blue.
fn whitening(mean: [f64; 3], square: [f64; 3], product: [f64; 3]) -> Whitening {
    let [rg, rb, gb] = product;
    let second = Matrix3::new(square[0], rg, rb, rg, square[1], gb, rb, gb, square[2]);
    let mean = Vector3::from(mean);
    let covariance = second - mean * mean.transpose() + Matrix3::identity() * VARIANCE_FLOOR;
    let eigen = SymmetricEigen::new(covariance);
    let roots = eigen
        .eigenvalues
        .map(|value| 1.0 / value.max(VARIANCE_FLOOR).sqrt());
    let matrix =
        eigen.eigenvectors * Matrix3::from_diagonal(&roots) * eigen.eigenvectors.transpose();
    Whitening {
        mean: [mean.x as f32, mean.y as f32, mean.z as f32],
        matrix: std::array::from_fn(|row| {
            std::array::from_fn(|column| matrix[(row, column)] as f32)
        }),
    }
}

impl Whitening {
    fn apply(&self, view: &mut [f32]) {
        let length = view.len() / 3;
        let (red, rest) = view.split_at_mut(length);
        let (green, blue) = rest.split_at_mut(length);
        for ((r, g), b) in red.iter_mut().zip(green).zip(blue) {
            let centred = [*r - self.mean[0], *g - self.mean[1], *b - self.mean[2]];
            let [x, y, z] = self
                .matrix
                .map(|row| row[0] * centred[0] + row[1] * centred[1] + row[2] * centred[2]);
            (*r, *g, *b) = (x, y, z);
        }
    }
}

impl Normalisation {
    /// Whether finite codes stay finite.
    pub fn is_sound(&self) -> bool {
        let finite = |values: &[f32]| values.iter().all(|value| value.is_finite());
        match self {
            Self::Channels { mean, deviation } => {
                let normal = deviation.iter().all(|deviation| deviation.is_normal());
                finite(mean) && normal
            }
            Self::Whitened(Whitening { mean, matrix }) => {
                finite(mean) && matrix.iter().all(|row| finite(row))
            }
            Self::WhitenedByImage => true,
        }
    }

    /// Normalises one material's codes: six planes of the same length.
    pub fn apply(&self, codes: &mut [f32]) {
        let length = codes.len() / CHANNELS;
        match self {
            Self::Channels { mean, deviation } => {
                for (channel, plane) in codes.chunks_exact_mut(length).enumerate() {
                    for code in plane {
                        *code = (*code - mean[channel]) / deviation[channel];
                    }
                }
            }
            Self::Whitened(whitening) => {
                for view in codes.chunks_exact_mut(3 * length) {
                    whitening.apply(view);
                }
            }
            Self::WhitenedByImage => {
                for view in codes.chunks_exact_mut(3 * length) {
                    of_image(view).apply(view);
                }
            }
        }
    }
}

/// The whitening of one view's own colours.
fn of_image(view: &[f32]) -> Whitening {
    let length = view.len() / 3;
    let planes: Vec<&[f32]> = view.chunks_exact(length).collect();
    let mean_product = |one: usize, other: usize| {
        let products = planes[one].iter().zip(planes[other]);
        products
            .map(|(&a, &b)| f64::from(a) * f64::from(b))
            .sum::<f64>()
            / length as f64
    };
    let mean: [f64; 3] = std::array::from_fn(|colour| {
        planes[colour].iter().copied().map(f64::from).sum::<f64>() / length as f64
    });
    let square = std::array::from_fn(|colour| mean_product(colour, colour));
    let product = [mean_product(0, 1), mean_product(0, 2), mean_product(1, 2)];
    whitening(mean, square, product)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::keystream::{Purpose, keystream};
    use rand_distr::{Distribution, StandardNormal};

    /// Six planes of correlated colours.
    fn codes(pixels: usize, seed: u64) -> Vec<f32> {
        let mut rng = keystream(seed, Purpose::Noise, 0);
        let mut planes = vec![0.0; CHANNELS * pixels];
        for view in 0..2 {
            for pixel in 0..pixels {
                let common: f32 = StandardNormal.sample(&mut rng);
                for colour in 0..3 {
                    let own: f32 = StandardNormal.sample(&mut rng);
                    planes[(3 * view + colour) * pixels + pixel] =
                        0.4 + 0.2 * common + 0.03 * (colour as f32 + 1.0) * own;
                }
            }
        }
        planes
    }

    fn covariance(planes: &[f32], one: usize, other: usize, pixels: usize) -> f64 {
        let plane = |channel: usize| &planes[channel * pixels..][..pixels];
        let mean = |plane: &[f32]| plane.iter().map(|&v| f64::from(v)).sum::<f64>() / pixels as f64;
        let (a, b) = (plane(one), plane(other));
        let (mean_a, mean_b) = (mean(a), mean(b));
        let products = a.iter().zip(b);
        let sum: f64 = products
            .map(|(&a, &b)| (f64::from(a) - mean_a) * (f64::from(b) - mean_b))
            .sum();
        sum / pixels as f64
    }

    #[test]
    fn whitened_colours_are_uncorrelated_and_of_variance_1() {
        let pixels = 4000;
        let mut planes = codes(pixels, 1);
        assert!(covariance(&planes, 0, 1, pixels) > 0.03);
        let by_image = {
            let mut planes = planes.clone();
            Normalisation::WhitenedByImage.apply(&mut planes);
            planes
        };
        let whitening = Moments::of(&planes).whitening();
        Normalisation::Whitened(whitening.clone()).apply(&mut planes);
        for planes in [&planes, &by_image] {
            for view in [0, 3] {
                for (one, other) in [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)] {
                    let expected = if one == other { 1.0 } else { 0.0 };
                    let found = covariance(planes, view + one, view + other, pixels);
                    // One whitening serves both views, whose samples differ.
                    assert!((found - expected).abs() < 0.1, "{found} is not {expected}");
                }
            }
        }
        for row in 0..3 {
            for column in 0..3 {
                let difference = whitening.matrix[row][column] - whitening.matrix[column][row];
                assert!(difference.abs() < 1e-3, "ZCA is symmetric");
            }
        }
    }

    #[test]
    fn channels_get_mean_0_and_variance_1_and_one_colour_stays_finite() {
        let pixels = 500;
        let mut planes = codes(pixels, 2);
        let mut halves = Moments::of(&planes);
        halves.add(&Moments::of(&planes));
        assert_eq!(halves.channels(), Moments::of(&planes).channels());
        Moments::of(&planes).channels().apply(&mut planes);
        for channel in 0..CHANNELS {
            let variance = covariance(&planes, channel, channel, pixels);
            assert!((variance - 1.0).abs() < 1e-3, "{variance}");
        }
        let mut grey = vec![0.5; CHANNELS * 16];
        Normalisation::WhitenedByImage.apply(&mut grey);
        assert!(grey.iter().all(|value| value.is_finite()));
    }
}
