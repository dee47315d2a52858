//! The scene of one view: bulb, sample, perhaps a chart, and the camera.

use crate::geometry::{
    BackendChoice, Geometry, GeometryError, Primitive, PrimitiveId, Ray, Rectangle, Sphere,
};
use crate::hybrid::chart::Panel;
use crate::vector::Vec3;
use dataset::specification::{Checker, Specification};

/// The sample.
pub const SAMPLE: PrimitiveId = PrimitiveId(0);
const BULB: PrimitiveId = PrimitiveId(1);
const CHART: PrimitiveId = PrimitiveId(2);

/// The least cosine from the camera's axis of what is projected.
const NEAREST_DEPTH: f64 = 1e-3;

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

/// The spherical emitter.
#[derive(Clone, Copy, Debug)]
pub struct Bulb {
    /// Its centre.
    pub centre: Vec3,
    /// Its radius.
    pub radius: f64,
    /// Its radiance. The irradiance at the origin is pi L (r/d)^2, so L = (d/r)^2 makes white 1.
    pub radiance: f64,
}

/// The rays of a pinhole camera.
#[derive(Clone, Copy, Debug)]
pub struct PinholeCamera {
    /// The pinhole.
    pub position: Vec3,
    forward: Vec3,
    /// A pixel to the right, at unit distance.
    column_step: Vec3,
    /// A pixel down, at unit distance.
    row_step: Vec3,
    /// The film's width and height in pixels.
    size: [u32; 2],
}

impl PinholeCamera {
    /// The same camera with `times` as many pixels along either side of the film.
    pub fn finer(&self, times: u32) -> Self {
        let step = 1.0 / f64::from(times);
        Self {
            column_step: self.column_step * step,
            row_step: self.row_step * step,
            size: self.size.map(|side| side * times),
            ..*self
        }
    }

    /// The ray through the film point (column, row) in pixels from the upper left corner.
    pub fn ray(&self, column: f64, row: f64) -> Ray {
        Ray {
            origin: self.position,
            direction: self.direction(column, row).normalized(),
        }
    }

    /// From the camera to the film point at unit depth: linear in column and row.
    pub fn direction(&self, column: f64, row: f64) -> Vec3 {
        let [width, height] = self.size.map(f64::from);
        self.forward
            + self.column_step * (column - 0.5 * width)
            + self.row_step * (row - 0.5 * height)
    }

    /// The film point (column, row) that sees a point; `None` for one that is not in front of the
    /// camera.
    pub fn project(&self, point: Vec3) -> Option<[f64; 2]> {
        let offset = point - self.position;
        let depth = offset.dot(self.forward);
        if depth <= NEAREST_DEPTH * offset.length() {
            return None;
        }
        let scale = 1.0 / (depth * self.pixel_size() * self.pixel_size());
        let [width, height] = self.size.map(f64::from);
        Some([
            0.5 * width + offset.dot(self.column_step) * scale,
            0.5 * height + offset.dot(self.row_step) * scale,
        ])
    }

    /// The film point (column, row) that an offset from the camera points to, times its depth, and
    /// its depth: linear in the offset, and negative behind the camera.
    pub fn homogeneous(&self, offset: Vec3) -> [f64; 3] {
        let depth = offset.dot(self.forward);
        let scale = 1.0 / (self.pixel_size() * self.pixel_size());
        let [width, height] = self.size.map(f64::from);
        [
            0.5 * width * depth + offset.dot(self.column_step) * scale,
            0.5 * height * depth + offset.dot(self.row_step) * scale,
            depth,
        ]
    }

    /// A pixel's side at unit distance.
    pub fn pixel_size(&self) -> f64 {
        self.column_step.length()
    }

    /// Whether a sphere may be on the film, or between the film and what it sees.
    pub fn may_see(&self, centre: Vec3, radius: f64) -> bool {
        let offset = centre - self.position;
        let distance = offset.length();
        if distance <= radius {
            return true;
        }
        let [width, height] = self.size.map(f64::from);
        let corner = 0.5 * self.pixel_size() * libm::hypot(width, height);
        let angle = libm::acos((offset.dot(self.forward) / distance).clamp(-1.0, 1.0));
        angle <= libm::atan(corner) + libm::asin(radius / distance)
    }
}

/// The colour chart: one rectangle that looks up its patch.
#[derive(Debug)]
pub struct Chart {
    frame: Frame,
    panel: Panel,
    /// Linear Rec.709, far row first.
    patches: Vec<[f64; 3]>,
}

impl Chart {
    /// Its place and division.
    pub fn panel(&self) -> Panel {
        self.panel
    }

    /// The patches' reflectances, linear Rec.709, far row first, each row from -x to +x.
    pub fn patches(&self) -> &[[f64; 3]] {
        &self.patches
    }

    /// The reflectance at (u, v) of the panel, v rising away from the sample.
    fn colour(&self, u: f64, v: f64) -> [f64; 3] {
        let cell =
            |position: f64, count: u32| ((position * f64::from(count)) as u32).min(count - 1);
        let Panel { columns, rows, .. } = self.panel;
        let row = rows - 1 - cell(v, rows);
        self.patches[(row * columns + cell(u, columns)) as usize]
    }
}

/// A right-handed orthonormal frame, z the normal of a surface.
#[derive(Clone, Copy, Debug)]
pub struct Frame {
    x: Vec3,
    y: Vec3,
    z: Vec3,
}

impl Frame {
    /// The frame of the sample: the world's.
    const WORLD: Self = Self {
        x: Vec3::new(1.0, 0.0, 0.0),
        y: Vec3::new(0.0, 1.0, 0.0),
        z: Vec3::new(0.0, 0.0, 1.0),
    };

    /// A world direction in the frame.
    pub fn to_local(&self, v: Vec3) -> Vec3 {
        Vec3::new(self.x.dot(v), self.y.dot(v), self.z.dot(v))
    }

    /// A direction of the frame in the world.
    pub fn to_world(&self, v: Vec3) -> Vec3 {
        self.x * v.x + self.y * v.y + self.z * v.z
    }
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
        let bulb = Bulb {
            centre: placement.light_position.into(),
            radius: specification.light.radius_m,
            radiance: {
                let ratio = specification.light.distance_m / specification.light.radius_m;
                ratio * ratio
            },
        };
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
            let (panel, chart) = chart(&specification.checker);
            primitives.push(Primitive::Rectangle(panel));
            chart
        });
        let axis = |index: usize| {
            Vec3::from(std::array::from_fn(|row| {
                placement.world_from_camera[row][index]
            }))
        };
        let pixel =
            2.0 * specification.camera.film_half_width / f64::from(specification.image.width);
        let camera = PinholeCamera {
            position: placement.camera_position.into(),
            forward: -axis(2),
            column_step: axis(0) * pixel,
            row_step: -axis(1) * pixel,
            size: [specification.image.width, specification.image.height],
        };
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

/// The chart's panel and its colours.
fn chart(checker: &Checker) -> (Rectangle, Chart) {
    let (sin, cos) = dataset::sin_cos_deg(checker.tilt_deg);
    let width = checker.pitch_m * f64::from(checker.columns);
    let height = checker.pitch_m * f64::from(checker.rows);
    let frame = Frame {
        x: Vec3::new(1.0, 0.0, 0.0),
        y: Vec3::new(0.0, cos, sin),
        z: Vec3::new(0.0, -sin, cos),
    };
    let corner = Vec3::new(-0.5 * width, checker.lower_edge_y_m, 0.0);
    let patches = checker
        .patches_srgb8
        .iter()
        .map(|patch| patch.map(|code| dataset::colour::linear_from_srgb(f64::from(code) / 255.0)))
        .collect();
    (
        Rectangle::new(corner, frame.x, frame.y, width, height),
        Chart {
            frame,
            panel: Panel {
                corner,
                x: frame.x,
                y: frame.y,
                z: frame.z,
                pitch: checker.pitch_m,
                columns: checker.columns,
                rows: checker.rows,
            },
            patches,
        },
    )
}
