//! The sample in a photograph, as a network reads it and as the renderer's film shows it.

use super::corners::{Corners, compose, project};
use super::exposure::Gain;
use super::photograph::Photograph;
use crate::error::TrainingError;
use dataset::Specification;
use export::rectify::{Homography, Rectifier, Warp, outline};
use half::f16;
use inverse::{Encoding, ObservedView};

/// The least sample, as the root of its area, in pixels.
const SIDE_MIN: f64 = 32.0;

/// The most of a sample that may be clipped at white.
const CLIPPED_MAX: f64 = 0.5;

/// How far inside the sample's outline a film pixel has to lie to count, in its own sides: beside
/// the outline a photograph mixes the sample with what is behind it.
const MARGIN_PIXELS: f64 = 0.5;

/// A photograph with the place of the sample in it.
#[derive(Clone, Debug, PartialEq)]
pub struct Shot {
    /// The photograph.
    pub photograph: Photograph,
    /// The sample's corners in it.
    pub sample: Corners,
    /// The chart's corners in it, if they are known. They may lie beside it.
    pub chart: Option<Corners>,
}

impl Shot {
    /// Refuses a sample that leaves the photograph, is too small, or is mostly white.
    ///
    /// # Errors
    /// Says which.
    pub(super) fn check(&self) -> Result<(), TrainingError> {
        let refuse = |reason: String| Err(TrainingError::Input(reason));
        let mut corners = [self.sample].into_iter().chain(self.chart);
        if let Some(corners) = corners.find(|corners| !corners.are_sound()) {
            return refuse(format!(
                "the corners {:?} cross or span no pixel",
                corners.0
            ));
        }
        if let Some([x, y]) = self
            .sample
            .0
            .into_iter()
            .find(|&corner| !self.photograph.contains(corner))
        {
            let [width, height] = self.photograph.size;
            return refuse(format!(
                "the corner ({x}, {y}) of the sample lies outside the {width} x {height} pixels"
            ));
        }
        let side = self.sample.area().sqrt();
        if side < SIDE_MIN {
            return refuse(format!(
                "the sample has {side:.0} x {side:.0} pixels by its area, where {SIDE_MIN} x \
                 {SIDE_MIN} are the fewest"
            ));
        }
        let clipped = self.clipped_share();
        if clipped > CLIPPED_MAX {
            let percent = 100.0 * clipped;
            return refuse(format!(
                "{percent:.0} percent of the sample is white: expose less"
            ));
        }
        Ok(())
    }

    /// The share of the sample's pixels that are clipped.
    fn clipped_share(&self) -> f64 {
        let inside = self.sample.square_from_image();
        let width = self.photograph.size[0] as usize;
        let (mut count, mut clipped) = (0_u64, 0_u64);
        for (place, &white) in self.photograph.clipped.iter().enumerate() {
            let centre = [(place % width) as f64 + 0.5, (place / width) as f64 + 0.5];
            let on_sample = project(&inside, centre)
                .is_some_and(|at| at.iter().all(|along| (0.0..1.0).contains(along)));
            count += u64::from(on_sample);
            clipped += u64::from(on_sample && white);
        }
        clipped as f64 / count.max(1) as f64
    }

    /// The sample as a square of `side` pixels, in units of white.
    pub(super) fn square(&self, side: u32, gain: Gain) -> Result<Vec<[f32; 3]>, TrainingError> {
        let map = self.sample.square_from_image();
        let warp = Rectifier::of_image(&map, self.photograph.size, side);
        let warp = warp.map_err(|error| TrainingError::Input(error.to_string()))?;
        let scale = |pixel: [f32; 3]| {
            std::array::from_fn(|channel| (f64::from(pixel[channel]) / gain[channel]) as f32)
        };
        Ok(warp
            .apply(&self.photograph.pixels)
            .into_iter()
            .map(scale)
            .collect())
    }

    /// What the film of a view would show of the sample: sRGB codes of the photograph. Film pixels
    /// that do not lie within the sample do not count, nor those that the photograph shows partly
    /// clipped.
    pub(super) fn on_film(
        &self,
        specification: &Specification,
        view: u32,
        gain: Gain,
    ) -> Result<ObservedView, TrainingError> {
        let Some(geometry) = specification.view_geometry(view as usize) else {
            return Err(TrainingError::Input(format!("there is no view {view}")));
        };
        let film = [specification.image.width, specification.image.height];
        let [width, height] = film.map(f64::from);
        // The film as a square whose t grows upwards.
        let square_from_film = [
            [1.0 / width, 0.0, 0.0],
            [0.0, -1.0 / height, 1.0],
            [0.0, 0.0, 1.0],
        ];
        let Some(corners) = outline(&geometry.sample_from_film) else {
            return Err(TrainingError::Input(format!(
                "the camera of view {view} does not see the sample"
            )));
        };
        let film_from_sample = Corners(corners).image_from_square();
        let photograph_to_film = compose(&film_from_sample, &self.sample.square_from_image());
        let map = compose(&square_from_film, &photograph_to_film);
        let parts = Warp::new(&map, self.photograph.size, film);
        let white: Vec<[f32; 3]> = self
            .photograph
            .clipped
            .iter()
            .map(|&clipped| [f32::from(u8::from(clipped)); 3])
            .collect();
        let (light, white) = (parts.apply(&self.photograph.pixels), parts.apply(&white));
        let cells = 0..film[0] as usize * film[1] as usize;
        let counts = cells.map(|cell| {
            let corner = [
                (cell % film[0] as usize) as f64,
                (cell / film[0] as usize) as f64,
            ];
            let whole = white[cell][0] <= 1e-6 || white[cell][0] >= 1.0 - 1e-6;
            whole && within(&geometry.sample_from_film, corner)
        });
        let counts = counts.collect();
        let codes = |pixel: [f32; 3]| pixel.map(|channel| Encoding::Srgb.value(f64::from(channel)));
        Ok(ObservedView {
            view,
            pixels: light.into_iter().map(codes).collect(),
            gain,
            counts,
        })
    }
}

/// Whether a film pixel with a margin lies within the sample.
fn within(sample_from_film: &Homography, [column, row]: [f64; 2]) -> bool {
    [-MARGIN_PIXELS, 1.0 + MARGIN_PIXELS].iter().all(|x| {
        [-MARGIN_PIXELS, 1.0 + MARGIN_PIXELS].iter().all(|y| {
            let at = project(sample_from_film, [column + x, row + y]);
            at.is_some_and(|at| at.iter().all(|along| (0.0..=1.0).contains(along)))
        })
    })
}

/// Six planes of two squares of the same side, as half floats: the oblique view's first.
pub(super) fn planes(squares: &[Vec<[f32; 3]>; 2]) -> Vec<f16> {
    let channels = squares
        .iter()
        .flat_map(|square| (0..3).map(move |channel| (square, channel)));
    channels
        .flat_map(|(square, channel)| {
            square
                .iter()
                .map(move |pixel| f16::from_f32_const(pixel[channel]).min(f16::MAX))
        })
        .collect()
}
