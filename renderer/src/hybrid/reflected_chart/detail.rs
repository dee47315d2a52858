//! How fine the chart's image in the sample is on the film.

use crate::hybrid::budget::{
    Budget, chart_tile_pixels, edged_tile_pixels, mirror as mirror_budget, patch_tile_pixels,
};
use crate::hybrid::chart_on_film::project;
use crate::hybrid::view::View;
use crate::numerics::polygon::Rectangle;
use crate::reflectance::Reflectance;
use crate::scene::ChartPlane;
use crate::vector::Vec3;

/// How fine the chart's image in the sample is on the film.
pub struct Detail {
    /// The chart's image in a mirror; `None` where it reaches behind the camera.
    image: Option<Rectangle>,
    /// The sides of a patch in that image, in pixels.
    patch: [f64; 2],
    /// The blur of an edge in the middle of the chart along the lobe's narrow and wide axis, in
    /// pixels.
    blur: [f64; 2],
}

impl Detail {
    /// For a chart in whole patches.
    pub fn new(view: &View, plane: ChartPlane, reflectance: &Reflectance) -> Self {
        let [width, height] = plane.size();
        let distance = 0.5 * (plane.corner.y.abs() + height);
        let lobe = &reflectance.lobe;
        let corners = [[0.0, 0.0], [width, 0.0], [width, height], [0.0, height]].map(|[a, b]| {
            let corner = plane.point(a, b);
            Vec3::new(corner.x, corner.y, -corner.z)
        });
        let image = project(&view.camera, corners).map(|outline| outline.bounds());
        let counts = [plane.columns, plane.rows].map(f64::from);
        Self {
            patch: image.map_or([f64::INFINITY; 2], |image| {
                let sides = image.sides();
                std::array::from_fn(|axis| sides[axis] / counts[axis])
            }),
            image,
            blur: [lobe.n_u, lobe.n_v].map(|n| view.slope_pixels((1.0 / n).sqrt(), distance)),
        }
    }

    /// The side in pixels of a tile at whose nodes a patch shows, `times` the one that its blurred edge
    /// asks for.
    pub fn side_max(&self, times: f64) -> f64 {
        let side = times * edged_tile_pixels(self.blur[0]);
        let patch = self.patch[0].min(self.patch[1]);
        if self.blur[1] < patch {
            side.min(patch_tile_pixels(patch))
        } else {
            side
        }
    }

    /// How many times as many pixels along either side a film takes on which a patch's image is
    /// [`PATCH_MIN`](mirror_budget::PATCH_MIN) of them: 1 where this one does, or the image reaches behind the camera.
    pub fn finer_times(&self) -> f64 {
        // On the finer film the quotient is 1, or a rounding above it.
        const ROUNDING: f64 = 1e-9;
        let patch = self.patch[0].min(self.patch[1]);
        (mirror_budget::PATCH_MIN / patch - ROUNDING)
            .ceil()
            .max(1.0)
    }

    /// Whether the lobe blurs edges by so little that pixels are worked out one by one, on a film with `times` as many
    /// along either side.
    pub fn is_near_mirror(&self, budget: &Budget, times: f64) -> bool {
        times * self.blur[0].max(self.blur[1]) <= budget.mirror_blur_max()
    }

    /// The part of the film around the chart's image in a near mirror; `None` where the lobe blurs it by too much,
    /// patches are small, or it is too large.
    pub fn around_mirror_image(&self, budget: &Budget, film: &Rectangle) -> Option<Rectangle> {
        if !self.is_near_mirror(budget, 1.0) || self.finer_times() > 1.0 {
            return None;
        }
        let image = self.image?;
        let around = Rectangle {
            low: image.low.map(|low| (low - mirror_budget::MARGIN).floor()),
            high: image.high.map(|high| (high + mirror_budget::MARGIN).ceil()),
        };
        let around = around.intersection(film)?;
        (around.area() <= mirror_budget::PIXELS_MAX).then_some(around)
    }

    /// All of the chart, where it is too sharp to show far outside of it, or so small that it could hide
    /// between the nodes of a tile of this side: beside the sample a small chart is bright.
    pub fn feature(&self, side: f64) -> Option<Rectangle> {
        self.image.filter(|image| {
            let [width, height] = image.sides();
            let least = width.min(height);
            self.blur[0] < least || chart_tile_pixels(least) < side
        })
    }
}
