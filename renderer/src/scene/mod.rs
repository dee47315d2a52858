//! The scene of one view: bulb, sample, perhaps a chart, and the camera.

mod bulb;
mod camera;
mod chart;
mod frame;

pub use bulb::Bulb;
pub use camera::PinholeCamera;
pub use chart::{Chart, ChartPlane};
pub use frame::Frame;

use crate::geometry::{
    BackendChoice, Geometry, GeometryError, Primitive, PrimitiveId, Ray, Rectangle, Sphere,
};
use crate::vector::Vec3;
use dataset::specification::Specification;

/// The sample.
pub const SAMPLE: PrimitiveId = PrimitiveId(0);
const BULB: PrimitiveId = PrimitiveId(1);
const CHART: PrimitiveId = PrimitiveId(2);

/// A view's scene. Radiance is in units of white: that of a perfect diffuser at the origin which
/// faces the bulb.
#[derive(Debug)]
pub struct Scene {
    /// The bulb.
    pub bulb: Bulb,
    /// Who can be hit.
    pub geometry: Geometry,
    /// The camera.
    pub camera: PinholeCamera,
    /// The colour chart, if it is there.
    pub chart: Option<Chart>,
    /// Whether the sample or the chart may stand between the other and the bulb.
    may_shade: bool,
}

/// What a ray meets.
#[derive(Clone, Copy, Debug)]
pub enum Encounter {
    /// The bulb.
    Bulb,
    /// A surface that scatters, seen from its front.
    Surface(Surface),
    /// The black back of the sample or the chart.
    Black,
}

/// A point of a scattering surface.
#[derive(Clone, Copy, Debug)]
pub struct Surface {
    /// Where.
    pub position: Vec3,
    /// The frame there.
    pub frame: Frame,
    /// On which primitive; a ray that leaves it cannot meet it again.
    pub primitive: PrimitiveId,
    /// The patch's colour on the chart, none on the sample.
    pub patch: Option<[f64; 3]>,
}

impl Scene {
    /// The scene of view `view` of `specification`, or `None` where it has no such view.
    pub fn new(
        specification: &Specification,
        view: usize,
        backend: BackendChoice,
    ) -> Option<Result<Self, GeometryError>> {
        let placement = specification.view_geometry(view)?;
        let bulb = Bulb::new(&specification.light, placement.light_position.into());
        let side = specification.sample.side_m;
        let sample = Rectangle::new(
            Vec3::new(-0.5 * side, -0.5 * side, 0.0),
            Frame::WORLD.x,
            Frame::WORLD.y,
            side,
            side,
        );
        let mut primitives = vec![
            Primitive::Rectangle(sample),
            Primitive::Sphere(Sphere {
                centre: bulb.centre,
                radius: bulb.radius,
            }),
        ];
        let chart = specification.views[view].checker.then(|| {
            let chart = Chart::new(&specification.checker);
            primitives.push(Primitive::Rectangle(chart.rectangle()));
            chart
        });
        let camera = PinholeCamera::new(specification, &placement);
        let may_shade = may_shade(&primitives, &bulb);
        Some(Geometry::new(primitives, backend).map(|geometry| Self {
            bulb,
            geometry,
            camera,
            chart,
            may_shade,
        }))
    }

    /// What `ray` meets first; `from` is the surface it leaves.
    pub fn encounter(&self, ray: &Ray, from: Option<PrimitiveId>) -> Option<Encounter> {
        let hit = self.geometry.intersect(ray, from)?;
        let (frame, patch) = match (hit.primitive, &self.chart) {
            (BULB, _) => return Some(Encounter::Bulb),
            (CHART, Some(chart)) => (chart.frame, Some(chart.colour(hit.u, hit.v))),
            _ => (Frame::WORLD, None),
        };
        if ray.direction.dot(frame.z) >= 0.0 {
            return Some(Encounter::Black);
        }
        Some(Encounter::Surface(Surface {
            position: ray.origin + ray.direction * hit.distance,
            frame,
            primitive: hit.primitive,
            patch,
        }))
    }

    /// The sample and, where there is one, the chart: every surface that scatters.
    pub fn rectangles(&self) -> impl Iterator<Item = (PrimitiveId, &Rectangle)> {
        let primitives = self.geometry.primitives().iter();
        (0..)
            .map(PrimitiveId)
            .zip(primitives)
            .filter_map(|(id, primitive)| match primitive {
                Primitive::Rectangle(rectangle) => Some((id, rectangle)),
                Primitive::Sphere(_) => None,
            })
    }

    /// The one surface that light scattered at `surface` can meet: the chart from the sample, the
    /// sample from the chart.
    pub fn facing(&self, surface: PrimitiveId) -> Option<&Rectangle> {
        let other = if surface == SAMPLE { CHART } else { SAMPLE };
        match self.geometry.primitives().get(other.0 as usize) {
            Some(Primitive::Rectangle(rectangle)) => Some(rectangle),
            _ => None,
        }
    }

    /// Whether anything stands between a surface and the bulb, `distance` along `ray`. Where nothing
    /// can, no ray is traced.
    pub fn shadowed(&self, ray: &Ray, from: PrimitiveId, distance: f64) -> bool {
        self.may_shade
            && self
                .geometry
                .occluded(ray, Some(from), Some(BULB), distance)
    }
}

/// Whether a rectangle may stand between another and the bulb: unless all of both is on one side of
/// its plane.
fn may_shade(primitives: &[Primitive], bulb: &Bulb) -> bool {
    let rectangles: Vec<&Rectangle> = primitives
        .iter()
        .filter_map(|primitive| match primitive {
            Primitive::Rectangle(rectangle) => Some(rectangle),
            Primitive::Sphere(_) => None,
        })
        .collect();
    rectangles.iter().enumerate().any(|(index, plane)| {
        let height = |point: Vec3| plane.normal.dot(point - plane.corner);
        let others = rectangles.iter().enumerate();
        let mut others = others.filter(|(other, _)| *other != index).peekable();
        others.peek().is_some()
            && (height(bulb.centre) <= bulb.radius
                || others.any(|(_, other)| other.corners().into_iter().any(|at| height(at) < 0.0)))
    })
}
