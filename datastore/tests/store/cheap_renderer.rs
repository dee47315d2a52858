//! A renderer of cheap images: what `verify` and `repair` borrow.

use crate::complete_store::completion;
use dataset::{PixelStatistics, Specification};
use datastore::verify::{Checks, Rerender, Rerendered};
use imagestore::validation::decode;

pub struct CheapRenderer(pub Specification);

impl Rerender for CheapRenderer {
    fn render(&self, material: u32, view: u32) -> Result<Rerendered, String> {
        let (completion, mut images) = completion(&self.0, material);
        let bytes = images.swap_remove(view as usize);
        let pixels = decode(&bytes, &self.0).unwrap().pixels;
        Ok(Rerendered {
            bytes,
            statistics: completion.views[view as usize].statistics,
            pixels: PixelStatistics::of(&self.0, view, pixels.iter().copied()).unwrap(),
        })
    }

    fn must_be_lit(&self, _: u32, view: u32) -> bool {
        view != 2
    }
}

/// Checks of this many materials; with a renderer, all images are rendered again.
pub fn checks(materials: u32, renderer: Option<&dyn Rerender>) -> Checks<'_> {
    Checks {
        materials,
        threads: 2,
        renderer,
        rerender_share: if renderer.is_some() { 1.0 } else { 0.0 },
        rerender_seed: 3,
    }
}
