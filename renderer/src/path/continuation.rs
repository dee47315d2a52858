//! How paths go on from a surface to the one that it faces.

use super::glint::Window;
use super::visible_part::VisiblePart;
use crate::bsdf::Bsdf;
use crate::geometry::{Rectangle, Sphere};
use crate::scene::{Facing, Surface};
use crate::vector::Vec3;
use crate::warp::Cone;

/// The share of paths aimed at the other surface at their first hit, and later, where less light
/// is left and a path that meets nothing costs little.
const AIMED: f64 = 0.5;
const AIMED_LATER: f64 = 0.25;

/// How far below the horizon a corner is taken to be on it, as a share of the rectangle's sides: a point
/// of the sample's plane is off it by the rounding of its distance from the camera.
const ROUNDING: f64 = 1e-9;

/// How paths go on from a surface to the one that it faces.
pub struct Continuation<'a> {
    surface: &'a Surface,
    bsdf: &'a Bsdf<'a>,
    /// `None` where no path is aimed.
    target: Option<Aim<'a>>,
    /// The share of paths that are aimed at the other surface. The others follow the surface's own
    /// density.
    aimed: f64,
}

/// What directions are aimed at.
enum Aim<'a> {
    /// The half vectors that see the other surface: at the first hit on the sample.
    Window(Window<'a>),
    /// The area of the other surface, or the part of it that is above the horizon.
    Area(&'a Rectangle, Option<VisiblePart>),
    /// The directions to a ball about it.
    Cone(Cone),
}

impl<'a> Continuation<'a> {
    /// From a surface that is seen from `wo`, in its frame, after `bounce` others. `None` where
    /// nothing of the other surface's front is above the horizon of this one.
    pub fn new(
        surface: &'a Surface,
        bsdf: &'a Bsdf<'a>,
        facing: Facing<'a>,
        wo: Vec3,
        bounce: u32,
    ) -> Option<Self> {
        let target = match facing {
            Facing::Ball(Sphere { centre, radius }) => {
                // A ball about a mesh may hold the chart's lower edge.
                let cone = Cone::new(surface.position, centre, radius);
                let is_below = |cone: &Cone| cone.heights(surface.frame.z)[1] <= 0.0;
                if cone.as_ref().is_some_and(is_below) {
                    return None;
                }
                cone.map(Aim::Cone)
            }
            Facing::Rectangle(rectangle) => {
                Some(at_rectangle(surface, bsdf, rectangle, wo, bounce)?)
            }
            Facing::Itself(chart) => {
                chart.and_then(|chart| at_rectangle(surface, bsdf, chart, wo, bounce))
            }
        };
        let aimed = match (&target, bounce) {
            (None, _) => 0.0,
            (Some(_), 0) => AIMED,
            (Some(_), _) => AIMED_LATER,
        };
        Some(Self {
            surface,
            bsdf,
            target,
            aimed,
        })
    }

    /// At most the negative logarithm of the lobe where it is largest on the other surface, over
    /// its peak: 0 for a surface that sends light everywhere, and where it is not known.
    pub fn log_lobe(&self) -> f64 {
        match (self.bsdf, &self.target) {
            (Bsdf::Material(reflectance), Some(Aim::Window(window)))
                if reflectance.specular_share == 1.0 =>
            {
                window.log_lobe()
            }
            _ => 0.0,
        }
    }

    /// Draws a direction; also its weight f cos / density, by the balance heuristic.
    pub fn sample(&self, wo: Vec3, [x, y]: [f64; 2]) -> Option<(Vec3, [f64; 3])> {
        let own = 1.0 - self.aimed;
        if x < own {
            let scattered = self.bsdf.sample(wo, [x / own, y])?;
            let aimed = self.aimed * self.aimed_density(scattered.wi);
            let scale = scattered.density / (own * scattered.density + aimed);
            return Some((scattered.wi, scattered.weight.map(|weight| weight * scale)));
        }
        let (wi, density) = self.aim([(x - own) / self.aimed, y]);
        if wi.z <= 0.0 || density <= 0.0 {
            return None;
        }
        let scale = wi.z / (self.aimed * density + own * self.bsdf.density(wi, wo));
        let value = self.bsdf.evaluate(wi, wo);
        Some((wi, value.map(|channel| channel * scale)))
    }

    /// A direction aimed at the other surface, and its density.
    fn aim(&self, [x, y]: [f64; 2]) -> (Vec3, f64) {
        let to = match &self.target {
            None => return (Vec3::default(), 0.0),
            Some(Aim::Window(window)) => {
                let sample = window.sample([x, y]);
                return (sample.wi, sample.density);
            }
            Some(Aim::Area(rectangle, part)) => {
                let [u, v] = part.map_or([x, y], |part| part.point([x, y]));
                (rectangle.point(u, v) - self.surface.position).normalized()
            }
            Some(Aim::Cone(cone)) => cone.sample([x, y]),
        };
        let wi = self.surface.frame.to_local(to);
        (wi, self.aimed_density(wi))
    }

    fn aimed_density(&self, wi: Vec3) -> f64 {
        let direction = || self.surface.frame.to_world(wi);
        match &self.target {
            Some(Aim::Window(window)) => window.density(wi),
            Some(Aim::Area(rectangle, part)) => {
                let share = part.map_or(1.0, |part| part.area());
                rectangle.density(self.surface.position, direction()) / share
            }
            Some(Aim::Cone(cone)) if cone.holds(direction()) => cone.density(),
            Some(Aim::Cone(_)) | None => 0.0,
        }
    }
}

fn at_rectangle<'a>(
    surface: &Surface,
    bsdf: &Bsdf<'a>,
    rectangle: &'a Rectangle,
    wo: Vec3,
    bounce: u32,
) -> Option<Aim<'a>> {
    if rectangle.normal.dot(surface.position - rectangle.corner) < 0.0 {
        return None;
    }
    let from_here = |corner: Vec3| surface.frame.to_local(corner - surface.position);
    let heights = rectangle.corners().map(|corner| from_here(corner).z);
    let rounding = ROUNDING * (rectangle.u_length + rectangle.v_length);
    let is_above = heights.iter().all(|height| *height >= -rounding);
    let part = if is_above {
        None
    } else {
        Some(VisiblePart::new(heights)?)
    };
    let window = match bsdf {
        Bsdf::Material(reflectance) if bounce == 0 && is_above => {
            let sides = [
                surface
                    .frame
                    .to_local(rectangle.u_axis * rectangle.u_length),
                surface
                    .frame
                    .to_local(rectangle.v_axis * rectangle.v_length),
            ];
            Window::new(&reflectance.lobe, wo, from_here(rectangle.corner), sides)
        }
        _ => None,
    };
    Some(window.map_or(Aim::Area(rectangle, part), Aim::Window))
}
