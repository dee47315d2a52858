//! What images tell about the parameters of materials, as Parquet: a row for each material and set
//! of views.
//!
//! | module | what |
//! | --- | --- |
//! | `plan` | what a table holds, and the description by which it is known again |
//! | `parts` | what is computed so far, a file a material, until the table is whole |
//! | `part` | the bytes of such a file |
//! | `read` | a table read again |
//! | `table` | the columns, and how they are written |
//!
//! The numbers come from whoever computes them: this crate knows neither derivatives nor renderers.

mod part;
mod parts;
mod plan;
mod read;
mod table;

pub use parts::Parts;
pub use plan::Plan;
pub use read::{Observed, ObservedMaterial, read};

/// Parameters of a material.
pub const PARAMETERS: usize = 10;

/// Entries of an information matrix.
pub const ENTRIES: usize = PARAMETERS * PARAMETERS;

/// How many encodings of pixels a row tells of.
pub const ENCODINGS: usize = 3;

/// What the images of a set of views tell about one material.
#[derive(Clone, Debug, PartialEq)]
pub struct Row {
    /// The views' indices.
    pub views: Vec<u32>,
    /// One for each encoding, in the plan's order.
    pub findings: [Finding; ENCODINGS],
}

/// What images under one encoding tell, for each parameter in the plan's order.
#[derive(Clone, Debug, PartialEq)]
pub struct Finding {
    /// The information matrix J'J for noise of unit variance, row by row.
    pub information: [f64; ENTRIES],
    /// Bounds of the norm of the error of each column of J; infinite for one that does not exist.
    pub uncertainty: [f64; PARAMETERS],
    /// Cramer-Rao bounds, in ranges of the parameters; infinite where nothing observes one.
    pub bound: [f64; PARAMETERS],
    /// Observable weights, 0 to 1.
    pub weight: [f64; PARAMETERS],
}
