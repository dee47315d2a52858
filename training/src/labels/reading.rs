//! A distribution over bins as one position, in bins: bin b is at b, its lower end at b - 0.5.

use super::BINS;
use super::target::Smoothing;
use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};
use std::f64::consts::TAU;

/// What is added to the diagonal of the normal equations of [`Reader`], whose matrix is singular to
/// rounding.
const RIDGE: f64 = 1e-3;

/// How a distribution is read.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Reading {
    /// The most probable bin, the lowest of equals.
    Argmax,
    /// The mean position. A target at the end of a range reads 2.1 bins too far inside.
    Mean,
    /// A weighted sum of probabilities whose weights are fitted to read every target's own bin.
    #[default]
    Unbiased,
}

/// Reads distributions over bins; holds the weights of [`Reading::Unbiased`].
#[derive(Clone, Debug)]
pub struct Reader {
    reading: Reading,
    values: Vec<f64>,
}

impl Reader {
    /// A reader of distributions that were trained on targets of this smoothing.
    pub fn new(reading: Reading, smoothing: Smoothing) -> Self {
        Self {
            reading,
            values: unbiased_values(smoothing),
        }
    }

    /// The position that the distribution tells: 0 to 99, for [`Reading::Unbiased`] a little beyond.
    /// On a circle every reading but [`Reading::Argmax`] is the [`circular_mean`].
    pub fn position(&self, distribution: &[f64; BINS], circular: bool) -> f64 {
        match self.reading {
            Reading::Argmax => argmax(distribution) as f64,
            _ if circular => circular_mean(distribution).unwrap_or(argmax(distribution) as f64),
            Reading::Mean => mean(distribution),
            Reading::Unbiased => distribution
                .iter()
                .zip(&self.values)
                .map(|(probability, value)| probability * value)
                .sum(),
        }
    }
}

/// The first of the largest.
pub fn argmax(distribution: &[f64; BINS]) -> usize {
    let mut best = 0;
    for (bin, &probability) in distribution.iter().enumerate() {
        if probability > distribution[best] {
            best = bin;
        }
    }
    best
}

/// sum_j j x_j.
pub fn mean(distribution: &[f64; BINS]) -> f64 {
    let term = |(bin, probability): (usize, &f64)| bin as f64 * probability;
    distribution.iter().enumerate().map(term).sum()
}

/// The resultant of a distribution on a circle: the sum of unit vectors towards the middles of the
/// bins, weighted by probability. Its length is 1 for a single bin and 0 for a distribution without
/// a direction.
pub fn resultant(distribution: &[f64; BINS]) -> [f64; 2] {
    let mut sum = [0.0; 2];
    for (bin, probability) in distribution.iter().enumerate() {
        let (sine, cosine) = libm::sincos(TAU * (bin as f64 + 0.5) / BINS as f64);
        sum[0] += probability * cosine;
        sum[1] += probability * sine;
    }
    sum
}

/// The direction of the [`resultant`], from 0 to 100 bins; `None` where it has none to rounding.
pub fn circular_mean(distribution: &[f64; BINS]) -> Option<f64> {
    let [x, y] = resultant(distribution);
    if libm::hypot(x, y) < 1e-12 {
        return None;
    }
    let turn = libm::atan2(y, x) / TAU;
    Some((turn * BINS as f64 - 0.5).rem_euclid(BINS as f64))
}

/// Values v with v . target(b) near b for every bin b: v = (G'G + ridge I)^-1 (G'c + ridge c), where
/// row b of G is the target of bin b and c_b = b.
fn unbiased_values(smoothing: Smoothing) -> Vec<f64> {
    let rows = DMatrix::from_row_iterator(
        BINS,
        BINS,
        (0..BINS).flat_map(|bin| smoothing.target(bin as f64, false)),
    );
    let bins = DVector::from_iterator(BINS, (0..BINS).map(|bin| bin as f64));
    let normal = rows.transpose() * &rows + DMatrix::identity(BINS, BINS) * RIDGE;
    let right = rows.transpose() * &bins + &bins * RIDGE;
    let Some(factors) = normal.cholesky() else {
        unreachable!("the ridge makes the matrix positive definite");
    };
    factors.solve(&right).as_slice().to_vec()
}
