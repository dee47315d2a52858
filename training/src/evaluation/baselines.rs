//! Estimators that learn nothing: a network that does no better has learned nothing either.

use super::Estimates;
use crate::data::Pairs;
use crate::fit::inputs::Codes;
use crate::labels::PARAMETERS;
use crate::labels::axes::{Colours, PSI};
use crate::pixels::encoding::Encoding;
use crate::pixels::noise::Noise;
use dataset::Split;
use rayon::prelude::*;

/// The encoding that images are compared in: highlights tell.
const ENCODING: Encoding = Encoding::Log;

/// The median of every label of the training split, whatever the photographs show; psi has no
/// median, so the middle of its range.
pub fn guess(pairs: &Pairs, positions: &[usize]) -> Estimates {
    let colours = Colours::Lab;
    let values: Vec<[f64; PARAMETERS]> = pairs
        .positions(Split::Train)
        .into_iter()
        .map(|position| colours.values(&pairs.labels[position].material))
        .collect();
    let median: [f64; PARAMETERS] = std::array::from_fn(|parameter| {
        if parameter == PSI {
            let [low, high] = colours.axes()[PSI].range;
            return (low + high) / 2.0;
        }
        let mut values: Vec<f64> = values.iter().map(|values| values[parameter]).collect();
        values.sort_by(f64::total_cmp);
        values.get(values.len() / 2).copied().unwrap_or_default()
    });
    Estimates {
        name: "guess".to_owned(),
        materials: vec![colours.material(&median); positions.len()],
    }
}

/// The training material whose pair of photographs is nearest: the least sum of squared differences
/// of logarithmic codes. The training materials' have no noise.
pub fn nearest(pairs: &Pairs, positions: &[usize], noise: Noise) -> Estimates {
    let codes = Codes::new(pairs, ENCODING);
    let training = pairs.positions(Split::Train);
    let rows: Vec<Vec<f32>> = training
        .par_iter()
        .map(|&p| codes.row(p, Noise::Exact))
        .collect();
    let nearest = positions.par_iter().map(|&position| {
        let wanted = codes.row(position, noise);
        let (mut best, mut least) = (0, f32::INFINITY);
        for (place, row) in rows.iter().enumerate() {
            let distance = distance(&wanted, row);
            if distance < least {
                (best, least) = (place, distance);
            }
        }
        pairs.labels[training[best]].material
    });
    Estimates {
        name: "nearest".to_owned(),
        materials: nearest.collect(),
    }
}

/// The sum of squared differences, in eight sums that the compiler keeps in one register.
fn distance(one: &[f32], other: &[f32]) -> f32 {
    let mut sums = [0.0_f32; 8];
    let (ones, others) = (one.chunks_exact(8), other.chunks_exact(8));
    let rest = ones.remainder().iter().zip(others.remainder());
    let rest: f32 = rest.map(|(a, b)| (a - b) * (a - b)).sum();
    for (a, b) in ones.zip(others) {
        for lane in 0..8 {
            let difference = a[lane] - b[lane];
            sums[lane] += difference * difference;
        }
    }
    sums.iter().sum::<f32>() + rest
}
