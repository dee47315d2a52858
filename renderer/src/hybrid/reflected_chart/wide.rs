//! The chart off a wide lobe, one that is not glossy: a product rule over
//! the patches.

use super::gather;
use super::integrals::{Integrals, Integrand, LightBatch};
use super::lit_chart::{Missed, RadiantChart};
use super::window::Window;
use crate::film::demand::FunctionError;
use crate::film::tiling::Shade;
use crate::hybrid::view::View;
use crate::numerics::channels::largest_difference;
use crate::numerics::instructions::Instructions;
use crate::numerics::polygon::Rectangle;
use crate::numerics::tolerance::Tolerance;
use crate::reflectance::{Reflectance, fresnel};
use crate::vector::Vec3;
use std::f64::consts::FRAC_1_PI;

/// The chart off a wide lobe.
pub struct ChartOffWideLobe<'a, const NODES: usize> {
    pub view: &'a View,
    pub chart: &'a RadiantChart<NODES>,
    /// What its polynomials miss.
    pub missed: Missed<&'a RadiantChart<NODES>>,
    pub reflectance: &'a Reflectance,
    /// What the light on the chart may be off by.
    pub function_error: FunctionError,
}

impl<const NODES: usize> Shade for ChartOffWideLobe<'_, NODES> {
    type Scratch = LightBatch;

    fn at(
        &self,
        scratch: &mut LightBatch,
        film_point: [f64; 2],
        tolerance: Tolerance,
    ) -> ([f64; 3], u32) {
        self.off(self.chart, scratch, film_point, tolerance)
    }

    fn function_error(&self, _cell: &Rectangle) -> FunctionError {
        self.function_error
    }

    fn light_error(
        &self,
        scratch: &mut LightBatch,
        film_point: [f64; 2],
        tolerance: Tolerance,
    ) -> (f64, u32) {
        let finer = match self.missed {
            Missed::AtMost(missed) => return (missed, 0),
            Missed::Against(finer) => finer,
        };
        let [(coarse, first), (fine, second)] =
            [self.chart, finer].map(|chart| self.off(chart, scratch, film_point, tolerance));
        (largest_difference(coarse, fine), first + second)
    }
}

impl<const NODES: usize> ChartOffWideLobe<'_, NODES> {
    fn off(
        &self,
        chart: &RadiantChart<NODES>,
        scratch: &mut LightBatch,
        film_point: [f64; 2],
        tolerance: Tolerance,
    ) -> ([f64; 3], u32) {
        let (position, wo) = self.view.sample_point(film_point);
        let instructions = self.view.instructions;
        reflected(
            chart,
            position,
            wo,
            self.reflectance,
            tolerance,
            instructions,
            scratch,
        )
    }
}

/// The chart's light off the sample at `position` toward `wo` (unit, the world's frame), in
/// units of white, and how many evaluations it took; for a wide lobe.
fn reflected<const NODES: usize>(
    chart: &RadiantChart<NODES>,
    position: Vec3,
    wo: Vec3,
    reflectance: &Reflectance,
    tolerance: Tolerance,
    instructions: Instructions,
    batch: &mut LightBatch,
) -> ([f64; 3], u32) {
    let window = Window::new(position, wo, reflectance, &chart.plane, tolerance);
    let response = reflectance.tint_response(wo.z);
    // min(1, cos_i/cos_o) bends, and so does the tint at its knee.
    let [first, second] = fresnel::cosines(response.knee, reflectance.ior);
    let levels = [wo.z, first, second];
    let integrand = Integrand {
        wo,
        lobe: &reflectance.lobe,
        ior: reflectance.ior,
        knee: response.knee,
        instructions,
    };
    let mut integrals = Integrals::new(integrand, batch);
    gather::directions(
        instructions,
        chart,
        position,
        levels,
        &window,
        tolerance,
        &mut integrals,
    );
    let ([fresnel, excess, diffuse], evaluations) = integrals.finish();
    let lobe = &reflectance.lobe;
    let share = reflectance.specular_share;
    let specular = share * 0.25 * FRAC_1_PI * lobe.normalization;
    let lambert = (1.0 - share) * FRAC_1_PI;
    let radiance = std::array::from_fn(|channel| {
        let tinted = response.at_moments(fresnel[channel], excess[channel])[channel];
        specular * tinted + lambert * reflectance.rgb0[channel] * diffuse[channel]
    });
    (radiance, evaluations)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::BackendChoice;
    use crate::hybrid::PreparedView;
    use crate::hybrid::reflected_chart::lit_chart::{LitChart, QUARTIC};
    use crate::scene::Scene;
    use dataset::{Material, Specification};
    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::{Rng, SeedableRng};

    /// A lobe that is narrow along one axis alone grows narrower away from the direction of perfect reflection. A rule
    /// that knew only its width there missed up to 1.4 percent of the light in whole patches, however many digits
    /// were asked for.
    #[test]
    fn a_ridge_has_the_same_light_from_whole_patches_and_from_parts() {
        let specification = Specification::preset();
        let mut random = ChaCha8Rng::seed_from_u64(20_261_127);
        let mut between = |low: f64, high: f64| {
            let uniform = (random.next_u64() >> 11) as f64 / (1u64 << 53) as f64;
            low + uniform * (high - low)
        };
        let mut lit = 0;
        for draw in 0..90 {
            let view = draw % 6;
            let scene = Scene::new(&specification, view, BackendChoice::Native)
                .expect("a backend")
                .expect("a scene");
            let material = Material {
                // Exponents from 1,300 to 10,000, and below 30.
                roughness: between(4.6, 9.0),
                anisotropy: between(0.7, 1.0),
                angle_deg: between(0.0, 180.0),
                // At 1 grazing light alone is reflected.
                ior: if draw % 2 == 0 {
                    1.0
                } else {
                    between(1.0, 10.0)
                },
                ..specification.material(7).material
            };
            let rotation = specification.views[view].rotation_deg;
            let reflectance = Reflectance::new(&material, rotation, specification.tint);
            let PreparedView { view, chart } =
                PreparedView::new(&scene, &specification).expect("a view for hybrid");
            let chart = chart.expect("the chart shows");
            let tolerance = view.budget.wide_rule.finer();
            let [whole, parts] = [1, 8]
                .map(|parts| LitChart::<QUARTIC>::new(&chart, 0.01, parts, |_| [1.0; 3]).into());
            let mut pairs = Vec::new();
            while pairs.len() < 20 {
                let (position, wo) = view.sample_point([between(0.0, 128.0), between(0.0, 128.0)]);
                if position.x.abs().max(position.y.abs()) > view.sample_half || wo.z <= 0.0 {
                    continue;
                }
                pairs.push([&whole, &parts].map(|chart| {
                    let batch = &mut LightBatch::default();
                    let instructions = view.instructions;
                    reflected(
                        chart,
                        position,
                        wo,
                        &reflectance,
                        tolerance,
                        instructions,
                        batch,
                    )
                    .0
                }));
            }
            let largest = pairs
                .iter()
                .flatten()
                .flatten()
                .fold(0.0f64, |a, b| a.max(*b));
            lit += usize::from(largest > 0.0);
            for [whole, parts] in pairs {
                let off = largest_difference(whole, parts);
                assert!(off <= 3e-4 * largest, "draw {draw}: {off} {material:?}");
            }
        }
        assert!(lit > 60, "{lit}");
    }

    /// Where chart and sample touch, the angles of the chart's far ends are those of nearly nothing. A ridge's
    /// intervals were once cut into parts by those angles. The work of a point grew like the inverse root of its
    /// distance, and so did its memory: an image ran out of 24 GB.
    #[test]
    fn a_ridge_beside_the_chart_takes_bounded_work() {
        const EVALUATIONS_MAX: u32 = 200_000;
        let mut specification = Specification::preset();
        specification.checker.lower_edge_y_m = 0.5 * specification.sample.side_m;
        specification.views.truncate(1);
        specification.views[0].camera_elevation_deg = 75.0;
        specification.views[0].light_elevation_deg = 85.0;
        let scene = Scene::new(&specification, 0, BackendChoice::Native)
            .expect("a backend")
            .expect("a scene");
        let PreparedView { view, chart } =
            PreparedView::new(&scene, &specification).expect("a view for hybrid");
        let chart = chart.expect("the chart shows");
        let chart = LitChart::<QUARTIC>::new(&chart, 0.01, 1, |_| [1.0; 3]).into();
        for draw in 0..12 {
            let draw = f64::from(draw);
            let material = Material {
                roughness: 5.0 + 0.2 * draw,
                anisotropy: 0.7 + 0.02 * draw,
                angle_deg: 15.0 * draw,
                ..specification.material(7).material
            };
            let reflectance = Reflectance::new(&material, 0.0, specification.tint);
            for digits in 3..19 {
                let y = view.sample_half - libm::exp10(-f64::from(digits));
                let position = Vec3::new(0.002 * draw, y, 0.0);
                let wo = (scene.camera.position - position).normalized();
                let batch = &mut LightBatch::default();
                let tolerance = view.budget.wide_rule.finer().finer();
                let (light, evaluations) = reflected(
                    &chart,
                    position,
                    wo,
                    &reflectance,
                    tolerance,
                    view.instructions,
                    batch,
                );
                assert!(
                    evaluations < EVALUATIONS_MAX,
                    "1e-{digits} m off, {material:?}: {evaluations}"
                );
                assert!(
                    light.into_iter().all(f64::is_finite),
                    "1e-{digits} m off: {light:?}"
                );
            }
        }
    }
}
