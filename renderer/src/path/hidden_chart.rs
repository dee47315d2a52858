//! How much of a mesh's lobe its chart fills, where a fold may hide the chart.
//!
//! Paths that all met folds do not tell that nothing of the chart is seen between these. What they may have
//! left out is bounded by the lobe at its brightest and the solid angle at its largest.

use super::visible_part::{self, VisiblePart};
use crate::geometry::Rectangle;
use crate::reflectance::{Reflectance, lobe::Lobe};
use crate::scene::Surface;
use crate::vector::Vec3;
use std::f64::consts::{FRAC_1_PI, PI};

/// At most the integral of the reflectance times cos_i over the part of the chart that is above the horizon,
/// all of it without a part, in any channel. `wo` is the viewer in the frame of the surface.
pub fn share_max(
    surface: &Surface,
    reflectance: &Reflectance,
    chart: &Rectangle,
    part: Option<VisiblePart>,
    wo: Vec3,
) -> f64 {
    let (outline, area) = match &part {
        Some(part) => (part.corners(), part.area()),
        None => (&visible_part::SQUARE[..], 1.0),
    };
    let corners = outline.iter().map(|[u, v]| {
        let offset = chart.point(*u, *v) - surface.position;
        surface.frame.to_local(offset)
    });
    let mirrored = Vec3::new(-wo.x, -wo.y, wo.z);
    // A direction turns by no more than twice its half vector, whose power is that of the wider axis at most.
    let turned = 0.5 * visible_part::angle_from(mirrored, corners);
    let lobe = &reflectance.lobe;
    let power = libm::exp(lobe.n_u.min(lobe.n_v) * libm::log(libm::cos(turned)));
    let specular = power * peak(surface, lobe, chart, wo);
    let diffuse = reflectance.rgb0.into_iter().fold(0.0, f64::max) * FRAC_1_PI;
    let of_specular = reflectance.specular_share;
    let most = of_specular * specular + (1.0 - of_specular) * diffuse;
    let share = area * most * solid_angle_max(surface, chart);
    // On the chart there is no such number.
    if share.is_nan() { f64::INFINITY } else { share }
}

/// At most the integral of the specular part times cos_i over the chart, were all of it as bright as the lobe's
/// peak.
pub fn peak_share(surface: &Surface, lobe: &Lobe, chart: &Rectangle, wo: Vec3) -> f64 {
    peak(surface, lobe, chart, wo) * solid_angle_max(surface, chart)
}

/// At most the specular part of equation 1, times cos_i, toward a rectangle: a steradian, by a tint of 1.
fn peak(surface: &Surface, lobe: &Lobe, rectangle: &Rectangle, wo: Vec3) -> f64 {
    let viewer = surface.frame.to_world(wo);
    let corners = rectangle.corners();
    let along = corners.map(|corner| viewer.dot(corner - surface.position));
    let least = along.into_iter().fold(0.0, f64::min);
    // Of h.wi = sqrt((1 + wi.wo)/2). The viewer and the light are above the surface, so it is also no less
    // than half of wo.z.
    let behind = (-least / rectangle.distance(surface.position)).min(1.0);
    let cosine = (0.5 - 0.5 * behind).sqrt().max(0.5 * wo.z);
    lobe.normalization / (8.0 * PI) / cosine
}

/// At most the solid angle of a rectangle, in steradians: were all of it seen as where it is nearest, where an
/// area over its squared distance, by the cosine at which it is seen, is largest.
fn solid_angle_max(surface: &Surface, rectangle: &Rectangle) -> f64 {
    let distance = rectangle.distance(surface.position);
    let area = rectangle.u_length * rectangle.v_length;
    let height = rectangle.normal.dot(surface.position - rectangle.corner);
    area * height / (distance * distance * distance)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::warp::perpendiculars;
    use dataset::Specification;
    use proptest::prelude::*;

    /// A unit vector, from points of the unit interval.
    fn direction([height, around]: [f64; 2]) -> Vec3 {
        let (sin, cos) = libm::sincos(2.0 * PI * around);
        let across = (1.0 - height * height).sqrt();
        Vec3::new(across * cos, across * sin, height)
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(4096))]

        /// No place of the chart sends more than the bound, were all of the chart like it; so neither does all of it.
        #[test]
        fn no_place_of_a_chart_is_brighter_than_its_bound(
            index in 0..9000u32,
            [viewer, facing, around, turn] in prop::array::uniform4(0.0..1.0f64),
            [normal_height, normal_around] in [-1.0..1.0f64, 0.0..1.0],
            [distance, width, height] in prop::array::uniform3(-2.0..1.0f64),
            corner in prop::array::uniform2(-0.5..1.5f64),
            places in prop::array::uniform8(prop::array::uniform2(0.0..=1.0f64)),
        ) {
            let specification = Specification::preset();
            let reflectance =
                Reflectance::new(&specification.material(index).material, 0.0, specification.tint);
            let position = Vec3::new(0.3, -0.2, 0.1);
            let surface =
                Surface::of_curved_sample(position, direction([normal_height, normal_around]));
            // The cubes are for grazing viewers and charts.
            let wo = direction([viewer * viewer * viewer, around]);
            let toward = direction([2.0 * facing * facing * facing - 1.0, turn]);
            let chart = chart(position, toward, [distance, width, height].map(libm::exp10), corner);
            let local = |[u, v]: [f64; 2]| surface.frame.to_local(chart.point(u, v) - position);
            let heights = visible_part::SQUARE.map(|corner| local(corner).z);
            let Some(part) = VisiblePart::new(heights) else {
                return Ok(());
            };
            let bound = share_max(&surface, &reflectance, &chart, Some(part), wo);
            let area = part.area() * chart.u_length * chart.v_length;
            // The drawn places, and where the mirror image is.
            let mirrored = surface.frame.to_world(Vec3::new(-wo.x, -wo.y, wo.z));
            let places = places.map(|place| part.point(place)).into_iter().chain(meets(&chart, position, mirrored));
            for place in places {
                let to_chart = local(place);
                let squared = to_chart.length_squared();
                let wi = to_chart * (1.0 / squared.sqrt());
                let seen = -chart.normal.dot(surface.frame.to_world(wi)) / squared;
                let light = reflectance.evaluate(wi, wo).into_iter().fold(0.0, f64::max);
                let share = area * seen * light * wi.z.max(0.0);
                prop_assert!(share <= bound * (1.0 + 1e-9), "{share} {bound}");
            }
        }
    }

    /// A chart that faces a place from `distance` metres away, in a direction. `corner` is what faces it, in shares
    /// of the sides.
    fn chart(
        position: Vec3,
        toward: Vec3,
        [distance, width, height]: [f64; 3],
        corner: [f64; 2],
    ) -> Rectangle {
        let (v_axis, u_axis) = perpendiculars(toward);
        let faced = position + toward * distance;
        let at = faced - u_axis * (corner[0] * width) - v_axis * (corner[1] * height);
        Rectangle::new(at, u_axis, v_axis, width, height)
    }

    /// Where a chart is met in a direction, if it is.
    fn meets(chart: &Rectangle, from: Vec3, direction: Vec3) -> Option<[f64; 2]> {
        let distance = chart.normal.dot(chart.corner - from) / chart.normal.dot(direction);
        let offset = from + direction * distance - chart.corner;
        let place = [
            offset.dot(chart.u_axis) / chart.u_length,
            offset.dot(chart.v_axis) / chart.v_length,
        ];
        let is_met = distance > 0.0 && place.iter().all(|share| (0.0..=1.0).contains(share));
        is_met.then_some(place)
    }
}
