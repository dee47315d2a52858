//! What a table of observability holds.

use super::{ENCODINGS, PARAMETERS};
use dataset::specification::Accuracy;
use dataset::{IndexList, RENDERER_VERSION, Specification};
use serde_json::json;

/// Raised when the numbers of a table change although its options and the renderer are the same.
const TABLE_VERSION: u32 = 1;

/// What a table holds. Tables of equal plans have equal bytes.
#[derive(Clone, Debug)]
pub struct Plan {
    /// The specification of the dataset.
    pub specification: Specification,
    /// The materials, in the order of the rows.
    pub materials: Vec<u32>,
    /// The sets of views of each material's rows, in order: single views too.
    pub sets: Vec<Vec<u32>>,
    /// The parameters' names, in order.
    pub parameters: [&'static str; PARAMETERS],
    /// The encodings' names, in order; columns end in them.
    pub encodings: [&'static str; ENCODINGS],
    /// The film, width and height in pixels.
    pub film: [u32; 2],
    /// The accuracy of the renderings.
    pub accuracy: Accuracy,
    /// The noise that bounds and weights are for: its standard deviation in each encoded channel.
    pub noise_sd: f64,
}

impl Plan {
    /// How many rows the table has.
    pub fn rows(&self) -> u64 {
        self.materials.len() as u64 * self.sets.len() as u64
    }

    /// The plan as JSON: the file's metadata, and what two plans are compared by.
    pub(super) fn description(&self) -> String {
        let Accuracy { absolute, relative } = self.accuracy;
        let description = json!({
            "version": TABLE_VERSION,
            "specification": self.specification.hash().to_string(),
            "renderer_version": RENDERER_VERSION,
            "materials": ranges(&self.materials).to_string(),
            "sets": self.sets,
            "parameters": self.parameters,
            "encodings": self.encodings,
            "side": self.film[0].max(self.film[1]),
            "film": self.film,
            "accuracy": { "absolute": absolute, "relative": relative },
            "noise_sd": self.noise_sd,
        });
        format!("{description:#}\n")
    }
}

/// Indices as a list of ranges.
fn ranges(indices: &[u32]) -> IndexList {
    let runs = indices.chunk_by(|a, b| a.checked_add(1) == Some(*b));
    runs.filter_map(|run| Some(*run.first()?..=*run.last()?))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn materials_are_told_as_ranges() {
        assert_eq!(ranges(&[0, 1, 2, 5, 7, 8]).to_string(), "0-2,5,7-8");
        assert_eq!(ranges(&[u32::MAX]).to_string(), "4294967295");
    }
}
