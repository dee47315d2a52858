//! What can go wrong.

use dataset::{MaterialError, SpecificationError, specification::Shape};
use renderer::RenderError;

/// Why images could not be differentiated or explained.
#[derive(Debug, thiserror::Error)]
pub enum InverseError {
    /// The renderer refused.
    #[error(transparent)]
    Render(#[from] RenderError),
    /// A specification, perhaps changed by nuisance parameters, is out of range.
    #[error(transparent)]
    Specification(#[from] SpecificationError),
    /// A material lies outside the model.
    #[error("the material's {0}")]
    Material(#[from] MaterialError),
    /// The sample is curved.
    #[error(
        "derivatives and refinement are for flat samples: images of a {shape} are traced, and noise hides \
         what a small change of a parameter does"
    )]
    Curved {
        /// The shape.
        shape: Shape,
    },
    /// The view's index is too large.
    #[error("there is no view {view}: the specification has {count}, counted from 0")]
    NoSuchView {
        /// The index asked for.
        view: u32,
        /// How many there are.
        count: usize,
    },
    /// A view is given twice.
    #[error("view {view} is given twice")]
    RepeatedView {
        /// The index.
        view: u32,
    },
    /// No view was given.
    #[error("no view was given; at least one is needed")]
    NoViews,
    /// A set has a view that is not surveyed.
    #[error("view {view} is in a set, but is not among the views surveyed")]
    NotSurveyed {
        /// The view.
        view: u32,
    },
    /// A film's side is out of range.
    #[error("the film's side is {side} pixels, but must be 1 to {most}")]
    Side {
        /// The side.
        side: u32,
        /// The largest.
        most: u32,
    },
    /// No starting material was given.
    #[error("no starting material was given; at least one is needed")]
    NoStarts,
    /// An image has another size than the specification's film.
    #[error(
        "the image of view {view} has {found} pixels, but the film of {width} x {height} has \
         {expected}"
    )]
    ImageSize {
        /// The view.
        view: u32,
        /// The film's width in pixels.
        width: u32,
        /// The film's height in pixels.
        height: u32,
        /// Pixels that the film has.
        expected: usize,
        /// Pixels that the image has.
        found: usize,
    },
    /// No pixel of a view counts.
    #[error("no pixel of view {view} counts")]
    NoPixels {
        /// The view.
        view: u32,
    },
    /// A pixel is NaN or infinite.
    #[error("pixel ({column}, {row}) of view {view} is {value:?}, which is not finite")]
    PixelNotFinite {
        /// The view.
        view: u32,
        /// Counted from the left.
        column: usize,
        /// Counted from the top.
        row: usize,
        /// Its value.
        value: [f64; 3],
    },
    /// A setting makes no sense.
    #[error("{name} is {value}, but must be {rule}")]
    Setting {
        /// The setting.
        name: &'static str,
        /// Its value.
        value: f64,
        /// What it must be.
        rule: &'static str,
    },
    /// The limit on renderings leaves no room for one set of derivatives.
    #[error(
        "renderings_max is {renderings_max}, but one start with its first derivatives takes {needed}"
    )]
    TooFewRenderings {
        /// The limit.
        renderings_max: u32,
        /// What is needed.
        needed: u32,
    },
}

/// Checks a number that must be finite and above 0.
pub(crate) fn check_positive(name: &'static str, value: f64) -> Result<(), InverseError> {
    if value > 0.0 && value.is_finite() {
        return Ok(());
    }
    let rule = "finite and above 0";
    Err(InverseError::Setting { name, value, rule })
}
