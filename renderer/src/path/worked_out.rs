//! The bulb's light off a curved sample and the chart, where all of the bulb is seen: no path has to find
//! it.

use super::Scratch;
use crate::hybrid::direct::BulbLight;
use crate::numerics::{instructions::Instructions, tolerance::Tolerance};
use crate::reflectance::Reflectance;
use crate::scene::{Scene, Surface};
use crate::vector::Vec3;
use dataset::specification::Accuracy;

/// The share of the relative tolerance that the rule over the bulb aims at. A rule's error is a share of
/// the lobe's largest value on the bulb, of which the mean may be a tenth.
const RULE_SHARE: f64 = 0.01;

/// The share of the relative tolerance that is stated for it.
pub const STATED_SHARE: f64 = 0.1;

/// The bulb's light in a view.
#[derive(Debug)]
pub struct WorkedOut<'a> {
    scene: &'a Scene,
    light: BulbLight<'a>,
    /// What is stated of a pixel's error for the rule, as a share of its value.
    pub stated: f64,
}

impl<'a> WorkedOut<'a> {
    /// For a view of a curved sample.
    pub fn new(
        scene: &'a Scene,
        reflectance: &'a Reflectance,
        accuracy: &Accuracy,
        instructions: Instructions,
    ) -> Self {
        let light = BulbLight {
            reflectance,
            radius: scene.bulb.radius,
            radiance: scene.bulb.radiance,
            tolerance: Tolerance::new(RULE_SHARE * accuracy.relative),
            instructions,
        };
        Self {
            scene,
            light,
            stated: STATED_SHARE * accuracy.relative,
        }
    }

    /// The bulb's light off a surface toward `wo`, in the frame of the surface. `None` on the sample
    /// where the horizon cuts the bulb and where the chart may stand before it, and after the first of
    /// a path's surfaces, where it is not worth the time.
    pub fn toward(
        &self,
        surface: &Surface,
        wo: Vec3,
        bounce: u32,
        scratch: &mut Scratch,
    ) -> Option<[f64; 3]> {
        let to_bulb = surface
            .frame
            .to_local(self.scene.bulb.centre - surface.position);
        if to_bulb.z < self.light.radius {
            return None;
        }
        if let Some(colour) = surface.patch {
            // A curved sample is below the chart's lower edge and so before no part of the bulb.
            let distance2 = to_bulb.length_squared();
            let sine2 = self.light.radius * self.light.radius / distance2;
            let light = self.light.radiance * sine2 * to_bulb.z / distance2.sqrt();
            return Some(colour.map(|channel| light * channel));
        }
        if bounce > 0 || self.is_behind_chart(surface.position) {
            return None;
        }
        let (light, spent) = self.light.toward(wo, to_bulb, &mut scratch.batch);
        scratch.evaluations += u64::from(spent);
        let scale = libm::exp(light.log);
        Some(light.tint.map(|channel| scale * channel))
    }

    /// The bulb is in front of the chart's plane: what is too, sees it past the chart.
    fn is_behind_chart(&self, position: Vec3) -> bool {
        let Some(chart) = &self.scene.chart else {
            return false;
        };
        let plane = chart.plane();
        plane.z.dot(position - plane.corner) < 0.0
    }
}
