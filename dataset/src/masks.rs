//! Masks of a mesh that were worked out before.

use std::{
    collections::VecDeque,
    fmt,
    sync::{Arc, Mutex, PoisonError},
};

/// The most masks that a mesh remembers: those of the views of a set.
const MASKS_MAX: usize = 64;
/// The most pixels of all masks that a mesh remembers, at a byte each.
const PIXELS_MAX: usize = 64 << 20;

/// For each pixel of a film, row by row from the top, whether its centre sees the front of a mesh.
pub(crate) type Mask = Arc<[bool]>;

/// What a mask depends on beside the mesh: the film's columns and rows, and the bits of a pixel's side at unit
/// distance, of the mesh's longest side, and of the camera's place and frame.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct MaskedFilm {
    pub size: [u32; 2],
    pub pitch: u64,
    pub side_m: u64,
    pub camera: Vec<u64>,
}

/// The masks of a mesh, the newest last.
#[derive(Default)]
pub(crate) struct Masks(Mutex<VecDeque<(MaskedFilm, Mask)>>);

impl fmt::Debug for Masks {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Masks")
    }
}

impl Masks {
    /// The mask of a film, worked out if it is not remembered.
    pub fn of_film(&self, film: MaskedFilm, work_out: impl FnOnce() -> Mask) -> Mask {
        let known = || self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, mask)) = known().iter().find(|(other, _)| *other == film) {
            return Arc::clone(mask);
        }
        let mask = work_out();
        let mut known = known();
        known.push_back((film, Arc::clone(&mask)));
        let pixels = |known: &VecDeque<(MaskedFilm, Mask)>| -> usize {
            known.iter().map(|(_, mask)| mask.len()).sum()
        };
        while known.len() > MASKS_MAX || pixels(&known) > PIXELS_MAX {
            known.pop_front();
        }
        mask
    }
}
