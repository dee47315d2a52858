//! The scene of one view: bulb, sample, perhaps a chart, and the camera.

mod bulb;
mod camera;
mod chart;
mod frame;
mod sample;

pub use bulb::Bulb;
pub use camera::PinholeCamera;
pub use chart::{Chart, ChartPlane};
pub use frame::Frame;
pub use sample::{MirrorPoint, SampleSurface};

use crate::geometry::{
    BackendChoice, Geometry, GeometryError, Primitive, PrimitiveId, Ray, Rectangle, Sphere,
};
use crate::vector::Vec3;
use dataset::specification::Specification;

/// The sample.
pub const SAMPLE: PrimitiveId = PrimitiveId(0);
const BULB: PrimitiveId = PrimitiveId(1);
/// The chart, where there is one.
pub const CHART: PrimitiveId = PrimitiveId(2);

/// A view's scene. Radiance is in units of white: that of a perfect diffuser at the origin which
/// faces the bulb.
#[derive(Debug)]
pub struct Scene {
    /// The bulb.
    pub bulb: Bulb,
    /// Who can be hit.
    pub geometry: Geometry,
    /// The surface of the sample.
    pub sample: SampleSurface,
    /// The camera.
    pub camera: PinholeCamera,
    /// The colour chart, if it is there.
    pub chart: Option<Chart>,
    /// Whether sample or chart may stand between the bulb and either of them.
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

/// What light scattered at a surface can meet.
#[derive(Clone, Copy, Debug)]
pub enum Facing<'a> {
    /// A flat surface.
    Rectangle(&'a Rectangle),
    /// A curved one, in this ball.
    Ball(Sphere),
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
        let sample = SampleSurface::new(&specification.sample);
        let mut primitives = vec![
            sample.primitive(),
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
        let may_shade = may_shade(&sample, chart.as_ref(), &bulb);
        Some(Geometry::new(primitives, backend).map(|geometry| Self {
            bulb,
            geometry,
            sample,
            camera,
            chart,
            may_shade,
        }))
    }

    /// What `ray` meets first; `from` is the surface it leaves.
    pub fn encounter(&self, ray: &Ray, from: Option<PrimitiveId>) -> Option<Encounter> {
        let hit = self.geometry.intersect(ray, from)?;
        let position = ray.origin + ray.direction * hit.distance;
        let (frame, patch) = match (hit.primitive, &self.chart) {
            (BULB, _) => return Some(Encounter::Bulb),
            (CHART, Some(chart)) => (chart.frame, Some(chart.colour(hit.u, hit.v))),
            _ => (self.sample.frame(position), None),
        };
        if ray.direction.dot(frame.z) >= 0.0 {
            return Some(Encounter::Black);
        }
        Some(Encounter::Surface(Surface {
            position,
            frame,
            primitive: hit.primitive,
            patch,
        }))
    }

    /// What light scattered at `surface` can meet: the chart from the sample, the sample from the
    /// chart. No sample sees itself.
    pub fn facing(&self, surface: PrimitiveId) -> Option<Facing<'_>> {
        if surface == SAMPLE {
            return self.chart_rectangle().map(Facing::Rectangle);
        }
        Some(match &self.sample {
            SampleSurface::Square(square) => Facing::Rectangle(square),
            curved => Facing::Ball(curved.ball()),
        })
    }

    /// The chart and its rectangle, where there is one.
    pub fn chart_rectangle(&self) -> Option<&Rectangle> {
        match self.geometry.primitives().get(CHART.0 as usize) {
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

/// Whether sample or chart may stand between the bulb and either of them. A flat one does not, unless
/// all of both is on one side of its plane.
fn may_shade(sample: &SampleSurface, chart: Option<&Chart>, bulb: &Bulb) -> bool {
    let Some(chart) = chart else {
        return false;
    };
    let SampleSurface::Square(square) = sample else {
        return true;
    };
    let chart = chart.rectangle();
    [(square, &chart), (&chart, square)]
        .into_iter()
        .any(|(plane, other)| {
            let height = |point: Vec3| plane.normal.dot(point - plane.corner);
            height(bulb.centre) <= bulb.radius
                || other.corners().into_iter().any(|at| height(at) < 0.0)
        })
}
