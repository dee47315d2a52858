//! What sample and chart send each other, kept from view to view.

use crate::hybrid::Exchange;
use dataset::Material;
use std::collections::VecDeque;
use std::sync::{Arc, Mutex, PoisonError};

/// Exchanges that are kept: those of two materials in the preset's turns of the sample.
const KEPT: usize = 10;

/// The last exchanges by material, turn of the sample and elevation of the light.
#[derive(Debug, Default)]
pub struct ExchangeCache {
    kept: Mutex<VecDeque<Kept>>,
}

#[derive(Debug)]
struct Kept {
    material: Material,
    angles_deg: [f64; 2],
    exchange: Arc<Exchange>,
}

impl ExchangeCache {
    /// The exchange of a material under these angles in degrees. Threads that ask at the same time
    /// for one that is not there each work it out: to wait for another could wait for oneself, as a
    /// thread of a pool takes up other work while its own is shared out.
    pub fn get(
        &self,
        material: &Material,
        angles_deg: [f64; 2],
        make: impl FnOnce() -> Option<Exchange>,
    ) -> Option<Arc<Exchange>> {
        let found = self
            .kept
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .iter()
            .find(|kept| kept.material == *material && kept.angles_deg == angles_deg)
            .map(|kept| Arc::clone(&kept.exchange));
        if found.is_some() {
            return found;
        }
        let made = Arc::new(make()?);
        let mut kept = self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        if kept.len() == KEPT {
            kept.pop_front();
        }
        kept.push_back(Kept {
            material: *material,
            angles_deg,
            exchange: Arc::clone(&made),
        });
        Some(made)
    }
}
