//! How far an estimate is from the truth: its images, and its parameters.
//!
//! | module | what |
//! | --- | --- |
//! | [`rerender`] | images of materials at a low cost, and how far two differ |
//! | [`baselines`] | estimators that learn nothing |
//! | [`refined`] | the estimator that renders |
//! | [`bounds`] | how far an estimator is from what any can reach |
//! | [`statistics`] | quantiles, and intervals by the bootstrap |
//! | [`paired`] | estimators compared pair by pair |
//! | [`tables`] | what was found, as CSV and as a summary |
//! | [`box_plot`], [`over_bound`], [`page`] | and to look at |

pub mod baselines;
pub mod bounds;
pub mod box_plot;
pub mod over_bound;
pub mod page;
pub mod paired;
pub mod refined;
pub mod rerender;
pub mod statistics;
pub mod tables;

use crate::data::Pairs;
use crate::error::TrainingError;
use dataset::Material;
use rayon::prelude::*;
use rerender::{ImageError, Rerenderer};
use std::sync::atomic::{AtomicU64, Ordering};

/// What an estimator said of the materials that it is judged on.
#[derive(Clone, Debug)]
pub struct Estimates {
    /// The estimator's name.
    pub name: String,
    /// One a material, in the order of the positions.
    pub materials: Vec<Material>,
}

/// What one estimate of one material is off by.
#[derive(Clone, Debug, PartialEq)]
pub struct Judged {
    /// The material's index in the dataset.
    pub index: u32,
    /// What was estimated.
    pub estimate: Material,
    /// The truth.
    pub truth: Material,
    /// By view of the specification.
    pub views: Vec<ImageError>,
}

/// Renders every estimate and its truth in all views and compares them. `tell` hears how many
/// materials are done.
///
/// # Errors
/// When the renderer refuses a material.
pub fn judge(
    pairs: &Pairs,
    positions: &[usize],
    all: &[Estimates],
    rerenderer: &Rerenderer,
    tell: &(dyn Fn(u64) + Sync),
) -> Result<Vec<Vec<Judged>>, TrainingError> {
    let done = AtomicU64::new(0);
    let by_material: Vec<Vec<Judged>> = positions
        .par_iter()
        .enumerate()
        .map(|(place, &position)| {
            let label = &pairs.labels[position];
            let truth = rerenderer.images(&label.material)?;
            let judged = all.iter().map(|estimates| {
                let estimate = estimates.materials[place];
                let images = rerenderer.images(&estimate)?;
                let views = truth.iter().zip(&images);
                Ok(Judged {
                    index: label.index,
                    estimate,
                    truth: label.material,
                    views: views.map(|(one, other)| one.error(other)).collect(),
                })
            });
            let judged = judged.collect::<Result<Vec<Judged>, TrainingError>>();
            tell(done.fetch_add(1, Ordering::Relaxed) + 1);
            judged
        })
        .collect::<Result<_, TrainingError>>()?;
    // By estimator, then by material.
    let mut by_estimator: Vec<Vec<Judged>> = all.iter().map(|_| Vec::new()).collect();
    for judged in by_material {
        for (column, judged) in by_estimator.iter_mut().zip(judged) {
            column.push(judged);
        }
    }
    Ok(by_estimator)
}
