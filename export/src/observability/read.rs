//! A table read again.

use super::{ENTRIES, PARAMETERS, table::PLAN_KEY};
use crate::manifest::read::{ReadError, each_batch, read_metadata};
use arrow_array::{Array, FixedSizeListArray, Float64Array, ListArray, RecordBatch, UInt32Array};
use dataset::Digest;
use serde::Deserialize;
use std::collections::BTreeMap;
use std::path::Path;

/// What a table says of one set of views under one encoding.
#[derive(Clone, Debug, PartialEq)]
pub struct Observed {
    /// Digest of what follows and of the table's plan: two tables of one name say the same.
    pub digest: Digest,
    /// Hash of the specification of the dataset.
    pub specification: String,
    /// The renderer's version.
    pub renderer_version: String,
    /// The noise that the bounds are for: its standard deviation in each encoded channel.
    pub noise_sd: f64,
    /// By the material's index.
    pub materials: BTreeMap<u32, ObservedMaterial>,
}

/// What the images tell about one material.
#[derive(Clone, Debug, PartialEq)]
pub struct ObservedMaterial {
    /// J'J for noise of unit variance, row by row.
    pub information: [f64; ENTRIES],
    /// Cramer-Rao bounds in ranges of the parameters; infinite where nothing observes one.
    pub bound: [f64; PARAMETERS],
}

impl Observed {
    /// The same with bounds for noise of another standard deviation, above 0, which they are
    /// proportional to.
    #[must_use]
    pub fn at_noise(mut self, noise_sd: f64) -> Self {
        let factor = noise_sd / self.noise_sd;
        for material in self.materials.values_mut() {
            material.bound = material.bound.map(|bound| factor * bound);
        }
        self.noise_sd = noise_sd;
        self
    }
}

/// What is read of the plan.
#[derive(Deserialize)]
struct Plan {
    specification: String,
    renderer_version: String,
    noise_sd: f64,
}

/// Reads the rows of a set of views, in any order, under one encoding.
///
/// # Errors
/// When the file is no table of observability, has no such set, or a number is missing or not what
/// it may be.
pub fn read(path: &Path, views: &[u32], encoding: &str) -> Result<Observed, ReadError> {
    let damaged = |reason: String| ReadError::Damaged {
        path: path.to_owned(),
        reason,
    };
    let no_table = || damaged("it is no table of observability".to_owned());
    let text = read_metadata(path, PLAN_KEY)?.ok_or_else(no_table)?;
    let plan: Plan = serde_json::from_str(&text).map_err(|_| no_table())?;
    let mut views = views.to_vec();
    views.sort_unstable();
    let mut materials = BTreeMap::new();
    each_batch(path, |batch| {
        let rows = rows(batch, &views, encoding).map_err(damaged)?;
        materials.extend(rows);
        Ok::<(), ReadError>(())
    })?;
    if materials.is_empty() {
        return Err(damaged(format!("it has no rows of the views {views:?}")));
    }
    let mut content = text.into_bytes();
    for (index, material) in &materials {
        content.extend(index.to_le_bytes());
        let numbers = material.information.iter().chain(&material.bound);
        content.extend(numbers.flat_map(|number| number.to_le_bytes()));
    }
    Ok(Observed {
        digest: Digest::of(&content),
        specification: plan.specification,
        renderer_version: plan.renderer_version,
        noise_sd: plan.noise_sd,
        materials,
    })
}

fn rows(
    batch: &RecordBatch,
    views: &[u32],
    encoding: &str,
) -> Result<Vec<(u32, ObservedMaterial)>, String> {
    let indices = column::<UInt32Array>(batch, "material_index")?;
    let sets = column::<ListArray>(batch, "views")?;
    let information = column::<FixedSizeListArray>(batch, &format!("information_{encoding}"))?;
    let bounds = column::<FixedSizeListArray>(batch, &format!("bound_{encoding}"))?;
    let mut rows = Vec::new();
    for place in 0..batch.num_rows() {
        let set = sets.value(place);
        let set = set.as_any().downcast_ref::<UInt32Array>();
        if set.is_none_or(|set| set.values().iter().ne(views)) {
            continue;
        }
        let index = indices.value(place);
        let unsound = |what: &str| format!("the {what} of material {index} is none");
        let found = numbers::<ENTRIES>(information, place);
        let found = found.filter(|numbers| numbers.iter().all(|number| number.is_finite()));
        let bound = numbers::<PARAMETERS>(bounds, place);
        let bound = bound.filter(|bounds| bounds.iter().all(|bound| *bound > 0.0));
        let observed = ObservedMaterial {
            information: found.ok_or_else(|| unsound("information"))?,
            bound: bound.ok_or_else(|| unsound("bound"))?,
        };
        rows.push((index, observed));
    }
    Ok(rows)
}

fn column<'a, T: Array + 'static>(batch: &'a RecordBatch, name: &str) -> Result<&'a T, String> {
    let array = batch.column_by_name(name);
    let array = array.and_then(|array| array.as_any().downcast_ref::<T>());
    let array = array.filter(|array| array.null_count() == 0);
    array.ok_or_else(|| format!("the column {name} is missing or of another type"))
}

fn numbers<const N: usize>(lists: &FixedSizeListArray, place: usize) -> Option<[f64; N]> {
    let list = lists.value(place);
    let list = list.as_any().downcast_ref::<Float64Array>()?;
    <[f64; N]>::try_from(list.values().as_ref()).ok()
}
