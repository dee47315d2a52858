//! The scene of one view: bulb, sample, perhaps a chart, and the camera.

mod bulb;
mod camera;
mod chart;
mod frame;
mod mesh_surface;
mod sample;
mod smooth_surface;

pub use bulb::Bulb;
pub use camera::PinholeCamera;
pub use chart::{Chart, ChartPlane};
pub use frame::Frame;
pub use mesh_surface::{Corners, MeshPoint, MeshSurface, OnTriangle};
pub use sample::SampleSurface;
pub use smooth_surface::{MirrorPoint, SmoothSurface};

use crate::geometry::{
    BackendChoice, Geometry, GeometryError, Hit, Primitive, PrimitiveId, Ray, Rectangle, Sphere,
};
use crate::vector::Vec3;
use dataset::specification::Specification;
use std::sync::Arc;

/// A thing of the scene that rays meet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Thing {
    /// The sample.
    Sample,
    /// The bulb.
    Bulb,
    /// The chart.
    Chart,
}

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
    /// What each primitive of the geometry is. Triangles are the sample's.
    things: Vec<Thing>,
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
    /// The sample or the chart.
    pub thing: Thing,
    /// On which primitive; a ray that leaves it cannot meet it again.
    pub primitive: PrimitiveId,
    /// The patch's colour on the chart, none on the sample.
    pub patch: Option<[f64; 3]>,
    /// The place on a mesh.
    pub on_triangle: Option<OnTriangle>,
    /// The unit normal of a mesh's triangle, where that is not the frame's.
    facet: Option<Vec3>,
}

impl Surface {
    /// A place on a sample that is not flat.
    #[cfg(test)]
    pub fn of_curved_sample(position: Vec3, normal: Vec3) -> Self {
        Self {
            position,
            frame: Frame::carried(normal),
            thing: Thing::Sample,
            primitive: PrimitiveId(0),
            patch: None,
            on_triangle: None,
            facet: None,
        }
    }

    /// Whether a direction points into the surface, although it may be above the frame's horizon.
    pub fn is_behind(&self, direction: Vec3) -> bool {
        self.facet.is_some_and(|facet| facet.dot(direction) <= 0.0)
    }
}

/// What light scattered at a surface can meet.
#[derive(Clone, Copy, Debug)]
pub enum Facing<'a> {
    /// A flat surface.
    Rectangle(&'a Rectangle),
    /// A curved one, in this ball.
    Ball(Sphere),
    /// The surface itself, and the chart if there is one.
    Itself(Option<&'a Rectangle>),
}

impl Scene {
    /// The scene of view `view` of `specification`, or `None` where it has no such view.
    pub fn new(
        specification: &Specification,
        view: usize,
        backend: BackendChoice,
    ) -> Option<Result<Self, GeometryError>> {
        specification.views.get(view)?;
        match SampleSurface::new(&specification.sample, backend) {
            Ok(sample) => Self::with_sample(specification, view, &sample, backend),
            Err(error) => Some(Err(error)),
        }
    }

    /// The same with the surface of the specification's sample at hand: scenes of many views share one.
    pub fn with_sample(
        specification: &Specification,
        view: usize,
        sample: &SampleSurface,
        backend: BackendChoice,
    ) -> Option<Result<Self, GeometryError>> {
        let placement = specification.view_geometry(view)?;
        let bulb = Bulb::new(&specification.light, placement.light_position.into());
        let chart = specification.views[view]
            .checker
            .then(|| Chart::new(&specification.checker));
        let of_sample = match sample {
            SampleSurface::Smooth(smooth) => Some((Thing::Sample, smooth.primitive())),
            SampleSurface::Mesh(_) => None,
        };
        let of_bulb = Primitive::Sphere(Sphere {
            centre: bulb.centre,
            radius: bulb.radius,
        });
        let of_chart = chart.as_ref().map(|chart| {
            let rectangle = Primitive::Rectangle(chart.rectangle());
            (Thing::Chart, rectangle)
        });
        let all = of_sample
            .into_iter()
            .chain([(Thing::Bulb, of_bulb)])
            .chain(of_chart);
        let (things, primitives) = all.unzip();
        let geometry = match sample {
            SampleSurface::Smooth(_) => Geometry::new(primitives, backend),
            SampleSurface::Mesh(mesh) => Geometry::with_mesh(primitives, Arc::clone(mesh.traced())),
        };
        let camera = PinholeCamera::new(specification, &placement);
        let may_shade = may_shade(sample, chart.as_ref(), &bulb);
        Some(geometry.map(|geometry| Self {
            bulb,
            geometry,
            sample: sample.clone(),
            camera,
            chart,
            things,
            may_shade,
        }))
    }

    /// What `ray` meets first; `from` is the surface it leaves.
    pub fn encounter(&self, ray: &Ray, from: Option<PrimitiveId>) -> Option<Encounter> {
        let hit = self.geometry.intersect(ray, from)?;
        let position = ray.origin + ray.direction * hit.distance;
        let surface = match (self.thing(hit.primitive), &self.chart, &self.sample) {
            (Thing::Bulb, ..) => return Some(Encounter::Bulb),
            (Thing::Chart, Some(chart), _) => Surface {
                position,
                frame: chart.frame,
                thing: Thing::Chart,
                primitive: hit.primitive,
                patch: Some(chart.colour(hit.u, hit.v)),
                on_triangle: None,
                facet: None,
            },
            (_, _, SampleSurface::Smooth(smooth)) => Surface {
                position,
                frame: smooth.frame(position),
                thing: Thing::Sample,
                primitive: hit.primitive,
                patch: None,
                on_triangle: None,
                facet: None,
            },
            (_, _, SampleSurface::Mesh(mesh)) => on_mesh(mesh, &hit),
        };
        let is_black =
            ray.direction.dot(surface.frame.z) >= 0.0 || surface.is_behind(-ray.direction);
        Some(if is_black {
            Encounter::Black
        } else {
            Encounter::Surface(surface)
        })
    }

    /// What a primitive of the geometry is.
    fn thing(&self, primitive: PrimitiveId) -> Thing {
        let of_primitive = self.things.get(primitive.0 as usize).copied();
        of_primitive.unwrap_or(Thing::Sample)
    }

    /// What light scattered at the sample or the chart can meet: the chart from the sample, the sample from
    /// the chart. No sample but a mesh sees itself.
    pub fn facing(&self, thing: Thing) -> Option<Facing<'_>> {
        match (thing, &self.sample) {
            (Thing::Sample, SampleSurface::Smooth(_)) => {
                self.chart_rectangle().map(Facing::Rectangle)
            }
            (Thing::Sample, SampleSurface::Mesh(_)) => Some(Facing::Itself(self.chart_rectangle())),
            (_, SampleSurface::Smooth(SmoothSurface::Square(square))) => {
                Some(Facing::Rectangle(square))
            }
            (_, sample) => Some(Facing::Ball(sample.ball())),
        }
    }

    /// The chart's rectangle, where there is a chart.
    pub fn chart_rectangle(&self) -> Option<&Rectangle> {
        let place = self.things.iter().position(|thing| *thing == Thing::Chart);
        match self.geometry.primitives().get(place?) {
            Some(Primitive::Rectangle(rectangle)) => Some(rectangle),
            _ => None,
        }
    }

    /// The bulb.
    fn bulb_primitive(&self) -> Option<PrimitiveId> {
        let place = self.things.iter().position(|thing| *thing == Thing::Bulb);
        place.map(|place| PrimitiveId(place as u32))
    }

    /// Whether anything stands between a surface and the bulb, `distance` along `ray`. Where nothing
    /// can, no ray is traced.
    pub fn shadowed(&self, ray: &Ray, from: PrimitiveId, distance: f64) -> bool {
        self.may_shade
            && self
                .geometry
                .occluded(ray, Some(from), self.bulb_primitive(), distance)
    }
}

fn on_mesh(mesh: &MeshSurface, hit: &Hit) -> Surface {
    let at = OnTriangle {
        triangle: MeshSurface::triangle(hit.primitive).unwrap_or(0),
        weights: [hit.u, hit.v],
    };
    let point = mesh.point(at);
    Surface {
        position: point.position,
        frame: point.frame,
        thing: Thing::Sample,
        primitive: hit.primitive,
        patch: None,
        on_triangle: Some(at),
        facet: Some(point.facet),
    }
}

/// Whether sample or chart may stand between the bulb and either of them. A flat one does not, unless
/// all of both is on one side of its plane.
fn may_shade(sample: &SampleSurface, chart: Option<&Chart>, bulb: &Bulb) -> bool {
    let (SampleSurface::Smooth(smooth), Some(chart)) = (sample, chart) else {
        return sample.mesh().is_some();
    };
    let SmoothSurface::Square(square) = smooth else {
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
