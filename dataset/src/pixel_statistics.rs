//! How bright an image of the sample is.

use crate::{Specification, sample_on_film::SampleOnFilm};
use serde::{Deserialize, Serialize};
use std::fmt;

/// Rec.709's weights of linear red, green and blue in the luminance.
pub const LUMINANCE_WEIGHTS: [f64; 3] = [0.2126, 0.7152, 0.0722];

/// Below this brightness, in units of white, a pixel is dark: it is less than one step of a linear
/// picture of 8 bits.
pub const DARK_BELOW: f64 = 1.0 / 255.0;

/// The brightness of an image over the sample: a function of its pixels and its view.
///
/// A pixel's brightness is its luminance in units of white, of the values that the file has. Pixels of
/// the sample are those whose centre lies on its square or on the front of a curved sample, whatever
/// stands before it. Where there are none, all numbers are 0.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PixelStatistics {
    /// The share of the film's pixels that are of the sample.
    pub sample_share: f64,
    /// Mean brightness of the sample's pixels.
    pub brightness_mean: f64,
    /// 99th percentile of their brightness, between two pixels by the line through both.
    pub brightness_p99: f64,
    /// The share of them that are darker than [`DARK_BELOW`].
    pub dark_share: f64,
    /// The share of them that are brighter than white.
    pub above_white_share: f64,
}

impl PixelStatistics {
    /// Those of an image whose pixels are given row by row from the top, as the file has them; `None`
    /// where the specification has no such view or its mesh is not loaded, or the film has another number
    /// of pixels.
    pub fn of(
        specification: &Specification,
        view: u32,
        pixels: impl ExactSizeIterator<Item = [f32; 3]>,
    ) -> Option<Self> {
        Self::of_stored(specification, view, pixels, |pixel| pixel)
    }

    /// The same, where `stored` turns a pixel into what the file has. That takes time, so only the sample's pixels are
    /// turned.
    pub fn of_stored<P>(
        specification: &Specification,
        view: u32,
        pixels: impl ExactSizeIterator<Item = P>,
        stored: impl Fn(P) -> [f32; 3],
    ) -> Option<Self> {
        let [width, height] = [specification.image.width, specification.image.height];
        let count = pixels.len();
        if count != width as usize * height as usize || count == 0 {
            return None;
        }
        let mask = Self::mask(specification, view)?;
        let of_sample = mask.iter().zip(pixels).filter(|(is_on, _)| **is_on);
        let of_sample = of_sample.map(|(_, pixel)| brightness(stored(pixel)));
        let mut of_sample: Vec<f64> = of_sample.collect();
        let sample_share = of_sample.len() as f64 / count as f64;
        Some(Self::of_sample(sample_share, &mut of_sample))
    }

    /// Which pixels of a view's film, row by row from the top, are of the sample; `None` where the
    /// specification has no such view, or its mesh is not loaded.
    pub fn mask(specification: &Specification, view: u32) -> Option<Vec<bool>> {
        let sample = SampleOnFilm::new(specification, view)?;
        let [width, height] =
            [specification.image.width, specification.image.height].map(|side| side as usize);
        let mut mask = vec![false; width * height];
        for (row, on_sample) in mask.chunks_exact_mut(width.max(1)).enumerate() {
            sample.mark_row(row, on_sample);
        }
        Some(mask)
    }

    fn of_sample(sample_share: f64, brightness: &mut [f64]) -> Self {
        if brightness.is_empty() {
            return Self::default();
        }
        let count = brightness.len() as f64;
        let share = |is_so: fn(f64) -> bool| {
            let so = brightness.iter().filter(|value| is_so(**value));
            so.count() as f64 / count
        };
        Self {
            sample_share,
            brightness_mean: brightness.iter().sum::<f64>() / count,
            dark_share: share(|value| value < DARK_BELOW),
            above_white_share: share(|value| value > 1.0),
            brightness_p99: percentile(brightness, 0.99),
        }
    }

    /// That the numbers can be those of an image: brightness neither negative nor infinite, shares
    /// between 0 and 1. Says which is not.
    pub fn check(&self) -> Result<(), String> {
        let Self {
            sample_share,
            brightness_mean,
            brightness_p99,
            dark_share,
            above_white_share,
        } = *self;
        for (what, value) in [("mean", brightness_mean), ("percentile", brightness_p99)] {
            if !(0.0..f64::INFINITY).contains(&value) {
                return Err(format!("no image has a brightness whose {what} is {value}"));
            }
        }
        for share in [sample_share, dark_share, above_white_share] {
            if !(0.0..=1.0).contains(&share) {
                return Err(format!("{share} is no share of the pixels"));
            }
        }
        Ok(())
    }
}

impl fmt::Display for PixelStatistics {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "mean {:?}, 99th percentile {:?}, dark share {:?}, share above white {:?}, of a sample that \
             has the share {:?} of the film",
            self.brightness_mean,
            self.brightness_p99,
            self.dark_share,
            self.above_white_share,
            self.sample_share
        )
    }
}

/// The luminance of linear Rec.709, in units of white.
fn brightness(pixel: [f32; 3]) -> f64 {
    let [red, green, blue] = pixel.map(f64::from);
    LUMINANCE_WEIGHTS[0] * red + LUMINANCE_WEIGHTS[1] * green + LUMINANCE_WEIGHTS[2] * blue
}

/// The value below which this share of at least one value lies, on the line between the two nearest
/// (Hyndman and Fan 1996, definition 7, which is NumPy's). Reorders the values.
fn percentile(values: &mut [f64], share: f64) -> f64 {
    let place = share * (values.len() - 1) as f64;
    let below = place.floor() as usize;
    let (_, &mut low, above) = values.select_nth_unstable_by(below, f64::total_cmp);
    let next = above.iter().copied().reduce(f64::min);
    next.map_or(low, |next| low + (next - low) * (place - below as f64))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn small() -> Specification {
        let mut specification = Specification::preset();
        (specification.image.width, specification.image.height) = (24, 16);
        specification
    }

    #[test]
    fn a_white_sample_is_white_and_covers_what_the_homography_says() {
        let specification = small();
        for view in 0..14 {
            let found =
                PixelStatistics::of(&specification, view, [[1.0; 3]; 24 * 16].into_iter()).unwrap();
            assert!((found.brightness_mean - 1.0).abs() < 1e-12);
            assert!((found.brightness_p99 - 1.0).abs() < 1e-12);
            assert_eq!(found.dark_share, 0.0);
            assert!(found.sample_share > 0.02 && found.sample_share < 1.0);
            assert_eq!(found.check(), Ok(()));
            let black =
                PixelStatistics::of(&specification, view, [[0.0; 3]; 24 * 16].into_iter()).unwrap();
            assert_eq!(black.sample_share, found.sample_share);
            assert_eq!((black.dark_share, black.above_white_share), (1.0, 0.0));
        }
    }

    #[test]
    fn percentiles_are_on_the_line_between_neighbours() {
        assert_eq!(percentile(&mut [3.0], 0.99), 3.0);
        assert_eq!(percentile(&mut [2.0, 1.0], 0.5), 1.5);
        let mut values: Vec<f64> = (0..=200).rev().map(f64::from).collect();
        assert_eq!(percentile(&mut values, 0.99), 198.0);
        let mut values: Vec<f64> = (0..=10).map(f64::from).collect();
        assert!((percentile(&mut values, 0.99) - 9.9).abs() < 1e-12);
    }

    #[test]
    fn what_is_no_image_of_the_specification_has_none() {
        let specification = small();
        assert_eq!(
            PixelStatistics::of(&specification, 14, [[1.0; 3]; 24 * 16].into_iter()),
            None
        );
        assert_eq!(
            PixelStatistics::of(&specification, 0, [[1.0; 3]; 23 * 16].into_iter()),
            None
        );
        assert_eq!(PixelStatistics::of(&specification, 0, [].into_iter()), None);
    }

    #[test]
    fn lies_are_refused() {
        let honest = PixelStatistics {
            sample_share: 0.25,
            brightness_mean: 0.1,
            brightness_p99: 3.0,
            dark_share: 0.5,
            above_white_share: 0.01,
        };
        assert_eq!(honest.check(), Ok(()));
        let lies: [fn(&mut PixelStatistics); 6] = [
            |lie| lie.brightness_mean = -1e-9,
            |lie| lie.brightness_mean = f64::NAN,
            |lie| lie.brightness_p99 = f64::INFINITY,
            |lie| lie.sample_share = 1.1,
            |lie| lie.dark_share = f64::NAN,
            |lie| lie.above_white_share = -0.1,
        ];
        for lie in lies {
            let mut told = honest;
            lie(&mut told);
            assert!(told.check().is_err(), "{told:?}");
        }
    }
}
