//! The chart off a wide lobe, one that is not glossy: a product rule over
//! the patches.

use super::gather::{self, LightBatch};
use super::lit_chart::LitChart;
use super::window::Window;
use crate::film::demand::FunctionError;
use crate::film::tiling::Shade;
use crate::hybrid::view::View;
use crate::numerics::batch::{LANES, total};
use crate::numerics::channels::largest_difference;
use crate::numerics::instructions::{Instructions, kernel};
use crate::numerics::polygon::Rectangle;
use crate::numerics::tolerance::Tolerance;
use crate::reflectance::{Reflectance, fresnel, lobe::Lobe, specular};
use crate::vector::Vec3;
use std::f64::consts::FRAC_1_PI;

/// The chart off a wide lobe.
pub struct ChartOffWideLobe<'a> {
    pub view: &'a View,
    pub chart: &'a LitChart,
    /// The same in smaller parts, which tells what its polynomials miss.
    pub finer: &'a LitChart,
    pub reflectance: &'a Reflectance,
    /// What the light on the chart may be off by.
    pub function_error: FunctionError,
}

impl Shade for ChartOffWideLobe<'_> {
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
        let [(coarse, first), (fine, second)] =
            [self.chart, self.finer].map(|chart| self.off(chart, scratch, film_point, tolerance));
        (largest_difference(coarse, fine), first + second)
    }
}

impl ChartOffWideLobe<'_> {
    fn off(
        &self,
        chart: &LitChart,
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
fn reflected(
    chart: &LitChart,
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
    batch.clear();
    let levels = [wo.z, first, second];
    gather::directions(
        instructions,
        chart,
        position,
        levels,
        &window,
        tolerance,
        batch,
    );
    let (lobe, ior) = (&reflectance.lobe, reflectance.ior);
    let [fresnel, excess, diffuse] = integrals(instructions, batch, wo, lobe, ior, response.knee);
    let share = reflectance.specular_share;
    let specular = share * 0.25 * FRAC_1_PI * lobe.normalization;
    let lambert = (1.0 - share) * FRAC_1_PI;
    let radiance = std::array::from_fn(|channel| {
        let tinted = response.at_moments(fresnel[channel], excess[channel])[channel];
        specular * tinted + lambert * reflectance.rgb0[channel] * diffuse[channel]
    });
    (radiance, batch.count() as u32)
}

kernel! {
    /// In each channel the integrals of the light times the lobe's power, cos_i / (|h| max(cos_i,
    /// cos_o)) and Fresnel's reflectance; of the same with what that exceeds the tint's knee by;
    /// and of the light times cos_i.
    pub fn integrals(
        batch: &LightBatch,
        wo: Vec3,
        lobe: &Lobe,
        ior: f64,
        knee: f64,
    ) -> [[f64; 3]; 3] {
        let exponents = [lobe.n_u, lobe.n_v];
        // The lobe's axes in the world's frame.
        let u = lobe.to_surface(Vec3::new(1.0, 0.0, 0.0));
        let mut sums = [[[0.0; LANES]; 3]; 3];
        for [x, y, z, r, g, b] in batch.blocks() {
            let mut terms = [[0.0; LANES]; 3];
            for i in 0..LANES {
                let (hx, hy, hz) = (x[i] + wo.x, y[i] + wo.y, z[i] + wo.z);
                let hu = u.x * hx + u.y * hy;
                let hv = u.x * hy - u.y * hx;
                let half2 = [hu * hu, hv * hv, hz * hz];
                let cos_i = z[i];
                let larger = if cos_i > wo.z { cos_i } else { wo.z };
                let value = specular::at_half_vector(1.0, exponents, half2, cos_i, larger);
                let [fresnel, beyond] = specular::fresnel_moments(cos_i, ior, knee);
                terms[0][i] = value * fresnel;
                terms[1][i] = value * beyond;
                terms[2][i] = cos_i;
            }
            for (sums, term) in sums.iter_mut().zip(&terms) {
                for (sum, light) in sums.iter_mut().zip([r, g, b]) {
                    for i in 0..LANES {
                        sum[i] += term[i] * light[i];
                    }
                }
            }
        }
        sums.map(|channels| channels.map(total))
    }
}
