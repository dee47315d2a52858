//! Where the bulb shows in a sample that is rough along one axis and smooth along the other: a streak.
//!
//! Half vectors that the lobe holds lie about the line p = 0 of the slope plane (p, q), p along the lobe's narrow axis.
//! On the sample that line is a curve, which may run far from its tangent at the mirror image. So the streak is cut
//! where q is given, into parts that are nearly straight.

use super::edge_slopes::{REACH, bulb_slopes};
use super::footprint::Outline;
use crate::reflectance::lobe::Lobe;
use crate::scene::PinholeCamera;
use crate::vector::Vec3;

/// Parts of a streak to either side of the mirror image, of equal angles between half vector and normal. Chosen: over
/// two degrees the curve bends by less than the bulb is wide, but for the smallest bulbs.
const PARTS: u32 = 44;

/// The largest of these angles, in radians: 88 degrees. Light that grazes the sample as much is faint.
const ANGLE_MAX: f64 = 1.536;

/// Places on either side of a part between its ends.
const PLACES: u32 = 4;

/// The most of Newton's steps from one place to the next.
const STEPS: usize = 12;

/// The error in slopes at which they end.
const ERROR: f64 = 1e-12;

/// A flat piece of the sample, the camera and the bulb, in the frame of the mirror image.
#[derive(Clone, Copy, Debug)]
pub struct Streak<'a> {
    pub lobe: &'a Lobe,
    /// From the mirror image to the camera, in metres.
    pub to_eye: Vec3,
    /// From the mirror image to the bulb's centre, in metres.
    pub to_bulb: Vec3,
    /// The bulb's radius in metres.
    pub radius: f64,
}

/// A streak where q is given.
struct Across {
    /// Places on its sides.
    sides: [[f64; 2]; 2],
    /// One in its middle.
    middle: [f64; 2],
    /// About how bright it is there, but for a factor.
    brightness: f64,
}

impl Streak<'_> {
    /// The slopes of the half vector at (x, y), along the lobe's axes, and their derivatives by x and y.
    fn slopes(&self, [x, y]: [f64; 2]) -> ([f64; 2], [[f64; 2]; 2]) {
        let at = Vec3::new(x, y, 0.0);
        let offsets = [self.to_eye - at, self.to_bulb - at];
        let half = offsets.map(Vec3::normalized);
        let half = self.lobe.to_lobe(half[0] + half[1]);
        let per_height = 1.0 / half.z;
        let slopes = [half.x * per_height, half.y * per_height];
        let derivatives = [Vec3::new(1.0, 0.0, 0.0), Vec3::new(0.0, 1.0, 0.0)].map(|along| {
            let turned = offsets.map(|offset| {
                let unit = offset.normalized();
                (unit * unit.dot(along) - along) * (1.0 / offset.length())
            });
            let turned = self.lobe.to_lobe(turned[0] + turned[1]);
            [
                (turned.x - slopes[0] * turned.z) * per_height,
                (turned.y - slopes[1] * turned.z) * per_height,
            ]
        });
        (slopes, derivatives)
    }

    /// Where the half vector has these slopes, by Newton's method from a place near by; `None` where there is no such
    /// place.
    fn place(&self, wanted: [f64; 2], near: [f64; 2]) -> Option<[f64; 2]> {
        let mut at = near;
        for _ in 0..STEPS {
            let (slopes, [by_x, by_y]) = self.slopes(at);
            let off = [wanted[0] - slopes[0], wanted[1] - slopes[1]];
            let determinant = by_x[0] * by_y[1] - by_x[1] * by_y[0];
            let step = [
                (by_y[1] * off[0] - by_y[0] * off[1]) / determinant,
                (by_x[0] * off[1] - by_x[1] * off[0]) / determinant,
            ];
            if !(step[0].is_finite() && step[1].is_finite()) {
                return None;
            }
            at = [at[0] + step[0], at[1] + step[1]];
            if off[0].abs().max(off[1].abs()) < ERROR * (1.0 + wanted[1].abs()) {
                return Some(at);
            }
        }
        None
    }

    /// By how much a place is off the slopes that it was taken to have, as a share of `reach`.
    pub fn off(&self, at: [f64; 2], taken: [f64; 2], reach: [f64; 2]) -> f64 {
        let (slopes, _) = self.slopes(at);
        let off = [0, 1].map(|axis| (slopes[axis] - taken[axis]).abs() / reach[axis]);
        off[0].max(off[1])
    }

    /// The streak at q; `near` is in its middle near by.
    fn across(&self, q: f64, near: [f64; 2]) -> Option<Across> {
        let middle = self.place([0.0, q], near)?;
        let at = Vec3::new(middle[0], middle[1], 0.0);
        let [to_eye, to_bulb] = [self.to_eye - at, self.to_bulb - at];
        let [wo, wi] = [to_eye, to_bulb].map(Vec3::normalized);
        let [extent, _] = bulb_slopes(wo, to_bulb, self.radius, self.lobe);
        // At this q the lobe is as narrow as exp(-n p^2 / (2 (1 + q^2))).
        let width = ((1.0 + q * q) / self.lobe.n_u).sqrt();
        let reach = extent + REACH * width;
        let [left, right] = [-reach, reach].map(|p| self.place([p, q], middle));
        let shading = (wi.z / wo.z.max(wi.z)).max(0.0);
        let spread = to_bulb.length_squared() * reach;
        Some(Across {
            sides: [left?, right?],
            middle,
            brightness: self.lobe.power(wo + wi) * shading / spread,
        })
    }

    /// The outlines of its parts on the film, as far as the camera sees the sample's plane, and how bright they are,
    /// but for a factor; `to_world` takes places to the world.
    pub fn outlines(
        &self,
        camera: &PinholeCamera,
        to_world: impl Fn([f64; 2]) -> Vec3,
    ) -> Vec<(Outline, f64)> {
        let mut outlines = Vec::new();
        let step = ANGLE_MAX / f64::from(PARTS * PLACES);
        for side in [-1.0, 1.0] {
            let mut near = [0.0; 2];
            let (mut places, mut brightness) = (Vec::new(), 0.0);
            for index in 0..=PARTS * PLACES {
                let q = side * libm::tan(step * f64::from(index));
                let Some(across) = self.across(q, near) else {
                    break;
                };
                near = across.middle;
                let sides = across.sides.map(&to_world);
                if sides.iter().any(|&at| camera.project(at).is_none()) {
                    break;
                }
                places.extend(sides);
                if index > 0 && index % PLACES == 0 {
                    let outline = Outline::hull(camera, places.iter().copied());
                    outlines.push((outline, 0.5 * (brightness + across.brightness)));
                    places.drain(..places.len() - 2);
                }
                if index % PLACES == 0 {
                    brightness = across.brightness;
                }
            }
        }
        outlines
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::BackendChoice;
    use crate::path::highlight::outlines;
    use crate::scene::Scene;
    use dataset::Specification;

    /// Places of the sample at a distance from the origin where the half vector's slope along the lobe's narrow axis
    /// is 0, found without Newton's method.
    fn on_streak(scene: &Scene, lobe: &Lobe, distance: f64) -> Vec<Vec3> {
        let (eye, centre) = (scene.camera.position, scene.bulb.centre);
        let at = |angle: f64| {
            let (sin, cos) = libm::sincos(angle);
            Vec3::new(distance * cos, distance * sin, 0.0)
        };
        let slope = |angle: f64| {
            let [to_eye, to_bulb] = [eye, centre].map(|from| (from - at(angle)).normalized());
            lobe.to_lobe(to_eye + to_bulb).x
        };
        let turn = |index: u32| f64::from(index) * std::f64::consts::TAU / 360.0;
        let mut places = Vec::new();
        for index in 0..360 {
            let (mut low, mut high) = (turn(index), turn(index + 1));
            if slope(low).signum() == slope(high).signum() {
                continue;
            }
            for _ in 0..60 {
                let middle = 0.5 * (low + high);
                if slope(low).signum() == slope(middle).signum() {
                    low = middle;
                } else {
                    high = middle;
                }
            }
            places.push(at(low));
        }
        places
    }

    /// A bulb close to the sample makes a streak that bends. Its parts hold it wherever the lobe lights it.
    #[test]
    fn the_parts_of_a_streak_hold_it() {
        let mut specification = Specification::preset();
        (specification.image.width, specification.image.height) = (1, 1);
        specification.camera.film_half_width = 5.0;
        specification.light.distance_m = 0.05;
        specification.light.radius_m = 1e-4;
        let (mut held, mut missed) = (0, 0);
        for view in [5, 8, 12] {
            let scene = Scene::new(&specification, view, BackendChoice::Native);
            let scene = scene.expect("such a view").expect("a scene");
            for angle in [0.0, 50.0, 110.0] {
                let lobe = Lobe::new(0.0, 0.9, angle);
                let Some(parts) = outlines(&scene, &lobe).within else {
                    panic!("a streak has outlines");
                };
                assert!(parts.len() > 10, "a streak");
                let areas = parts.iter().filter_map(|(part, _)| part.within_pixel(0, 0));
                let areas: Vec<_> = areas.collect();
                for step in 0..40 {
                    let distance = 0.001 * libm::exp10(0.07 * f64::from(step));
                    for place in on_streak(&scene, &lobe, distance) {
                        let [to_eye, to_bulb] = [scene.camera.position, scene.bulb.centre]
                            .map(|from| (from - place).normalized());
                        let Some(at) = scene.camera.project(place) else {
                            continue;
                        };
                        let on_film = at.iter().all(|at| (0.0..1.0).contains(at));
                        if !on_film || lobe.power(to_eye + to_bulb) < 1e-6 {
                            continue;
                        }
                        let holds = areas.iter().any(|area| area.holds(at));
                        held += u32::from(holds);
                        missed += u32::from(!holds);
                    }
                }
            }
        }
        assert!(held > 400 && missed == 0, "{held} held, {missed} missed");
    }
}
