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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::BackendChoice;
    use crate::scene::Scene;
    use dataset::Specification;

    /// The preset's view 5 on a film of 7 x 5 pixels.
    fn view() -> View {
        let mut specification = Specification::preset();
        (specification.image.width, specification.image.height) = (7, 5);
        let scene = Scene::new(&specification, 5, BackendChoice::Native).expect("a view");
        View::new(&scene.expect("a scene"), &specification).expect("in front of the camera")
    }

    #[test]
    fn a_pixel_gets_the_mean_of_what_those_that_it_covers_get() {
        let view = view();
        let finer = FinerView::new(&view, 3.0, 315.0).expect("a finer film");
        let number = |index: u32, factor: f64| (f64::from(index) * factor).fract();
        let before: Vec<FilmPixel> = (0..35)
            .map(|index| FilmPixel {
                value: [0.618, 0.755, 0.57].map(|factor| number(index, factor)),
                error: number(index, 0.414),
            })
            .collect();
        let mut pixels = before.clone();
        let mut canvas = Canvas {
            width: 7,
            height: 5,
            pixels: &mut pixels,
        };
        let (mut added, mut errors) = (vec![[0.0; 3]; 35], vec![0.0; 35]);
        let evaluations = finer.add_to(&mut canvas, |view, fine| {
            assert_eq!(view.size, [21, 15]);
            for row in 0..15 {
                for column in 0..21 {
                    let coarse = (row / 3 * 7 + column / 3) as usize;
                    assert_eq!(fine.value((column, row)), before[coarse].value);
                    let (index, share) = (row * 21 + column, 1.0 / 9.0);
                    let value = [0.3, 0.7, 0.9].map(|factor| number(index, factor));
                    let error = number(index, 0.11);
                    fine.add((column, row), value, error);
                    for (sum, value) in added[coarse].iter_mut().zip(value) {
                        *sum += share * value;
                    }
                    errors[coarse] += share * error;
                }
            }
            17
        });
        assert_eq!(evaluations, 17);
        for (index, (pixel, before)) in pixels.iter().zip(&before).enumerate() {
            for (channel, added) in added[index].iter().enumerate() {
                let expected = before.value[channel] + added;
                assert!((pixel.value[channel] - expected).abs() < 1e-14);
            }
            assert!((pixel.error - before.error - errors[index]).abs() < 1e-14);
        }
    }

    #[test]
    fn neither_the_same_film_nor_one_of_too_many_pixels_is_finer() {
        let view = view();
        for times in [0.0, 1.0, 4.0, 1e9, f64::INFINITY, f64::NAN] {
            assert!(FinerView::new(&view, times, 559.0).is_none(), "{times}");
        }
        assert!(FinerView::new(&view, 4.0, 560.0).is_some());
    }
}
