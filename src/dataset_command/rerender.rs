//! The renderer that checking and mending a store borrows.

use dataset::{Specification, specification::Shape};
use datastore::verify::{Rerender, Rerendered};
use renderer::geometry::BackendChoice;
use renderer::reflectance::Reflectance;
use renderer::scene::{SampleSurface, Scene};
use renderer::vector::Vec3;
use renderer::{RenderError, Renderer};
use std::f64::consts::PI;
use std::sync::OnceLock;

/// The radiance, in units of white, of a place that is certainly not black in an image. What counts
/// as black is below the smallest 16-bit float, a ten-thousandth of it.
const LIT_MIN: f64 = 1e-3;

/// Where on the sample light is looked for, along each side, as fractions of it from the centre.
const PLACES: [f64; 3] = [-0.3, 0.0, 0.3];

/// A renderer for one specification. It is built when the first image is rendered.
pub struct Again {
    specification: Specification,
    backend: BackendChoice,
    scenes: Vec<Scene>,
    renderer: OnceLock<Result<Renderer, String>>,
}

impl Again {
    /// For images of a specification.
    pub fn new(specification: &Specification, backend: BackendChoice) -> anyhow::Result<Self> {
        let native = BackendChoice::Native;
        let sample =
            SampleSurface::new(&specification.sample, native).map_err(RenderError::from)?;
        let scenes = (0..specification.views.len())
            .filter_map(|view| Scene::with_sample(specification, view, &sample, native))
            .collect::<Result<Vec<Scene>, _>>()
            .map_err(RenderError::from)?;
        Ok(Self {
            specification: specification.clone(),
            backend,
            scenes,
            renderer: OnceLock::new(),
        })
    }
}

impl Rerender for Again {
    fn render(&self, material: u32, view: u32) -> Result<Rerendered, String> {
        let renderer = self.renderer.get_or_init(|| {
            Renderer::new(&self.specification, self.backend).map_err(|error| error.to_string())
        });
        let renderer = renderer.as_ref().map_err(Clone::clone)?;
        let parameters = self.specification.material(material).material;
        let rendering = renderer
            .render(&parameters, Some(material), view)
            .map_err(|error| error.to_string())?;
        Ok(Rerendered {
            bytes: rendering.exr,
            statistics: rendering.statistics,
            pixels: rendering.pixels,
        })
    }

    fn must_be_lit(&self, material: u32, view: u32) -> bool {
        let index = view as usize;
        let (Some(scene), Some(view)) =
            (self.scenes.get(index), self.specification.views.get(index))
        else {
            return false;
        };
        let parameters = self.specification.material(material).material;
        let reflectance = Reflectance::new(&parameters, view.rotation_deg, self.specification.tint);
        sees_chart(scene, &self.specification)
            || sample_is_lit(scene, &self.specification, &reflectance)
    }
}

/// Whether the middle of a patch that reflects is on the film, seen and lit from its front. Nothing
/// stands before the chart.
fn sees_chart(scene: &Scene, specification: &Specification) -> bool {
    let Some(chart) = &scene.chart else {
        return false;
    };
    let plane = chart.plane();
    let faces = |from: Vec3| (from - plane.corner).dot(plane.z) > 0.0;
    if !faces(scene.camera.position) || !faces(scene.bulb.centre) {
        return false;
    }
    let (width, height) = (specification.image.width, specification.image.height);
    (0..plane.rows * plane.columns).any(|index| {
        let [column, row] = plane.cell(index as usize);
        let along = |number: u32| (f64::from(number) + 0.5) * plane.pitch;
        let middle = plane.corner + plane.x * along(column) + plane.y * along(row);
        let on_film = scene.camera.project(middle).is_some_and(|[x, y]| {
            (0.0..f64::from(width)).contains(&x) && (0.0..f64::from(height)).contains(&y)
        });
        let brightest = chart.patches()[index as usize]
            .into_iter()
            .fold(0.0, f64::max);
        on_film && brightest > LIT_MIN
    })
}

/// Whether the sample reflects the middle of the bulb to the camera somewhere on the film.
fn sample_is_lit(scene: &Scene, specification: &Specification, reflectance: &Reflectance) -> bool {
    // A curved sample touches the plane of the square at the origin alone, and a mesh somewhere.
    let side = match specification.sample.shape {
        Shape::Square => specification.sample.side_m,
        Shape::Sphere | Shape::Cylinder => 0.0,
        Shape::Mesh => return false,
    };
    let (width, height) = (specification.image.width, specification.image.height);
    let mut places = PLACES
        .iter()
        .flat_map(|x| PLACES.map(|y| Vec3::new(x * side, y * side, 0.0)));
    places.any(|place| {
        let on_film = scene.camera.project(place).is_some_and(|[x, y]| {
            (0.0..f64::from(width)).contains(&x) && (0.0..f64::from(height)).contains(&y)
        });
        let to_bulb = scene.bulb.centre - place;
        let (wi, wo) = (
            to_bulb.normalized(),
            (scene.camera.position - place).normalized(),
        );
        if !on_film || wi.z <= 0.0 || wo.z <= 0.0 {
            return false;
        }
        // White at the origin, facing the bulb, is 1.
        let distance = to_bulb.length() / specification.light.distance_m;
        let scale = PI * wi.z / (distance * distance);
        let radiance = reflectance.evaluate(wi, wo).map(|channel| channel * scale);
        radiance.into_iter().fold(0.0, f64::max) > LIT_MIN
    })
}
