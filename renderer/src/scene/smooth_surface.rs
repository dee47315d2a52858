//! A sample of a shape with a formula: where its surface is, and how it lies there.

use super::frame::Frame;
use crate::geometry::{Cylinder, Primitive, Rectangle, Sphere};
use crate::vector::Vec3;
use dataset::specification::{Sample, Shape};

/// Halvings of an angle until it is as exact as a float.
const HALVINGS: u32 = 60;

/// The surface of a sample that a formula gives.
#[derive(Clone, Copy, Debug)]
pub enum SmoothSurface {
    /// A square in z = 0.
    Square(Rectangle),
    /// A sphere below the origin, which it touches.
    Sphere(Sphere),
    /// A cylinder along x below the origin, which it touches.
    Cylinder(Cylinder),
}

/// Where a surface turns light of one point to another.
#[derive(Clone, Copy, Debug)]
pub struct MirrorPoint {
    /// Where.
    pub position: Vec3,
    /// The frame of the material there.
    pub frame: Frame,
    /// One over the radii by which the surface falls away along x and y of the frame, a metre.
    pub curvature: [f64; 2],
}

impl SmoothSurface {
    /// The surface of a specification's sample; `None` where that is a mesh.
    pub(super) fn new(sample: &Sample) -> Option<Self> {
        let (side, radius) = (sample.side_m, 0.5 * sample.side_m);
        Some(match sample.shape {
            Shape::Square => {
                let corner = Vec3::new(-radius, -radius, 0.0);
                let Frame { x, y, .. } = Frame::WORLD;
                Self::Square(Rectangle::new(corner, x, y, side, side))
            }
            Shape::Sphere => Self::Sphere(Sphere {
                centre: Vec3::new(0.0, 0.0, -radius),
                radius,
            }),
            Shape::Cylinder => Self::Cylinder(Cylinder {
                start: Vec3::new(-0.5 * side, 0.0, -radius),
                axis: Frame::WORLD.x,
                radius,
                length: side,
            }),
            Shape::Mesh => return None,
        })
    }

    /// What rays meet.
    pub(super) fn primitive(&self) -> Primitive {
        match *self {
            Self::Square(rectangle) => Primitive::Rectangle(rectangle),
            Self::Sphere(sphere) => Primitive::Sphere(sphere),
            Self::Cylinder(cylinder) => Primitive::Cylinder(cylinder),
        }
    }

    /// The frame of the material at a point of the surface.
    pub fn frame(&self, position: Vec3) -> Frame {
        match self {
            Self::Square(_) => Frame::WORLD,
            Self::Sphere(sphere) => Frame::carried((position - sphere.centre).normalized()),
            Self::Cylinder(cylinder) => {
                let offset = position - cylinder.start;
                let across = offset - cylinder.axis * offset.dot(cylinder.axis);
                let z = across.normalized();
                Frame {
                    x: cylinder.axis,
                    y: z.cross(cylinder.axis),
                    z,
                }
            }
        }
    }

    /// Where a point of the surface is, as on the square: 0 to 1 along +x and +y across a square, and by
    /// arcs from the origin in units of its side on others. On a sphere the arc is the meridian's.
    pub fn uv(&self, position: Vec3) -> [f64; 2] {
        let (across, side) = match self {
            Self::Square(square) => ([position.x, position.y], square.u_length),
            Self::Sphere(sphere) => {
                let offset = position - sphere.centre;
                let outward = libm::hypot(offset.x, offset.y);
                let arc = sphere.radius * libm::atan2(outward, offset.z);
                // At the pole the arc is as long as its shadow.
                let scale = if outward > 0.0 { arc / outward } else { 1.0 };
                ([offset.x * scale, offset.y * scale], 2.0 * sphere.radius)
            }
            Self::Cylinder(cylinder) => {
                let offset = position - cylinder.start;
                let arc = cylinder.radius * libm::atan2(offset.y, offset.z);
                ([position.x, arc], 2.0 * cylinder.radius)
            }
        };
        across.map(|along| 0.5 + along / side)
    }

    /// The least ball that holds it.
    pub fn ball(&self) -> Sphere {
        match *self {
            Self::Square(square) => Sphere {
                centre: square.point(0.5, 0.5),
                radius: 0.5 * libm::hypot(square.u_length, square.v_length),
            },
            Self::Sphere(sphere) => sphere,
            Self::Cylinder(cylinder) => {
                let half = 0.5 * cylinder.length;
                Sphere {
                    centre: cylinder.start + cylinder.axis * half,
                    radius: libm::hypot(half, cylinder.radius),
                }
            }
        }
    }

    /// Where the surface, continued, turns light of `source` to `eye`. Both are in the plane x = 0,
    /// above z = 0.
    pub fn mirror_point(&self, eye: Vec3, source: Vec3) -> MirrorPoint {
        let (position, curvature) = match self {
            Self::Square(_) => {
                let below = Vec3::new(source.x, source.y, -source.z);
                let position = eye + (below - eye) * (eye.z / (eye.z + source.z));
                (position, [0.0, 0.0])
            }
            Self::Sphere(Sphere { centre, radius }) => {
                let position = on_circle(*centre, *radius, eye, source);
                (position, [1.0 / radius, 1.0 / radius])
            }
            Self::Cylinder(Cylinder { start, radius, .. }) => {
                let centre = Vec3::new(0.0, start.y, start.z);
                let position = on_circle(centre, *radius, eye, source);
                (position, [0.0, 1.0 / radius])
            }
        };
        MirrorPoint {
            position,
            frame: self.frame(position),
            curvature,
        }
    }
}

/// The point of a circle, in a plane with two points outside of it, that turns light of one to the
/// other. From where the circle faces the eye to where it faces the source, the angle to the eye grows
/// and that to the source shrinks.
fn on_circle(centre: Vec3, radius: f64, eye: Vec3, source: Vec3) -> Vec3 {
    let to_eye = (eye - centre).normalized();
    let to_source = (source - centre).normalized();
    let (mut near, mut far) = (to_eye, to_source);
    for _ in 0..HALVINGS {
        let normal = (near + far).normalized();
        let position = centre + normal * radius;
        let cosine = |point: Vec3| normal.dot((point - position).normalized());
        if cosine(eye) > cosine(source) {
            near = normal;
        } else {
            far = normal;
        }
    }
    centre + near * radius
}

#[cfg(test)]
mod tests {
    use super::*;

    fn surfaces() -> [SmoothSurface; 3] {
        [Shape::Square, Shape::Sphere, Shape::Cylinder].map(|shape| {
            let side_m = 0.1;
            SmoothSurface::new(&Sample {
                shape,
                side_m,
                mesh: None,
            })
            .expect("no mesh")
        })
    }

    fn points(surface: &SmoothSurface) -> Vec<Vec3> {
        let steps = || (1..20).map(|step| f64::from(step) / 20.0);
        let mut found = Vec::new();
        for (u, v) in steps().flat_map(|u| steps().map(move |v| (u, v))) {
            let (sin, cos) = libm::sincos(3.0 * (v - 0.5));
            found.push(match surface {
                SmoothSurface::Square(square) => square.point(u, v),
                SmoothSurface::Sphere(sphere) => {
                    let (around, beside) = libm::sincos(6.0 * u);
                    let normal = Vec3::new(sin * beside, sin * around, cos);
                    sphere.centre + normal * sphere.radius
                }
                SmoothSurface::Cylinder(cylinder) => {
                    let along = cylinder.axis * (cylinder.length * u);
                    cylinder.start + along + Vec3::new(0.0, sin, cos) * cylinder.radius
                }
            });
        }
        found
    }

    #[test]
    fn frames_are_right_handed_smooth_and_the_worlds_at_the_origin() {
        for surface in surfaces() {
            let origin = surface.frame(Vec3::default());
            for (found, expected) in [origin.x, origin.y, origin.z].into_iter().zip([
                Frame::WORLD.x,
                Frame::WORLD.y,
                Frame::WORLD.z,
            ]) {
                assert!((found - expected).length() < 1e-15, "{origin:?}");
            }
            for at in points(&surface) {
                let Frame { x, y, z } = surface.frame(at);
                assert!((x.cross(y) - z).length() < 1e-14);
                assert!((x.length() - 1.0).abs() < 1e-14 && x.dot(y).abs() < 1e-14);
                // No step of the surface turns the frame by much more than its normal.
                let step = x * 1e-6;
                let beside = surface.frame(at + step);
                let turned = (beside.x - x).length();
                assert!(
                    turned < 5.0 * (beside.z - z).length() + 1e-9,
                    "{at:?}: {turned}"
                );
            }
        }
    }

    /// The material's x stays as near to the world's as the surface lets it: a path around the pole
    /// turns it by no more than the area that it surrounds.
    #[test]
    fn a_sphere_carries_the_frame_along_meridians() {
        let [_, sphere, _] = surfaces();
        let ball = sphere.ball();
        for at in points(&sphere) {
            let frame = sphere.frame(at);
            let normal = (at - ball.centre).normalized();
            // The rotation about the axis z x n by the angle between them.
            let axis = Frame::WORLD.z.cross(normal);
            if axis.length() < 1e-9 {
                continue;
            }
            let axis = axis.normalized();
            for (world, carried) in [(Frame::WORLD.x, frame.x), (Frame::WORLD.y, frame.y)] {
                let cosine = normal.z;
                let sine = (1.0 - cosine * cosine).sqrt();
                let turned = world * cosine
                    + axis.cross(world) * sine
                    + axis * (axis.dot(world) * (1.0 - cosine));
                assert!((turned - carried).length() < 1e-12, "{at:?}");
            }
        }
    }

    /// A small step along the frame's x or y at the origin moves u or v by its length.
    #[test]
    fn surface_coordinates_are_the_squares_at_the_origin() {
        let step = 1e-5;
        for surface in surfaces() {
            assert_eq!(surface.uv(Vec3::default()), [0.5, 0.5]);
            for (x, y) in [(step, 0.0), (0.0, step), (step, step)] {
                let [u, v] = surface.uv(Vec3::new(x, y, 0.0));
                assert!((0.1 * (u - 0.5) - x).abs() < 1e-3 * step, "{u}");
                assert!((0.1 * (v - 0.5) - y).abs() < 1e-3 * step, "{v}");
            }
        }
    }

    #[test]
    fn arcs_are_as_long_as_on_the_surface() {
        let [square, sphere, cylinder] = surfaces();
        let quarter = 0.05 * std::f64::consts::FRAC_PI_2 / 0.1;
        let at_equator = Vec3::new(0.0, 0.05, -0.05);
        for surface in [sphere, cylinder] {
            let [u, v] = surface.uv(at_equator);
            assert!(
                (u - 0.5).abs() < 1e-15 && (v - 0.5 - quarter).abs() < 1e-12,
                "{v}"
            );
        }
        assert_eq!(square.uv(Vec3::new(0.05, -0.05, 0.0)), [1.0, 0.0]);
    }

    #[test]
    fn balls_hold_their_surfaces() {
        for surface in surfaces() {
            let Sphere { centre, radius } = surface.ball();
            for at in points(&surface) {
                assert!((at - centre).length() <= radius * (1.0 + 1e-15));
            }
        }
    }

    #[test]
    fn a_mirror_point_turns_the_light_to_the_eye() {
        let place = |elevation: f64, side: f64, distance: f64| {
            let (sin, cos) = libm::sincos(elevation.to_radians());
            Vec3::new(0.0, side * distance * cos, distance * sin)
        };
        for surface in surfaces() {
            for (camera, light) in [
                (45.0, 45.0),
                (15.0, 90.0),
                (90.0, 45.0),
                (30.0, 10.0),
                (90.0, 90.0),
            ] {
                let (eye, source) = (place(camera, -1.0, 0.5), place(light, 1.0, 1.0));
                let MirrorPoint {
                    position, frame, ..
                } = surface.mirror_point(eye, source);
                let half = (eye - position).normalized() + (source - position).normalized();
                assert!(
                    (half.normalized() - frame.z).length() < 1e-9,
                    "{surface:?} {camera} {light}"
                );
            }
        }
    }
}
