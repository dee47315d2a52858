//! Shapes tested one after another: the fastest for a few, and what every answer of Embree must
//! equal bit for bit.

use super::primitive::{Hit, PrimitiveId, Ray};
use super::shapes::Shapes;

/// The nearest hit on anything but `from`, no farther than `distance_max`, which is finite.
pub(crate) fn intersect<S: Shapes>(
    shapes: &S,
    ray: &Ray,
    from: PrimitiveId,
    mut distance_max: f64,
) -> Option<Hit> {
    let mut nearest: Option<Hit> = None;
    let ray = shapes.prepare(ray);
    for id in (0..shapes.count() as u32).map(PrimitiveId) {
        if id == from {
            continue;
        }
        let Some(found) = shapes.intersect(id, &ray, distance_max) else {
            continue;
        };
        // Ids grow, so at the same distance the earlier hit stands.
        if nearest.is_none() || found.distance < distance_max {
            distance_max = found.distance;
            nearest = Some(Hit {
                distance: found.distance,
                primitive: id,
                u: found.u,
                v: found.v,
            });
        }
    }
    nearest
}

/// Whether anything but `from` and `target` is found before `distance_max`, which is finite.
pub(crate) fn occluded<S: Shapes>(
    shapes: &S,
    ray: &Ray,
    from: PrimitiveId,
    target: PrimitiveId,
    distance_max: f64,
) -> bool {
    let ray = shapes.prepare(ray);
    let ids = (0..shapes.count() as u32).map(PrimitiveId);
    ids.filter(|id| *id != from && *id != target).any(|id| {
        let found = shapes.intersect(id, &ray, distance_max);
        found.is_some_and(|found| found.distance < distance_max)
    })
}
