//! Where the bulb shows in the sample: about its mirror image, as far as the lobe blurs it.
//!
//! A pixel that sees metres of a sample may hold all of this in a millionth of its area. It gets paths
//! of its own there.

use super::edge_slopes::{REACH, around, bulb_slopes, edge_slopes};
use super::footprint::{Area, Outline, convex_hull};
use super::streak::Streak;
use crate::reflectance::lobe::Lobe;
use crate::scene::{MirrorPoint, SampleSurface, Scene, SmoothSurface};
use crate::vector::Vec3;

/// How far places may be off the slopes that they were taken to have, as a share of the outline's reach. Chosen.
const LINEAR: f64 = 0.1;

/// What reaches so many times farther along one of the lobe's axes than along the other is a streak. Chosen.
const STREAK: f64 = 10.0;

/// A place lies beside the sample if it is so far off, in sides. Rounding.
const BESIDE: f64 = 1e-9;

/// Of as many directions from the lobe's middle, one in so many is looked at.
const LOBE_STEP: usize = 8;

/// Where the bulb shows in the sample.
#[derive(Debug)]
pub struct BulbShows {
    /// Film outlines, each with how bright it is, but for a factor. None for a mesh, on which the bulb may show in many
    /// places. `None` where it shows in a shape that no outline here has, or on no more than the sample's edge: most of
    /// an outline would lie beyond.
    pub within: Option<Vec<(Outline, f64)>>,
    /// Where on the film the bulb's centre would show in a mirror, if the camera sees that.
    pub mirror_image: Option<[f64; 2]>,
    /// Whether the lobe makes a streak of it. A bulb that is large beside the lobe shows as it would in a mirror.
    pub is_streak: bool,
}

/// The part of a pixel where the bulb's highlight is, in parts.
#[derive(Debug)]
pub struct Highlight {
    /// Parts, and how bright they are, but for a factor.
    parts: Vec<(Area, f64)>,
    /// The sum over them of size times brightness.
    light: f64,
}

impl Highlight {
    /// What these outlines have in the bounds of `area`, the part of a pixel that sees the sample; `None` where that is
    /// nothing, or as large as `size`.
    pub fn within(outlines: &[(Outline, f64)], area: &Area, size: f64) -> Option<Self> {
        let bounds = area.bounds();
        let parts = outlines
            .iter()
            .filter_map(|(outline, brightness)| Some((outline.within(bounds)?, *brightness)));
        let parts: Vec<(Area, f64)> = parts.collect();
        let total: f64 = parts.iter().map(|(part, _)| part.size()).sum();
        if total < size { Self::new(parts) } else { None }
    }

    /// Of these parts; `None` where they send no light.
    pub fn new(parts: Vec<(Area, f64)>) -> Option<Self> {
        let lights = parts.iter().map(|(part, bright)| bright * part.size());
        let light: f64 = lights.sum();
        (light > 0.0).then_some(Self { parts, light })
    }

    /// A point, from one of the open unit square: in parts that send more light there are more.
    pub fn point(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let mut light = x * self.light;
        let mut at = None;
        for (part, bright) in &self.parts {
            let own = bright * part.size();
            at = Some((part, (light / own).min(1.0)));
            if light < own {
                break;
            }
            light -= own;
        }
        at.map_or([0.0; 2], |(part, x)| part.point([x, y]))
    }

    /// The density of [`Highlight::point`]. Parts may overlap.
    pub fn density(&self, point: [f64; 2]) -> f64 {
        let holding = self.parts.iter().filter(|(part, _)| part.holds(point));
        holding.map(|(_, bright)| bright).sum::<f64>() / self.light
    }
}

/// Film outlines that together hold the points of the sample from which a facet that the lobe holds turns the
/// camera's direction to the bulb. About the mirror image's centre slopes of half vectors are linear in
/// the position. Where they are not on a flat sample, a [`Streak`] is cut into parts, and other highlights have no
/// outline; nor have those about a mirror image beside the sample. On a curved sample the outline is only near the
/// right one far from the centre.
pub fn outlines(scene: &Scene, lobe: &Lobe) -> BulbShows {
    let (camera, bulb) = (&scene.camera, &scene.bulb);
    let (eye, centre) = (camera.position, bulb.centre);
    let MirrorPoint {
        position,
        frame,
        curvature,
    } = match scene.sample.mirror_point(eye, centre) {
        Some(point) => point,
        None => {
            return BulbShows {
                within: Some(Vec::new()),
                mirror_image: None,
                is_streak: false,
            };
        }
    };
    let (to_eye, to_bulb) = [eye, centre].map(|at| frame.to_local(at - position)).into();
    let (wo, wi) = (to_eye.normalized(), to_bulb.normalized());
    // The derivatives of the half vector wo + wi by the position. Where the surface falls away, its
    // normal turns after it.
    let derivative = |along: Vec3, falls: Vec3| {
        let turn =
            |unit: Vec3, offset: Vec3| (unit * unit.dot(along) - along) * (1.0 / offset.length());
        (turn(wo, to_eye) + turn(wi, to_bulb)) * (1.0 / (wo.z + wi.z)) - falls
    };
    let by_x = derivative(Vec3::new(1.0, 0.0, 0.0), Vec3::new(curvature[0], 0.0, 0.0));
    let by_y = derivative(Vec3::new(0.0, 1.0, 0.0), Vec3::new(0.0, curvature[1], 0.0));
    let per_determinant = 1.0 / (by_x.x * by_y.y - by_x.y * by_y.x);
    let [extent_u, extent_v] = bulb_slopes(wo, to_bulb, bulb.radius, lobe);
    let reach = [
        extent_u + REACH / lobe.n_u.sqrt(),
        extent_v + REACH / lobe.n_v.sqrt(),
    ];
    let shows = |within| BulbShows {
        within,
        mirror_image: camera.project(position),
        is_streak: is_streak(reach),
    };
    let corners: Vec<([f64; 2], [f64; 2])> = reached(wo, to_bulb, bulb.radius, lobe)
        .into_iter()
        .map(|slopes| {
            let slope = lobe.to_surface(Vec3::new(slopes[0], slopes[1], 0.0));
            let x = (by_y.y * slope.x - by_y.x * slope.y) * per_determinant;
            let y = (by_x.x * slope.y - by_x.y * slope.x) * per_determinant;
            ([x, y], slopes)
        })
        .collect();
    let to_world = |[x, y]: [f64; 2]| position + frame.to_world(Vec3::new(x, y, 0.0));
    let streak = Streak {
        lobe,
        to_eye,
        to_bulb,
        radius: bulb.radius,
    };
    let bends = |&(at, slopes): &([f64; 2], [f64; 2])| streak.off(at, slopes, reach) >= LINEAR;
    if curvature == [0.0; 2] {
        let bends = corners.iter().any(bends);
        if bends && is_streak(reach) {
            return shows(Some(streak.outlines(camera, to_world)));
        }
        if bends || is_beside(&scene.sample, position) {
            return shows(None);
        }
    }
    let corners: Vec<Vec3> = corners.iter().map(|&(at, _)| to_world(at)).collect();
    shows(Some(vec![(Outline::of_polygon(camera, &corners), 1.0)]))
}

/// Whether what reaches so far along the lobe's axes is a streak.
fn is_streak([narrow, wide]: [f64; 2]) -> bool {
    wide > STREAK * narrow
}

/// Whether a place on the plane of a flat sample lies beside it.
fn is_beside(sample: &SampleSurface, position: Vec3) -> bool {
    match sample {
        SampleSurface::Smooth(SmoothSurface::Square(square)) => {
            square.distance(position) > BESIDE * square.u_length
        }
        _ => false,
    }
}

/// The convex outline of slopes that are no farther than the lobe reaches from those of half vectors that see the bulb.
/// Grazing light draws the bulb out, in any direction across the lobe's axes.
fn reached(wo: Vec3, to_bulb: Vec3, radius: f64, lobe: &Lobe) -> Vec<[f64; 2]> {
    let widths = [lobe.n_u, lobe.n_v].map(|n| REACH / n.sqrt());
    let places = edge_slopes(wo, to_bulb, radius, lobe).flat_map(|[p, q]| {
        let lobe = around().step_by(LOBE_STEP);
        lobe.map(move |[cos, sin]| [p + widths[0] * cos, q + widths[1] * sin])
    });
    convex_hull(places.collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::BackendChoice;
    use crate::path::edge_slopes::SIDES;
    use crate::scene::Bulb;
    use crate::warp::perpendiculars;
    use dataset::Specification;

    /// The share of the lobe's light about the mirror image that lies outside of the outline, if there is one.
    fn share_outside(view: usize, exponents: [f64; 2]) -> Option<f64> {
        const STEPS: i32 = 120;
        const WIDTHS: f64 = 12.0;
        let mut specification = Specification::preset();
        (specification.image.width, specification.image.height) = (1, 1);
        specification.camera.film_half_width = 5.0;
        let scene = Scene::new(&specification, view, BackendChoice::Native);
        let scene = scene.expect("such a view").expect("a scene");
        let mut lobe = Lobe::new(10.0, 0.5, 30.0);
        [lobe.n_u, lobe.n_v] = exponents;
        let (camera, bulb) = (&scene.camera, &scene.bulb);
        let outlines = outlines(&scene, &lobe).within?;
        let mut areas = outlines
            .iter()
            .filter_map(|(outline, _)| outline.within_pixel(0, 0));
        let area = areas.next();
        let area = area.expect("the camera sees it");
        let (eye, centre) = (camera.position, bulb.centre);
        let below = Vec3::new(centre.x, centre.y, -centre.z);
        let mirror = eye + (below - eye) * (eye.z / (eye.z + centre.z));
        let steps = |n: f64| {
            let length = WIDTHS * eye.length() / (n.sqrt() * f64::from(STEPS));
            (-STEPS..=STEPS).map(move |step| f64::from(step) * length)
        };
        let (mut all, mut outside) = (0.0, 0.0);
        for u in steps(lobe.n_u) {
            for v in steps(lobe.n_v) {
                let position = mirror + lobe.to_surface(Vec3::new(u, v, 0.0));
                let (to_eye, to_bulb) = (eye - position, centre - position);
                let light = lobe.power(to_eye.normalized() + to_bulb.normalized());
                let [column, row, depth] = camera.homogeneous(-to_eye);
                all += light;
                if !area.holds([column / depth, row / depth]) {
                    outside += light;
                }
            }
        }
        Some(outside / all)
    }

    #[test]
    fn the_outline_holds_the_highlight() {
        let mut outlined = 0;
        for view in 0..Specification::preset().views.len() {
            for exponents in [[1e6, 1e6], [1e5, 1e5], [1e4, 1e4], [1e6, 2e3]] {
                if let Some(outside) = share_outside(view, exponents) {
                    outlined += 1;
                    assert!(
                        outside < 2e-4,
                        "view {view}, exponents {exponents:?}: {outside}"
                    );
                }
            }
        }
        assert!(outlined > 15, "{outlined}");
    }

    /// Grazing light draws the bulb out across the lobe's axes. In a mirror the outline holds all of the bulb's image.
    #[test]
    fn the_outline_holds_a_bulb_across_the_axes() {
        let mut looked_at = 0;
        for elevation in [3.0, 10.0, 30.0] {
            let mut specification = Specification::preset();
            (specification.image.width, specification.image.height) = (1, 1);
            specification.camera.film_half_width = 5.0;
            specification.sample.side_m = 1.0;
            specification.light.radius_m = 1e-3;
            for view in &mut specification.views {
                view.checker = false;
                (view.camera_elevation_deg, view.light_elevation_deg) = (elevation, elevation);
            }
            let scene = Scene::new(&specification, 0, BackendChoice::Native);
            let scene = scene.expect("such a view").expect("a scene");
            let (eye, Bulb { centre, radius, .. }) = (scene.camera.position, scene.bulb);
            for angle in [0.0, 20.0, 45.0, 70.0] {
                let outlines = outlines(&scene, &Lobe::new(0.0, 0.05, angle)).within;
                let outlines = outlines.expect("an outline");
                let areas = outlines
                    .iter()
                    .filter_map(|(part, _)| part.within_pixel(0, 0));
                let areas: Vec<Area> = areas.collect();
                let (x, y) = perpendiculars((centre - eye).normalized());
                for [cos, sin] in around() {
                    let edge = centre + (x * cos + y * sin) * (0.9 * radius);
                    let below = Vec3::new(edge.x, edge.y, -edge.z);
                    let place = eye + (below - eye) * (eye.z / (eye.z + edge.z));
                    let at = scene.camera.project(place).expect("before the camera");
                    looked_at += 1;
                    let held = areas.iter().any(|area| area.holds(at));
                    assert!(held, "elevation {elevation}, angle {angle}: {at:?}");
                }
            }
        }
        assert_eq!(looked_at, 3 * 4 * SIDES);
    }
}
