//! A manifest against the store that it describes: every row as the store has it.

use super::read::{ReadError, read};
use crate::selection::with_brightness;
use dataset::manifest::Row;
use datastore::ReadOnlyStore;
use serde::Serialize;
use std::{collections::HashSet, fmt, path::Path};

/// A row that is not the store's.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct RowFault {
    /// The row's number, counted from 1 without the line of names.
    pub row: u64,
    /// The material's index, as the row says.
    pub material: u32,
    /// The view's index, as the row says.
    pub view: u32,
    /// The first column that differs, where one does.
    pub column: Option<&'static str>,
    /// What is wrong.
    pub what: String,
}

impl fmt::Display for RowFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            row,
            material,
            view,
            what,
            ..
        } = self;
        write!(f, "row {row}, material {material}, view {view}: {what}")
    }
}

/// Compares the rows of a manifest with those that the store would write; where an image is kept is
/// left out. Rows that are absent are no fault: a manifest may be of a part.
///
/// # Errors
/// When the manifest cannot be read, or an image's record cannot.
pub fn check_manifest(store: &ReadOnlyStore, path: &Path) -> Result<Vec<RowFault>, ReadError> {
    let specification = store.specification();
    let hash = store.specification_hash();
    let mut seen = HashSet::new();
    let mut faults = Vec::new();
    read::<ReadError>(path, |number, row| {
        let (material, view) = row.image();
        let mut fault = |column, what| {
            faults.push(RowFault {
                row: number,
                material,
                view,
                column,
                what,
            });
        };
        if !seen.insert((material, view)) {
            fault(None, "the image is in the manifest before".to_owned());
            return Ok(());
        }
        let completion = store.completion(material).map_err(ReadError::from)?;
        let views = completion.as_ref().map(|completion| &completion.views);
        let done = views.and_then(|views| views.get(view as usize));
        let exists = (view as usize) < specification.views.len();
        let Some(done) = done.filter(|_| exists) else {
            fault(None, "the store has no such image".to_owned());
            return Ok(());
        };
        let done = match with_brightness(store, view, done) {
            Ok(done) => done,
            Err(error) => {
                fault(None, format!("its brightness cannot be compared: {error}"));
                return Ok(());
            }
        };
        let sampled = specification.material(material);
        let expected = Row::new(specification, hash, &sampled, view, &done);
        if let Some(column) = row.first_difference(&expected) {
            let value = |row: &Row| {
                let value = row.value(column.name);
                value.map_or_else(String::new, ToString::to_string)
            };
            let what = format!(
                "{} is {}, and has to be {}",
                column.name,
                value(&row),
                value(&expected)
            );
            fault(Some(column.name), what);
        }
        Ok(())
    })?;
    Ok(faults)
}
