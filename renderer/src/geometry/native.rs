//! The primitives tested one after another: the fastest for a few, and what every answer of
//! Embree must equal bit for bit.

use super::primitive::{Hit, Primitive, PrimitiveId, Ray};

/// The nearest hit on anything but `from`.
pub(crate) fn intersect(primitives: &[Primitive], ray: &Ray, from: PrimitiveId) -> Option<Hit> {
    let mut nearest: Option<Hit> = None;
    let mut distance_max = f64::MAX;
    for (id, primitive) in (0..).map(PrimitiveId).zip(primitives) {
        if id == from {
            continue;
        }
        let Some(found) = primitive.intersect(ray, distance_max) else {
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
pub(crate) fn occluded(
    primitives: &[Primitive],
    ray: &Ray,
    from: PrimitiveId,
    target: PrimitiveId,
    distance_max: f64,
) -> bool {
    (0..)
        .map(PrimitiveId)
        .zip(primitives)
        .any(|(id, primitive)| {
            id != from
                && id != target
                && primitive
                    .intersect(ray, distance_max)
                    .is_some_and(|found| found.distance < distance_max)
        })
}
