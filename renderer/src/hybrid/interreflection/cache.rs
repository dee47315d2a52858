//! What sample and chart send each other, kept from view to view.

use super::{Interreflection, Unresolved};
use crate::hybrid::budget::interreflection::KEPT;
use dataset::Material;
use std::collections::VecDeque;
use std::sync::{Arc, Mutex, PoisonError};

/// The last interreflections that were asked for.
#[derive(Debug, Default)]
pub struct InterreflectionCache {
    kept: Mutex<VecDeque<Kept>>,
}

/// What an interreflection depends on.
#[derive(Clone, Debug, PartialEq)]
pub struct Key {
    pub material: Material,
    /// The material on whose tiles and by whose rules it is worked out; `None` for its own.
    pub like: Option<Material>,
    /// The rotation of the sample and the elevation of the light, in degrees.
    pub angles_deg: [f64; 2],
}

#[derive(Debug)]
struct Kept {
    key: Key,
    interreflection: Result<Arc<Interreflection>, Unresolved>,
}

impl InterreflectionCache {
    /// The interreflection of a key. Threads that ask at the same time
    /// for one that is not there each work it out. Waiting for the other could deadlock: rayon may
    /// steal the very task that we wait for.
    pub fn get(
        &self,
        key: &Key,
        make: impl FnOnce() -> Option<Result<Interreflection, Unresolved>>,
    ) -> Option<Result<Arc<Interreflection>, Unresolved>> {
        let found = self
            .kept
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .iter()
            .find(|kept| kept.key == *key)
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
            key: key.clone(),
            interreflection: made.clone(),
        });
        Some(made)
    }
}
