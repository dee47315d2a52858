//! What the backends trace: a list of things that a ray can meet.

use super::primitive::{Bounds, Intersection, Primitive, PrimitiveId, Ray};
use std::fmt::Debug;

/// A list of things that a ray can meet, which the backends trace. Ids are indices.
pub(crate) trait Shapes: Debug + Send + Sync + 'static {
    /// What is worked out once for a ray.
    type Prepared: Debug;

    /// How many there are.
    fn count(&self) -> usize;

    /// A box about one of them.
    fn bounds(&self, id: PrimitiveId) -> Bounds;

    /// Prepares a ray.
    fn prepare(&self, ray: &Ray) -> Self::Prepared;

    /// Where the ray first meets one of them at a distance in (0, `distance_max`]; `distance_max` is
    /// finite, so the distance is.
    fn intersect(
        &self,
        id: PrimitiveId,
        ray: &Self::Prepared,
        distance_max: f64,
    ) -> Option<Intersection>;
}

/// Primitives of any kind.
#[derive(Debug)]
pub(crate) struct PrimitiveList(pub Box<[Primitive]>);

impl Shapes for PrimitiveList {
    type Prepared = Ray;

    fn count(&self) -> usize {
        self.0.len()
    }

    fn bounds(&self, id: PrimitiveId) -> Bounds {
        self.0[id.0 as usize].bounds()
    }

    fn prepare(&self, ray: &Ray) -> Ray {
        *ray
    }

    #[inline(always)]
    fn intersect(&self, id: PrimitiveId, ray: &Ray, distance_max: f64) -> Option<Intersection> {
        self.0[id.0 as usize].intersect(ray, distance_max)
    }
}
