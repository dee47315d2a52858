//! What a dataset is: its specification, parameter space, sampling, views, labels, splits, colour
//! and manifest rows. No I/O beyond the formats of its own types, no async, no Embree.
//!
//! Everything here is a pure function of a [`Specification`] and of indices, and gives the same
//! bits on every machine: floating-point arithmetic is `+ - * / sqrt` and `libm`'s functions.
//!
//! | module | what |
//! | --- | --- |
//! | [`specification`] | reading, checking, writing and hashing what decides a dataset |
//! | [`keystream`] | randomness by seed, purpose and place |
//! | [`sobol`] | the ten coordinates of a material: an Owen-scrambled Sobol sequence |
//! | [`colour`] | sRGB, linear Rec.709, CIELAB, and the bins that parameters are classified into |
//! | [`view`] | where camera and bulb stand; the map from the film to the sample |
//! | [`manifest`] | one row for an image, column by column |

pub mod colour;
pub mod condition;
mod digest;
mod hard_cases;
mod image_file;
mod image_label;
mod index_list;
pub mod keystream;
pub mod manifest;
mod masks;
mod material;
mod mesh_on_film;
mod pixel_statistics;
mod sample_on_film;
mod sampling;
pub mod sobol;
pub mod specification;
mod split;
pub mod view;

pub use digest::{Digest, ParseDigestError};
pub use hard_cases::{HARD_CASES, HardCase};
pub use image_file::{
    IMAGE_BLOCK_LINES, IMAGE_FILE_TEXT_OVERHEAD, IMAGE_SOFTWARE, REC709_CHROMATICITIES,
    image_file_bytes_max, image_file_header, image_file_start, image_line_bytes,
};
pub use image_label::{ErrorStatistics, IMAGE_HEADER_ATTRIBUTE, ImageHeader, RENDERER_VERSION};
pub use index_list::{IndexList, IndexListError};
pub use manifest::{CompletedView, blob_path};
pub use material::{HUE_ALONE_TO_PERCENT, Material, MaterialError, ReadMaterialError};
pub use pixel_statistics::{DARK_BELOW, LUMINANCE_WEIGHTS, PixelStatistics};
pub use sampling::SampledMaterial;
pub use specification::{Specification, SpecificationError};
pub use split::Split;
pub use view::{ViewGeometry, sin_cos_deg};
