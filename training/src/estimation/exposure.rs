//! How bright a photograph is: the gain of each channel, from a colour chart beside the sample.
//!
//! The scene is rendered on a film that shows the whole chart. The gain is the factor that takes the
//! rendered patches to the photographed ones, by least squares in linear light.

use super::corners::{Corners, project};
use super::photograph::Photograph;
use crate::error::TrainingError;
use dataset::specification::{Checker, limits};
use dataset::{Material, Specification, sin_cos_deg};
use renderer::Renderer;
use renderer::geometry::BackendChoice;
use std::ops::RangeInclusive;

/// What a photograph's channels are multiplied by: linear photograph = gain x units of white.
pub type Gain = [f64; 3];

/// Gains that a photograph may have: what is brighter or darker shows nothing of a sample.
pub const GAIN_RANGE: RangeInclusive<f64> = 1e-6..=1e6;

/// Pixels a side of the film that shows the chart.
const FILM_PIXELS: u32 = 256;

/// Its tolerance, relative to a pixel's value.
const RELATIVE_ACCURACY: f64 = 3e-3;

/// How much wider the film is than the chart.
const MARGIN: f64 = 1.02;

/// A patch is read in its middle, 60 percent a side: corners that a person marks are off by a few
/// pixels, and patches have frames.
const MIDDLE: RangeInclusive<f64> = 0.2..=0.8;

/// The fewest pixels of a patch that count.
const PIXELS_MIN: usize = 4;

/// The fewest patches of which a gain is found.
const PATCHES_MIN: usize = 3;

/// The chart as one view's camera sees it.
pub(super) struct ChartView {
    renderer: Renderer,
    checker: Checker,
    // On the film.
    corners: Corners,
}

impl ChartView {
    /// The chart in a view of a specification; `None` where the view has none or its camera does
    /// not see all of it.
    pub fn new(specification: &Specification, view: u32) -> Result<Option<Self>, TrainingError> {
        let mut wide = specification.clone();
        wide.views = specification
            .views
            .get(view as usize)
            .cloned()
            .into_iter()
            .collect();
        let Some(corners) = chart_at_unit_distance(&wide) else {
            return Ok(None);
        };
        let reach = corners
            .iter()
            .flatten()
            .fold(0.0, |most: f64, at| most.max(at.abs()));
        let half = MARGIN * reach;
        if !limits::FILM_HALF_WIDTH.contains(&half) {
            return Ok(None);
        }
        wide.camera.film_half_width = half;
        (wide.image.width, wide.image.height) = (FILM_PIXELS, FILM_PIXELS);
        wide.accuracy.relative = RELATIVE_ACCURACY;
        let middle = f64::from(FILM_PIXELS) / 2.0;
        let renderer = Renderer::new(&wide, BackendChoice::Native);
        Ok(Some(Self {
            renderer: renderer.map_err(|error| TrainingError::Render(error.to_string()))?,
            checker: specification.checker.clone(),
            corners: Corners(
                corners.map(|[x, y]| [middle * (1.0 + x / half), middle * (1.0 - y / half)]),
            ),
        }))
    }

    /// The gain of a photograph of this scene with a sample of `material`, whose chart has these
    /// corners in the photograph.
    ///
    /// # Errors
    /// When too few patches are to be seen, or the photograph is black.
    pub fn gain(
        &self,
        material: &Material,
        photograph: &Photograph,
        corners: &Corners,
    ) -> Result<Gain, TrainingError> {
        let rendering = self.renderer.render(material, None, 0);
        let film = rendering
            .map_err(|error| TrainingError::Render(error.to_string()))?
            .film;
        let scene = Photograph {
            size: [film.width, film.height],
            clipped: vec![false; film.pixels.len()],
            pixels: film
                .pixels
                .iter()
                .map(|pixel| pixel.value.map(|v| v as f32))
                .collect(),
            header: None,
        };
        let rendered = patches(&scene, &self.corners, &self.checker);
        let seen = patches(photograph, corners, &self.checker);
        let pairs: Vec<([f64; 3], [f64; 3])> = rendered
            .into_iter()
            .zip(seen)
            .filter_map(|(rendered, seen)| rendered.zip(seen))
            .collect();
        if pairs.len() < PATCHES_MIN {
            return Err(TrainingError::Input(format!(
                "{} patches of the chart are in the photograph and below white, where \
                 {PATCHES_MIN} are the fewest: expose less, or give the gain",
                pairs.len()
            )));
        }
        let gain: Gain = std::array::from_fn(|channel| {
            let products = pairs
                .iter()
                .map(|(scene, seen)| scene[channel] * seen[channel]);
            let squares = pairs
                .iter()
                .map(|(scene, _)| scene[channel] * scene[channel]);
            products.sum::<f64>() / squares.sum::<f64>()
        });
        match gain.iter().all(|gain| GAIN_RANGE.contains(gain)) {
            true => Ok(gain),
            false => Err(TrainingError::Input(
                "the chart is black in the photograph: check its corners, or give the gain"
                    .to_owned(),
            )),
        }
    }
}

/// The chart's corners as the only view's camera sees them: x to the right, y up, at unit distance.
fn chart_at_unit_distance(specification: &Specification) -> Option<[[f64; 2]; 4]> {
    specification.views.first().filter(|view| view.checker)?;
    let geometry = specification.view_geometry(0)?;
    let checker = &specification.checker;
    let half_width = 0.5 * f64::from(checker.columns) * checker.pitch_m;
    let height = f64::from(checker.rows) * checker.pitch_m;
    let (sine, cosine) = sin_cos_deg(checker.tilt_deg);
    let corner = |x: f64, up: f64| {
        let world = [x, checker.lower_edge_y_m + up * cosine, up * sine];
        let from: [f64; 3] =
            std::array::from_fn(|axis| world[axis] - geometry.camera_position[axis]);
        let along = |axis: usize| {
            (0..3)
                .map(|row| geometry.world_from_camera[row][axis] * from[row])
                .sum::<f64>()
        };
        let depth = -along(2);
        (depth > 0.0).then(|| [along(0) / depth, along(1) / depth])
    };
    Some([
        corner(-half_width, 0.0)?,
        corner(half_width, 0.0)?,
        corner(half_width, height)?,
        corner(-half_width, height)?,
    ])
}

/// The mean of each patch's middle; `None` where it leaves the image, is too small or clipped.
fn patches(image: &Photograph, corners: &Corners, checker: &Checker) -> Vec<Option<[f64; 3]>> {
    let [columns, rows] = [checker.columns, checker.rows].map(f64::from);
    let (forth, back) = (corners.image_from_square(), corners.square_from_image());
    let count = (checker.columns * checker.rows) as usize;
    let mut found = vec![Patch::default(); count];
    for (place, pixel) in image.pixels.iter().enumerate() {
        let width = image.size[0] as usize;
        let centre = [(place % width) as f64 + 0.5, (place / width) as f64 + 0.5];
        let Some([s, t]) = project(&back, centre) else {
            continue;
        };
        let (across, up) = (s * columns, t * rows);
        let inside = (0.0..columns).contains(&across) && (0.0..rows).contains(&up);
        if inside && MIDDLE.contains(&across.fract()) && MIDDLE.contains(&up.fract()) {
            let patch = up as usize * checker.columns as usize + across as usize;
            found[patch].add(*pixel, image.clipped[place]);
        }
    }
    let on_image = |patch: usize| {
        let column = (patch as u32 % checker.columns) as f64;
        let row = (patch as u32 / checker.columns) as f64;
        [MIDDLE.start(), MIDDLE.end()].iter().all(|across| {
            [MIDDLE.start(), MIDDLE.end()].iter().all(|up| {
                let point = project(&forth, [(column + *across) / columns, (row + *up) / rows]);
                point.is_some_and(|point| image.contains(point))
            })
        })
    };
    let means = found.iter().enumerate();
    means
        .map(|(patch, found)| found.mean().filter(|_| on_image(patch)))
        .collect()
}

#[derive(Clone, Copy, Default)]
struct Patch {
    sum: [f64; 3],
    pixels: usize,
    clipped: bool,
}

impl Patch {
    fn add(&mut self, pixel: [f32; 3], clipped: bool) {
        for (sum, channel) in self.sum.iter_mut().zip(pixel) {
            *sum += f64::from(channel);
        }
        self.pixels += 1;
        self.clipped |= clipped;
    }

    fn mean(&self) -> Option<[f64; 3]> {
        let enough = self.pixels >= PIXELS_MIN && !self.clipped;
        enough.then(|| self.sum.map(|sum| sum / self.pixels as f64))
    }
}
