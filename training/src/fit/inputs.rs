//! What networks read, by the position of a material.

use crate::data::Pairs;
use crate::pixels::CHANNELS;
use crate::pixels::encoding::Encoding;
use crate::pixels::noise::Noise;
use crate::pixels::normalisation::{Moments, Normalisation};
use dataset::Split;
use half::f16;
use rayon::prelude::*;

/// Rows of numbers, one a material.
pub trait Inputs: Sync {
    /// Numbers in a row.
    fn width(&self) -> usize;

    /// Writes the row of the material at `position`: as it is, or with the noise of an epoch.
    fn fill(&self, position: usize, epoch: Option<u32>, row: &mut [f32]);

    /// The rows of materials, one behind the other.
    fn rows(&self, positions: &[usize], epoch: Option<u32>) -> Vec<f32> {
        let width = self.width();
        let mut rows = vec![0.0; positions.len() * width];
        rows.par_chunks_exact_mut(width)
            .zip(positions)
            .for_each(|(row, &position)| self.fill(position, epoch, row));
        rows
    }
}

/// Photographs as codes.
pub struct Codes<'a> {
    pairs: &'a Pairs,
    table: Vec<f32>,
    code_max: f32,
}

impl<'a> Codes<'a> {
    /// Of all pairs.
    pub fn new(pairs: &'a Pairs, encoding: Encoding) -> Self {
        Self {
            pairs,
            table: encoding.table(),
            code_max: encoding.code_max(),
        }
    }

    fn fill(&self, position: usize, row: &mut [f32]) {
        for (code, pixel) in row.iter_mut().zip(self.pairs.pixels(position)) {
            *code = self.table[usize::from(pixel.to_bits())];
        }
    }

    /// The codes of the material at a position, with noise.
    pub fn row(&self, position: usize, noise: Noise) -> Vec<f32> {
        let mut row = vec![0.0; CHANNELS * self.pairs.side() * self.pairs.side()];
        self.fill_noisy(position, noise, None, &mut row);
        row
    }

    fn fill_noisy(&self, position: usize, noise: Noise, epoch: Option<u32>, row: &mut [f32]) {
        self.fill(position, row);
        noise.add(row, self.code_max, epoch, self.pairs.labels[position].index);
    }

    /// Sums over the training split.
    pub fn moments(&self) -> Moments {
        let width = CHANNELS * self.pairs.side() * self.pairs.side();
        let each: Vec<Moments> = self
            .pairs
            .positions(Split::Train)
            .into_par_iter()
            .map_init(
                || vec![0.0; width],
                |row, position| {
                    self.fill(position, row);
                    Moments::of(row)
                },
            )
            .collect();
        // In the order of materials, whatever the threads.
        each.iter().fold(Moments::default(), |mut sum, moments| {
            sum.add(moments);
            sum
        })
    }
}

/// Photographs as a CNN reads them: codes, with noise or without, normalised.
pub struct Photographs<'a> {
    /// The codes.
    pub codes: &'a Codes<'a>,
    /// How they are normalised.
    pub normalisation: Normalisation,
    /// The noise.
    pub noise: Noise,
}

impl Inputs for Photographs<'_> {
    fn width(&self) -> usize {
        CHANNELS * self.codes.pairs.side() * self.codes.pairs.side()
    }

    fn fill(&self, position: usize, epoch: Option<u32>, row: &mut [f32]) {
        self.codes.fill_noisy(position, self.noise, epoch, row);
        self.normalisation.apply(row);
    }
}

/// What frozen networks found, one row a material: features as half floats, then probabilities of
/// earlier blocks.
pub struct Features {
    width: usize,
    rows: Vec<f16>,
}

impl Features {
    /// Rows of `width` numbers.
    pub fn new(width: usize, rows: Vec<f16>) -> Self {
        Self { width, rows }
    }

    /// The row of the material at a position.
    pub fn row(&self, position: usize) -> &[f16] {
        &self.rows[position * self.width..][..self.width]
    }
}

/// Several features side by side.
pub struct Joined<'a>(pub Vec<&'a Features>);

impl Inputs for Joined<'_> {
    fn width(&self) -> usize {
        self.0.iter().map(|features| features.width).sum()
    }

    fn fill(&self, position: usize, _epoch: Option<u32>, row: &mut [f32]) {
        let values = self.0.iter().flat_map(|features| features.row(position));
        for (number, value) in row.iter_mut().zip(values) {
            *number = value.to_f32();
        }
    }
}
