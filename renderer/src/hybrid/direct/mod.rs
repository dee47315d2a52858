//! The bulb's light off the sample.

mod breaks;
mod bulb;
mod bulb_light;
mod bulb_on_film;
mod bulb_view;
mod chords;
#[cfg(test)]
mod tests;

use super::budget::direct::{
    FINER_PIXELS_MAX, IMAGE_WIDTHS, LIMIT, ROUGH_EXPONENT, SHARP_TILE_MIN, SHARP_WIDTH, TILE_MIN,
};
use super::budget::{LOG_TILING, tile_pixels};
use super::finer_view::FinerView;
use super::view::View;
use crate::film::canvas::Canvas;
use crate::film::demand::{Demand, Terms};
use crate::film::log_tiling;
use crate::film::region::Region;
use crate::film::tiling;
use crate::numerics::polygon::Rectangle;
use crate::reflectance::Reflectance;
use crate::scene::Bulb;
use crate::vector::Vec3;
pub use bulb::SlopeBatch;
pub use bulb_light::BulbLight;
use bulb_on_film::BulbOffSample;
use std::f64::consts::FRAC_PI_2;

/// Adds the bulb's light off the sample to the film; returns evaluations.
pub fn add(view: &View, canvas: &mut Canvas<'_>, reflectance: &Reflectance) -> u64 {
    let shade = BulbOffSample { view, reflectance };
    let distance = view.bulb.centre.length();
    let half_angle = view.bulb.radius / distance;
    let blur2 = 1.0 / reflectance.lobe.n_u;
    let slope = (0.25 * half_angle * half_angle + blur2).sqrt();
    let feature = tile_pixels(view.slope_pixels(slope, distance));
    let width = view.slope_pixels(1.0 / reflectance.lobe.n_u.sqrt(), distance);
    let is_sharp = width <= SHARP_WIDTH;
    let is_small = feature < if is_sharp { SHARP_TILE_MIN } else { TILE_MIN };
    let finer = || FinerView::new(view, (SHARP_TILE_MIN / feature).ceil(), FINER_PIXELS_MAX);
    if let (true, true, Some(finer)) = (is_sharp, is_small, finer()) {
        return finer.add_to(canvas, |view, fine| add(view, fine, reflectance));
    }
    let is_rough = reflectance.lobe.n_u <= ROUGH_EXPONENT;
    if (!is_rough && !is_sharp) || is_small {
        let demand = log_tiling::Demand {
            accuracy: &view.budget.bulb,
            evaluations_max: view.evaluations_max(LIMIT),
            tolerance: view.budget.bulb_rule,
            shares: LOG_TILING,
            instructions: view.instructions,
        };
        return log_tiling::integrate(canvas, view.sample.polygon(), &demand, &shade);
    }
    let demand = Demand {
        accuracy: if is_sharp {
            &view.budget.sharp_bulb
        } else {
            &view.budget.bulb
        },
        faint: view.budget.chart.absolute,
        terms: if is_sharp || bends(view) {
            Terms::Many
        } else {
            view.budget.smooth_terms()
        },
        side_max: feature,
        feature: if is_sharp {
            mirror_image(view, reflectance)
        } else {
            below_camera(view)
        },
        evaluations_max: view.evaluations_max(LIMIT),
        tolerance: view.budget.bulb_linear_rule(),
        shares: view.budget.tiling(),
        instructions: view.instructions,
    };
    let regions = [Region {
        outline: *view.sample.polygon(),
        by_pixel: Some(&view.sample),
        factor: [1.0; 3],
    }];
    tiling::integrate(canvas, &view.sample, &regions, &demand, &shade)
}

/// The box on the film around the bulb's mirror image in the sample and what the lobe makes of its edge; `None`
/// where it reaches behind the camera.
///
/// The tip of a sharp image could reach into a tile between two of its nodes and cover next to nothing of it. No
/// tile lies across the sides of this box, so a tile with a tip on it has at least the tip's depth of the image.
fn mirror_image(view: &View, reflectance: &Reflectance) -> Option<Rectangle> {
    let Bulb { centre, radius, .. } = view.bulb;
    let mirrored = Vec3::new(centre.x, centre.y, -centre.z);
    let [low, high] = view.camera.sphere_box(mirrored, radius)?;
    let reach = IMAGE_WIDTHS / reflectance.lobe.n_v.sqrt();
    let reach = view.slope_pixels(reach, centre.length());
    Some(Rectangle {
        low: low.map(|low| low - reach),
        high: high.map(|high| high + reach),
    })
}

/// Whether the camera stands higher than the bulb from a part of the sample, and lower from another: the bulb's light
/// bends where they stand equally high. Few terms then leave out three times what many do, a thousandth of the light of
/// the preset's images (measured), for a tenth of the time.
fn bends(view: &View) -> bool {
    let half = view.sample_half;
    let corners = [[-half, -half], [half, -half], [half, half], [-half, half]];
    let higher = corners.map(|[x, y]| {
        let from = Vec3::new(x, y, 0.0);
        let cosine = |to: Vec3| (to - from).z / (to - from).length();
        cosine(view.camera.position) > cosine(view.bulb.centre)
    });
    higher.contains(&true) && higher.contains(&false)
}

/// The box on the film around the part of the sample from which the camera stands higher than the lowest point of the
/// bulb; `None` where that has no end or reaches behind the camera.
///
/// There the bulb's light is lessened by how much the camera stands higher. Where bulb and camera are nearly overhead
/// the part may hide between the nodes of a tile of all of the sample.
fn below_camera(view: &View) -> Option<Rectangle> {
    let position = view.camera.position;
    let below = Vec3::new(position.x, position.y, 0.0);
    let Bulb { centre, radius, .. } = view.bulb;
    let to_bulb = centre - below;
    let off_zenith = libm::acos(to_bulb.z / to_bulb.length());
    let half_angle = libm::asin((radius / to_bulb.length()).min(1.0));
    let most = off_zenith + half_angle;
    if most >= FRAC_PI_2 {
        return None;
    }
    let reach = position.z * libm::tan(most);
    let [low, high] = view.camera.sphere_box(below, reach)?;
    Some(Rectangle { low, high })
}
