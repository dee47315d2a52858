//! The sets that inputs are about, and who calls the live coordinator.

use dataset::{
    Specification,
    specification::{Image, Pixel},
};
use std::sync::LazyLock;

/// The set of all seeds: small, so that a fuzzer tries much of it, with images of two blocks, so
/// that there is more than one.
pub(crate) static SPECIFICATION: LazyLock<Specification> = LazyLock::new(|| {
    let mut specification = Specification::preset();
    specification.materials = 1;
    specification.image = film(Pixel::Half);
    specification.views.truncate(2);
    specification
});

/// The film of the set's images.
pub(crate) fn film(pixel: Pixel) -> Image {
    Image {
        width: 3,
        height: 18,
        pixel,
    }
}

/// What a message says where it means the token that was leased last, which nobody can guess.
pub(crate) const LEASED: &[u8] = b"the token leased";

/// The id of the worker that is there when an input begins, and its name.
pub(crate) const WORKER: (&[u8], &str) = (b"a fuzzing worker", "w");

/// Jobs of the live coordinator.
const LIVE_MATERIALS: u32 = 64;

/// The set that the live coordinator hands out.
pub(crate) static LIVE_SPECIFICATION: LazyLock<Specification> = LazyLock::new(|| {
    let mut specification = SPECIFICATION.clone();
    specification.materials = LIVE_MATERIALS;
    specification
});
