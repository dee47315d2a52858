//! The colour chart and the glossy sample that reflects it to a camera.

use crate::hybrid::reflected_chart::lit_chart::LitChart;
use crate::numerics::instructions::Instructions;
use crate::numerics::polygon::Polygon;
use crate::reflectance::Reflectance;
use crate::scene::PinholeCamera;
use dataset::specification::Accuracy;

/// The chart, a glossy sample and the camera that sees the one in the other.
pub struct GlossyChart<'a> {
    /// What is reflected.
    pub chart: &'a LitChart,
    /// What reflects it.
    pub reflectance: &'a Reflectance,
    /// Where it is seen from.
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
