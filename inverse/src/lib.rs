//! Inverse rendering over [`renderer`]: which material made these images, and how well they tell.
//!
//! The renderer is exact, so a material can be found by least squares on its pixels. Everything
//! here works on the ten parameters as fractions of their ranges ([`Theta`]) and on pixels under an
//! [`Encoding`].
//!
//! | module | what |
//! | --- | --- |
//! | [`parameters`] | a material as ten numbers in 0 to 1 |
//! | [`encoding`] | linear, logarithmic and sRGB-coded pixels |
//! | [`derivatives`] | every pixel of a view by the ten parameters, with stated errors |
//! | [`information`] | what views tell about parameters; Cramer-Rao bounds; observable weights |
//! | [`survey`] | the same for many materials, on a small film |
//! | [`observation`] | images to be explained |
//! | [`nuisance`] | light, camera and exposure, where they are known only roughly |
//! | [`gauge`] | colours where only their hue shows |
//! | [`refine`] | Levenberg and Marquardt's method over the renderer |

pub mod derivatives;
pub mod encoding;
mod error;
mod fit;
pub mod gauge;
pub mod information;
mod least_squares;
mod model;
pub mod nuisance;
pub mod observation;
pub mod parameters;
pub mod refine;
mod settings;
mod steps;
pub mod survey;

pub use derivatives::{Differentiator, ViewDerivatives};
pub use encoding::Encoding;
pub use error::InverseError;
pub use information::Information;
pub use nuisance::{NuisanceValues, Nuisances};
pub use observation::{Observation, ObservedView};
pub use parameters::{NAMES, PARAMETERS, Theta};
pub use refine::{Refined, Refiner};
pub use settings::{Settings, Stop};
pub use survey::Survey;
