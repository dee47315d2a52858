//! How paths go on from a surface to the one that it faces.

use super::hidden_chart;
use super::lit::Lit;
use super::reach::Unmet;
use super::visible_part::{self, VisiblePart};
use super::window::Window;
use crate::bsdf::Bsdf;
use crate::geometry::{Rectangle, Sphere};
use crate::scene::{Facing, Surface};
use crate::vector::Vec3;
use crate::warp::Cone;

/// The share of paths aimed at the other surface at their first hit, and later, where less light
/// is left and a path that meets nothing costs little.
const AIMED: f64 = 0.5;
const AIMED_LATER: f64 = 0.25;

/// The share of aimed paths that go to where the bulb lights the other surface, if it does so unevenly.
const LIT: f64 = 0.5;

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
    /// What the bulb lights unevenly, of a surface that paths are aimed at.
    lit: Option<&'a Lit>,
    /// The viewer, in the frame of the surface.
    wo: Vec3,
    /// What the surface faces.
    facing: Facing<'a>,
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
    /// nothing of the other surface's front is above the horizon of this one. `lit` tells whether the bulb lights the
    /// rectangle that it faces unevenly.
    pub fn new(
        surface: &'a Surface,
        bsdf: &'a Bsdf<'a>,
        facing: Facing<'a>,
        lit: Option<&'a Lit>,
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
                Some(at_rectangle(surface, bsdf, rectangle, wo, bounce, false)?)
            }
            Facing::Itself(chart) => {
                let aim =
                    chart.and_then(|chart| at_rectangle(surface, bsdf, chart, wo, bounce, true));
                match (aim, bsdf, chart) {
                    // Directions to all of the chart weigh little, whatever hides it, and a window may
                    // leave some of it out.
                    (Some(Aim::Window(_)), Bsdf::Material(reflectance), Some(chart))
                        if hidden_chart::peak_share(surface, &reflectance.lobe, chart, wo)
                            < AIMED =>
                    {
                        Some(Aim::Area(chart, None))
                    }
                    (aim, ..) => aim,
                }
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
            lit: lit.filter(|_| matches!(target, Some(Aim::Area(..) | Aim::Window(_)))),
            target,
            aimed,
            wo,
            facing,
        })
    }

    /// At most what paths carry to the chart that have not met it.
    pub fn unmet(&self) -> Unmet {
        let on_material = matches!(self.bsdf, Bsdf::Material(_));
        let at_area = on_material && matches!(self.target, Some(Aim::Area(..)));
        if !(at_area || matches!(self.facing, Facing::Itself(_))) {
            // The chart before a smooth surface is hidden nowhere: what is not met is far out in the lobe.
            return Unmet {
                share: f64::INFINITY,
                weight: self.lobe_max(),
            };
        }
        if self.target.is_none() || self.wo.z <= 0.0 {
            return Unmet::NOTHING;
        }
        // No weight of a surface's own density exceeds 1.
        let of_all = 1.0 / (1.0 - self.aimed);
        let chart = match (&self.target, self.facing) {
            (Some(Aim::Area(chart, _)), _) => *chart,
            (_, Facing::Itself(Some(chart))) => chart,
            _ => return Unmet::unknown(of_all),
        };
        let Bsdf::Material(reflectance) = self.bsdf else {
            return Unmet::unknown(of_all);
        };
        let part = match &self.target {
            Some(Aim::Area(_, part)) => *part,
            _ => None,
        };
        let share = hidden_chart::share_max(self.surface, reflectance, chart, part, self.wo);
        let weight = match &self.target {
            Some(Aim::Area(..)) => of_all.min(share / (self.aimed * (1.0 - self.share_of_lit()))),
            _ => of_all,
        };
        Unmet { share, weight }
    }

    /// The lobe where it is largest on the chart, over its peak; 1 where that is not known.
    fn lobe_max(&self) -> f64 {
        match (self.bsdf, &self.target) {
            (Bsdf::Material(reflectance), Some(Aim::Window(window)))
                if reflectance.specular_share == 1.0 =>
            {
                libm::exp(-window.log_lobe())
            }
            _ => 1.0,
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

    /// What a path carries that met what it was to meet, as a share of its radiance, but for what the surface absorbs:
    /// the surface's own density over that of paths. Those that are aimed by the lobe itself show it, whatever they
    /// carry.
    pub fn carried(&self, wi: Vec3) -> f64 {
        if !matches!(
            (self.bsdf, &self.target),
            (Bsdf::Material(_), Some(Aim::Area(..)))
        ) {
            return f64::INFINITY;
        }
        let own = self.bsdf.density(wi, self.wo);
        let aimed = self.aimed_density(wi);
        own / ((1.0 - self.aimed) * own + self.aimed * aimed).max(f64::MIN_POSITIVE)
    }

    /// The share of aimed paths that go to where the bulb lights what they are aimed at.
    fn share_of_lit(&self) -> f64 {
        if self.lit.is_some() { LIT } else { 0.0 }
    }

    /// A direction aimed at the other surface, and its density.
    fn aim(&self, [x, y]: [f64; 2]) -> (Vec3, f64) {
        let Some(lit) = self.lit else {
            return self.aim_at_all([x, y]);
        };
        let wi = if x < LIT {
            let to = lit.point([x / LIT, y]) - self.surface.position;
            self.surface.frame.to_local(to.normalized())
        } else {
            self.aim_at_all([(x - LIT) / (1.0 - LIT), y]).0
        };
        (wi, self.aimed_density(wi))
    }

    /// The same, without regard to the bulb.
    fn aim_at_all(&self, [x, y]: [f64; 2]) -> (Vec3, f64) {
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
        (wi, self.density_at_all(wi))
    }

    fn aimed_density(&self, wi: Vec3) -> f64 {
        let at_all = self.density_at_all(wi);
        self.lit.map_or(at_all, |lit| {
            let direction = self.surface.frame.to_world(wi);
            LIT * lit.density(self.surface.position, direction) + (1.0 - LIT) * at_all
        })
    }

    fn density_at_all(&self, wi: Vec3) -> f64 {
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

/// Aimed at a rectangle, or at the part of it above the horizon of a surface; it `may_fold` and hide some of that, too.
fn at_rectangle<'a>(
    surface: &Surface,
    bsdf: &Bsdf<'a>,
    rectangle: &'a Rectangle,
    wo: Vec3,
    bounce: u32,
    may_fold: bool,
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
        Bsdf::Material(reflectance) if bounce == 0 => {
            let lobe = &reflectance.lobe;
            // Where directions to all of the rectangle weigh little, they are as good for what is left of it.
            let weighs = || hidden_chart::peak_share(surface, lobe, rectangle, wo) >= AIMED;
            let (corner, sides) = in_frame(surface, rectangle);
            let polygon = match &part {
                None => Some(&visible_part::SQUARE[..]),
                Some(part) if !may_fold && weighs() => Some(part.corners()),
                Some(_) => None,
            };
            polygon.and_then(|polygon| Window::new(lobe, wo, corner, sides, polygon))
        }
        _ => None,
    };
    Some(window.map_or(Aim::Area(rectangle, part), Aim::Window))
}

/// A corner of a rectangle as seen from a surface, and the sides from there, in the frame of the surface.
fn in_frame(surface: &Surface, rectangle: &Rectangle) -> (Vec3, [Vec3; 2]) {
    let sides = [
        rectangle.u_axis * rectangle.u_length,
        rectangle.v_axis * rectangle.v_length,
    ];
    let corner = rectangle.corner - surface.position;
    let sides = sides.map(|side| surface.frame.to_local(side));
    (surface.frame.to_local(corner), sides)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::BackendChoice;
    use crate::path::facets::tests::plate;
    use crate::reflectance::Reflectance;
    use crate::scene::{Encounter, Scene};
    use dataset::{
        Material, Specification,
        specification::{Shape, Tint},
    };
    use proptest::prelude::*;

    /// Whether a ray meets a rectangle, were nothing before it.
    fn meets(rectangle: &Rectangle, origin: Vec3, direction: Vec3) -> bool {
        let height = rectangle.normal.dot(origin - rectangle.corner);
        let distance = -height / rectangle.normal.dot(direction);
        let at = origin + direction * distance - rectangle.corner;
        distance > 0.0
            && (0.0..rectangle.u_length).contains(&at.dot(rectangle.u_axis))
            && (0.0..rectangle.v_length).contains(&at.dot(rectangle.v_axis))
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(400))]

        /// No path from a mesh to the chart weighs more than is said of those that may not have met it,
        /// whatever the normal, the lobe and the chart.
        #[test]
        fn no_path_to_a_hidden_chart_weighs_more_than_is_said(
            heights in prop::collection::vec(-1.0..1.0f64, 9),
            bumpiness in 0.0..2.0f64,
            (roughness, anisotropy, angle_deg) in (0.0..100.0f64, 0.0..1.0f64, 0.0..180.0f64),
            (view, side_m) in (0usize..14, 0.02..0.3f64),
            light_m in 0.01..1.0f64,
            (pitch_m, tilt_deg, gap_m) in (0.005..0.3f64, 0.0..90.0f64, 0.001..0.3f64),
            (x, y) in (0.0..8.0f64, 0.0..8.0f64),
            points in prop::collection::vec(prop::array::uniform2(1e-6..1.0f64), 200),
        ) {
            let heights: Vec<f64> = heights.iter().map(|height| height * bumpiness).collect();
            let mut specification = Specification::preset();
            specification.sample.shape = Shape::Mesh;
            specification.sample.side_m = side_m;
            specification.sample.mesh = Some(plate(2, &heights, false, 2));
            specification.views[view].checker = true;
            (specification.light.distance_m, specification.light.radius_m) = (light_m, 0.05 * light_m);
            specification.checker.pitch_m = pitch_m;
            specification.checker.tilt_deg = tilt_deg;
            specification.checker.lower_edge_y_m = 0.5 * side_m + gap_m;
            (specification.image.width, specification.image.height) = (8, 8);
            let scene = Scene::new(&specification, view, BackendChoice::Native);
            let scene = scene.expect("a view").expect("a scene");
            let ray = scene.camera.ray(x, y);
            let Some(Encounter::Surface(surface)) = scene.encounter(&ray, None) else {
                return Ok(());
            };
            if surface.on_triangle.is_none() {
                return Ok(());
            }
            let material = Material {
                roughness,
                anisotropy,
                angle_deg,
                ior: 10.0,
                rgb0: [1.0; 3],
                rgb90: [1.0; 3],
            };
            let reflectance = Reflectance::new(&material, 0.0, Tint::Hue);
            let bsdf = Bsdf::Material(&reflectance);
            let wo = surface.frame.to_local(-ray.direction);
            let facing = scene.facing(surface.thing).expect("a mesh faces itself");
            let chart = scene.chart_rectangle().expect("a chart");
            let lit = Lit::new(chart, &scene.bulb);
            let continuation = Continuation::new(&surface, &bsdf, facing, lit.as_ref(), wo, 0);
            let continuation = continuation.expect("a mesh");
            let unmet = continuation.unmet();
            let heights = chart.corners().map(|corner| {
                surface.frame.to_local(corner - surface.position).z
            });
            let visible = VisiblePart::new(heights).map_or(0.0, |part| part.area());
            for point in points {
                let Some((wi, weight)) = continuation.sample(wo, point) else {
                    continue;
                };
                let direction = surface.frame.to_world(wi);
                if meets(chart, surface.position, direction) && chart.normal.dot(direction) < 0.0 {
                    let weight = weight.into_iter().fold(0.0, f64::max);
                    prop_assert!(weight <= unmet.weight * 1.01, "{weight} exceeds {unmet:?}");
                    let value = bsdf.evaluate(wi, wo).into_iter().fold(0.0, f64::max) * wi.z;
                    let share = visible * value / chart.density(surface.position, direction);
                    prop_assert!(share <= unmet.share * 1.01, "{share} exceeds {unmet:?}");
                }
            }
        }
    }
}
