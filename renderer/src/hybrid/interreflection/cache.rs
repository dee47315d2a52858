//! What sample and chart send each other, kept from view to view.

use super::{Interreflection, Unresolved};
use crate::hybrid::budget::interreflection::KEPT;
use dataset::Material;
use std::collections::VecDeque;
use std::sync::{Arc, Mutex, PoisonError};

/// The last interreflections by material, rotation of the sample and elevation of the light.
#[derive(Debug, Default)]
pub struct InterreflectionCache {
    kept: Mutex<VecDeque<Kept>>,
}

#[derive(Debug)]
struct Kept {
    material: Material,
    angles_deg: [f64; 2],
    interreflection: Result<Arc<Interreflection>, Unresolved>,
}

impl InterreflectionCache {
    /// The interreflection of a material under these angles in degrees. Threads that ask at the same time
    /// for one that is not there each work it out. Waiting for the other could deadlock: rayon may
    /// steal the very task that we wait for.
    pub fn get(
        &self,
        material: &Material,
        angles_deg: [f64; 2],
        make: impl FnOnce() -> Option<Result<Interreflection, Unresolved>>,
    ) -> Option<Result<Arc<Interreflection>, Unresolved>> {
        let found = self
            .kept
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .iter()
            .find(|kept| kept.material == *material && kept.angles_deg == angles_deg)
            .map(|kept| kept.interreflection.clone());
        if found.is_some() {
            return found;
        }
        let made = make()?.map(Arc::new);
        let mut kept = self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        if kept.len() == KEPT {
            kept.pop_front();
        }
        kept.push_back(Kept {
            material: *material,
            angles_deg,
            interreflection: made.clone(),
        });
        Some(made)
    }
}
