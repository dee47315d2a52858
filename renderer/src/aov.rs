//! What the middle of each pixel sees: depth, normal, tangent, place on the surface, and which surface.

use crate::scene::{Encounter, Scene, Thing};
use crate::vector::Vec3;
use std::array;

/// The channels of a file, by layer, in the order of [`channels`].
pub const NAMES: [&str; 12] = [
    "depth.Z",
    "normal.X",
    "normal.Y",
    "normal.Z",
    "tangent.X",
    "tangent.Y",
    "tangent.Z",
    "uv.U",
    "uv.V",
    "mask.sample",
    "mask.chart",
    "mask.bulb",
];

/// The channels of a film of `width` x `height` pixels, row by row from the top. All are 0 in pixels that
/// see nothing.
///
/// Depth is along the camera's axis, in metres. Normal and tangent are unit vectors of the world. On the
/// sample the tangent is the x axis of the material's frame, `rotation_deg` from the surface's; on the
/// chart it is along its rows. U and V are those of [`crate::scene::SampleSurface::uv`], and run from 0
/// to 1 over the chart. A mask is 1 where the middle of the pixel sees that surface's front, or the bulb.
pub fn channels(
    scene: &Scene,
    [width, height]: [u32; 2],
    rotation_deg: f64,
) -> [Vec<f32>; NAMES.len()] {
    let mut channels = array::from_fn(|_| Vec::with_capacity((width * height) as usize));
    for (row, column) in (0..height).flat_map(|row| (0..width).map(move |column| (row, column))) {
        let seen = pixel(scene, [column, row], rotation_deg);
        for (channel, value) in channels.iter_mut().zip(seen) {
            channel.push(value as f32);
        }
    }
    channels
}

fn pixel(scene: &Scene, [column, row]: [u32; 2], rotation_deg: f64) -> [f64; NAMES.len()] {
    let camera = &scene.camera;
    let ray = camera.ray(f64::from(column) + 0.5, f64::from(row) + 0.5);
    let surface = match scene.encounter(&ray, None) {
        Some(Encounter::Surface(surface)) => surface,
        Some(Encounter::Bulb) => {
            let mut seen = [0.0; NAMES.len()];
            seen[NAMES.len() - 1] = 1.0;
            return seen;
        }
        Some(Encounter::Black) | None => return [0.0; NAMES.len()],
    };
    let [_, _, depth] = camera.homogeneous(surface.position - camera.position);
    let frame = surface.frame;
    let is_sample = surface.thing == Thing::Sample;
    let (tangent, [u, v]) = match &scene.chart {
        Some(chart) if !is_sample => {
            let plane = chart.plane();
            let offset = surface.position - plane.corner;
            let [wide, high] = plane.size();
            let place = [offset.dot(plane.x) / wide, offset.dot(plane.y) / high];
            (frame.x, place)
        }
        _ => {
            let (sine, cosine) = dataset::sin_cos_deg(rotation_deg);
            let turned = frame.x * cosine + frame.y * sine;
            (turned, scene.sample.uv(&surface))
        }
    };
    let [normal, tangent] = [frame.z, tangent].map(|Vec3 { x, y, z }| [x, y, z]);
    let mask = [is_sample, !is_sample, false].map(|is_seen| f64::from(u8::from(is_seen)));
    let parts = [&[depth][..], &normal, &tangent, &[u, v], &mask].concat();
    array::from_fn(|channel| parts[channel])
}
