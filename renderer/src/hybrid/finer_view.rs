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

    /// Adds to the coarser film what `add` adds to the finer one: to each of its pixels the mean of those that it covers.
    /// The finer film begins with what the coarser one has, because that tells what may be missed beside it. Returns
    /// evaluations, as `add` does.
    pub fn add_to(
        &self,
        canvas: &mut Canvas<'_>,
        add: impl FnOnce(&View, &mut Canvas<'_>) -> u64,
    ) -> u64 {
        let [width, height] = self.view.size;
        let on_coarse = |index: u32| (index % width / self.times, index / width / self.times);
        let beside = |index| canvas.value(on_coarse(index));
        let mut pixels: Vec<FilmPixel> = (0..width * height)
            .map(|index| FilmPixel {
                value: beside(index),
                error: 0.0,
            })
            .collect();
        let mut fine = Canvas {
            width,
            height,
            pixels: &mut pixels,
        };
        let evaluations = add(&self.view, &mut fine);
        let share = 1.0 / f64::from(self.times * self.times);
        let before: Vec<[f64; 3]> = canvas.pixels.iter().map(|pixel| pixel.value).collect();
        for (index, pixel) in (0..).zip(&pixels) {
            let (column, row) = on_coarse(index);
            let before = before[(row * canvas.width + column) as usize];
            let added = [0, 1, 2].map(|channel| share * (pixel.value[channel] - before[channel]));
            canvas.add((column, row), added, share * pixel.error);
        }
        evaluations
    }
}
