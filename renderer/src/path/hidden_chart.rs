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
