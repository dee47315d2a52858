//! A view on a film of smaller pixels, for what no tile of a coarse film's pixels holds.

use super::view::View;
use crate::film::FilmPixel;
use crate::film::canvas::Canvas;

/// A view whose film has `times` as many pixels along either side.
pub struct FinerView {
    view: View,
    times: u32,
}

impl FinerView {
    /// The same view on a film with `times`, a whole number, as many pixels along either side; `None` where that is
    /// this one, or would have more than so many pixels.
    pub fn new(view: &View, times: f64, pixels_max: f64) -> Option<Self> {
        let pixels = times * times * f64::from(view.size[0]) * f64::from(view.size[1]);
        if times <= 1.0 || pixels.is_nan() || pixels > pixels_max {
            return None;
        }
        let times = times as u32;
        Some(Self {
            view: view.finer(times)?,
            times,
        })
    }

    /// Adds to the coarser film what `add` adds to a dark finer one: each of its pixels is the mean of those that it
    /// covers. Returns evaluations, as `add` does.
    pub fn add_to(
        &self,
        canvas: &mut Canvas<'_>,
        add: impl FnOnce(&View, &mut Canvas<'_>) -> u64,
    ) -> u64 {
        let [width, height] = self.view.size;
        let mut pixels = vec![FilmPixel::default(); width as usize * height as usize];
        let mut fine = Canvas {
            width,
            height,
            pixels: &mut pixels,
        };
        let evaluations = add(&self.view, &mut fine);
        let share = 1.0 / f64::from(self.times * self.times);
        for (index, pixel) in (0..).zip(&pixels) {
            let index_on_coarse = (index % width / self.times, index / width / self.times);
            canvas.add(
                index_on_coarse,
                pixel.value.map(|channel| share * channel),
                share * pixel.error,
            );
        }
        evaluations
    }
}
