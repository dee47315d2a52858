//! A chart in a smooth sample, and who looks at it.

use crate::hybrid::reflected_chart::lit_chart::LitChart;
use crate::numerics::instructions::Instructions;
use crate::numerics::polygon::Polygon;
use crate::reflectance::Reflectance;
use crate::scene::PinholeCamera;
use dataset::specification::Accuracy;

/// A smooth sample with the chart in it.
pub struct MirroredChart<'a> {
    /// What is mirrored.
    pub chart: &'a LitChart,
    /// What mirrors it.
    pub reflectance: &'a Reflectance,
    /// From where.
    pub camera: &'a PinholeCamera,
    /// The sample's outline on the film.
    pub outline: &'a Polygon,
    /// The target.
    pub accuracy: &'a Accuracy,
    /// Names the image.
    pub key: u64,
    /// What it is worked out on.
    pub instructions: Instructions,
}
