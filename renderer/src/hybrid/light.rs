//! The light toward the camera from a point of the film, by how it came.

use super::Stage;
use super::bulb::{self, BulbView, ScaledRadiance, SlopeBatch};
use super::chart::{LightBatch, LitChart};
use super::glossy::{self, GlossyChart};
use super::interreflection::Interreflection;
use super::log_tiling::TintedLog;
use super::panel::PanelOnFilm;
use super::pixel::largest_difference;
use super::slopes::Fineness;
use super::tiling::Shade;
use crate::reflectance::Reflectance;
use crate::vector::Vec3;

/// The chart itself, but for the reflectance of its patches.
pub struct ChartItself<'a> {
    pub stage: &'a Stage,
    pub panel: &'a PanelOnFilm,
    pub interreflection: &'a Interreflection,
}

impl Shade for ChartItself<'_> {
    type Scratch = ();

    fn at(&self, (): &mut (), [column, row]: [f64; 2], _: Fineness) -> ([f64; 3], u32) {
        let ray = self.stage.camera.ray(column, row);
        let panel = &self.panel.panel;
        // Nodes of a tile can lie beyond the panel's vanishing line.
        let at = panel.meet(ray.origin, ray.direction).unwrap_or([0.0; 2]);
        let direct = self.stage.bulb_on_chart(self.panel, at);
        let indirect = self.interreflection.on_chart(at);
        (indirect.map(|channel| channel + direct), 0)
    }
}

/// The chart in the sample.
pub struct ChartOffSample<'a> {
    pub stage: &'a Stage,
    pub chart: &'a LitChart,
    /// The same in smaller parts, which tells what its parabolas miss.
    pub finer: &'a LitChart,
    pub reflectance: &'a Reflectance,
}

impl Shade for ChartOffSample<'_> {
    type Scratch = LightBatch;

    fn at(&self, scratch: &mut LightBatch, place: [f64; 2], fineness: Fineness) -> ([f64; 3], u32) {
        self.off(self.chart, scratch, place, fineness)
    }

    fn light_error(
        &self,
        scratch: &mut LightBatch,
        place: [f64; 2],
        fineness: Fineness,
    ) -> (f64, u32) {
        let [(coarse, first), (fine, second)] =
            [self.chart, self.finer].map(|chart| self.off(chart, scratch, place, fineness));
        (largest_difference(coarse, fine), first + second)
    }
}

impl ChartOffSample<'_> {
    fn off(
        &self,
        chart: &LitChart,
        scratch: &mut LightBatch,
        place: [f64; 2],
        fineness: Fineness,
    ) -> ([f64; 3], u32) {
        let (position, wo) = self.stage.sample_point(place);
        let instructions = self.stage.instructions;
        chart.reflected(
            position,
            wo,
            self.reflectance,
            fineness,
            instructions,
            scratch,
        )
    }
}

/// The chart in a sample of a narrow lobe.
pub struct ChartOffGlossySample<'a> {
    pub stage: &'a Stage,
    pub glossy: &'a GlossyChart<'a>,
    /// The same with the chart in smaller parts.
    pub finer: &'a GlossyChart<'a>,
}

impl Shade for ChartOffGlossySample<'_> {
    type Scratch = glossy::Scratch;

    fn at(
        &self,
        scratch: &mut glossy::Scratch,
        place: [f64; 2],
        fineness: Fineness,
    ) -> ([f64; 3], u32) {
        let (position, wo) = self.stage.sample_point(place);
        self.glossy.reflected(position, wo, fineness, scratch)
    }

    fn light_error(
        &self,
        scratch: &mut glossy::Scratch,
        place: [f64; 2],
        fineness: Fineness,
    ) -> (f64, u32) {
        let (position, wo) = self.stage.sample_point(place);
        let [(coarse, first), (fine, second)] = [self.glossy, self.finer]
            .map(|glossy| glossy.reflected(position, wo, fineness, scratch));
        (largest_difference(coarse, fine), first + second)
    }
}

impl Stage {
    /// The point of the sample's plane on the film, and the direction to the camera from it.
    pub(super) fn sample_point(&self, [column, row]: [f64; 2]) -> (Vec3, Vec3) {
        let ray = self.camera.ray(column, row);
        let mut position = ray.at(-ray.origin.z / ray.direction.z);
        position.z = 0.0;
        (position, -ray.direction)
    }

    /// The bulb's light off the sample at `position` toward `wo`, and evaluations spent.
    pub(super) fn bulb_off_sample(
        &self,
        position: Vec3,
        wo: Vec3,
        reflectance: &Reflectance,
        fineness: Fineness,
        batch: &mut SlopeBatch,
    ) -> ([f64; 3], u32) {
        let (light, spent) = self.bulb_off_sample_log(position, wo, reflectance, fineness, batch);
        let scale = libm::exp(light.log);
        (light.tint.map(|channel| scale * channel), spent)
    }

    /// The same by its logarithm.
    pub(super) fn bulb_off_sample_log(
        &self,
        position: Vec3,
        wo: Vec3,
        reflectance: &Reflectance,
        fineness: Fineness,
        batch: &mut SlopeBatch,
    ) -> (TintedLog, u32) {
        let view = self.bulb_view(position, wo, reflectance);
        let share = reflectance.specular_share;
        // The bulb stands above the horizon as a whole: its Lambertian light is a closed form.
        let diffuse = (1.0 - share) * view.sin2 * view.centre.z;
        let (specular, spent) = if share > 0.0 {
            let response = reflectance.tint_response(wo.z);
            let instructions = self.instructions;
            bulb::specular(&view, reflectance, &response, fineness, instructions, batch)
        } else {
            (ScaledRadiance::NONE, 0)
        };
        // Where there is diffuse light the lobe is wide, and its logarithm small. Elsewhere the
        // factor may overflow.
        let diffuse = if share < 1.0 {
            diffuse * libm::exp(-specular.log)
        } else {
            0.0
        };
        let untinted = share * specular.untinted + diffuse;
        let tint = std::array::from_fn(|channel| {
            let part = share * specular.radiance[channel] + diffuse * reflectance.rgb0[channel];
            if untinted > 0.0 { part / untinted } else { 0.0 }
        });
        let log = libm::log(untinted.max(f64::MIN_POSITIVE) * self.bulb_radiance) + specular.log;
        (TintedLog { log, tint }, spent)
    }

    /// The bulb and the viewer from a point of the sample.
    pub(super) fn bulb_view(
        &self,
        position: Vec3,
        wo: Vec3,
        reflectance: &Reflectance,
    ) -> BulbView {
        let offset = self.bulb_centre - position;
        let distance = offset.length();
        let sine = self.bulb_radius / distance;
        BulbView {
            wo: reflectance.lobe.to_lobe(wo),
            centre: reflectance.lobe.to_lobe(offset * (1.0 / distance)),
            sin2: sine * sine,
        }
    }

    /// The bulb's irradiance over pi at (a, b) of the chart, in front of which it stands as a whole.
    pub(super) fn bulb_on_chart(&self, panel: &PanelOnFilm, [a, b]: [f64; 2]) -> f64 {
        let offset = self.bulb_centre - panel.panel.point(a, b);
        let distance2 = offset.length_squared();
        let cosine = offset.dot(panel.panel.z) / distance2.sqrt();
        self.bulb_radiance * self.bulb_radius * self.bulb_radius / distance2 * cosine
    }
}
