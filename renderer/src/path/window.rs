//! The half vectors that see a flat surface, drawn by the lobe.

use super::glint::{GlintSample, per_steradian, reflected};
use super::slice::Slice;
use super::visible_part::CORNERS_MAX;
use crate::reflectance::lobe::Lobe;
use crate::vector::Vec3;

/// Half vectors about those that see a flat surface: a rectangle of slopes, sampled by the lobe.
///
/// Slopes are counted in widths of the lobe, in which it is as good as round, and one side of the
/// rectangle faces the lobe's centre: far out in the lobe nearly all light comes from next to it.
#[derive(Clone, Copy, Debug)]
pub struct Window<'a> {
    lobe: &'a Lobe,
    /// In the frame of the lobe.
    wo: Vec3,
    /// The inverse widths of the lobe.
    inverse_widths: [f64; 2],
    /// Away from the lobe's centre.
    axis: [f64; 2],
    /// Along the axis and across it.
    extents: [[f64; 2]; 2],
    slices: [Slice; 2],
    /// The squared slope of the point that is nearest to the lobe's centre.
    t: f64,
}

impl<'a> Window<'a> {
    /// From the viewer and the part of a rectangle, corner + u sides[0] + v sides[1], that a convex polygon of (u, v)
    /// holds, as seen from the point of the surface and in its frame. That part is not below the surface.
    /// `None` where there is no such window.
    pub fn new(
        lobe: &'a Lobe,
        wo: Vec3,
        corner: Vec3,
        sides: [Vec3; 2],
        polygon: &[[f64; 2]],
    ) -> Option<Self> {
        let wo = lobe.to_lobe(wo);
        let corner = lobe.to_lobe(corner);
        let [along_u, along_v] = sides.map(|side| lobe.to_lobe(side));
        let inverse_widths = [lobe.n_u.sqrt(), lobe.n_v.sqrt()];
        let point = |[u, v]: [f64; 2]| {
            let offset = corner + along_u * u + along_v * v;
            let half = offset + wo * offset.length();
            let inverse = 1.0 / half.z;
            [
                half.x * inverse * inverse_widths[0],
                half.y * inverse * inverse_widths[1],
            ]
        };
        let outline = Outline::new(polygon, point);
        let nearest = outline.nearest(point);
        let length = libm::hypot(nearest[0], nearest[1]);
        let axis = if length > 0.0 {
            nearest.map(|x| x / length)
        } else {
            [1.0, 0.0]
        };
        let mut extents = [[f64::INFINITY, f64::NEG_INFINITY]; 2];
        for (_, point) in outline.known() {
            for (extent, x) in extents.iter_mut().zip(rotated(*point, axis)) {
                *extent = [extent[0].min(x), extent[1].max(x)];
            }
        }
        // An outline that bends far may lie on the near side of its nearest point, and far across: all of that counts.
        if length > 0.0 {
            let [least, most] = extents[0];
            extents[0] = if most > length {
                [length, most]
            } else {
                [least, length]
            };
        }
        let usable = |[low, high]: [f64; 2]| low < high && high - low < f64::INFINITY;
        if !extents.into_iter().all(usable) {
            return None;
        }
        let (p, q) = (
            nearest[0] / inverse_widths[0],
            nearest[1] / inverse_widths[1],
        );
        let t = p * p + q * q;
        Some(Self {
            lobe,
            wo,
            inverse_widths,
            axis,
            extents,
            slices: extents.map(|extent| Slice::new(extent, 1.0, t)),
            t,
        })
    }

    /// At most the negative logarithm of the lobe where it is largest in the window, over its peak:
    /// log(1 + t) / t is more than 1 / (1 + t).
    pub fn log_lobe(&self) -> f64 {
        let nearest = self.slices[0].nearest;
        0.5 * nearest * nearest / (1.0 + self.t)
    }

    /// Draws a direction from a point of the open unit square.
    pub fn sample(&self, point: [f64; 2]) -> GlintSample {
        let (along, along_density) = self.slices[0].sample(point[0]);
        let (across, across_density) = self.slices[1].sample(point[1]);
        let [x, y] = self.axis;
        let [per_p, per_q] = self.inverse_widths;
        let slopes = [
            (x * along - y * across) / per_p,
            (y * along + x * across) / per_q,
        ];
        let density = along_density * across_density * per_p * per_q;
        reflected(self.lobe, self.wo, slopes, density)
    }

    /// The density of [`Window::sample`], a steradian.
    pub fn density(&self, wi: Vec3) -> f64 {
        let half = (self.lobe.to_lobe(wi) + self.wo).normalized();
        let [per_p, per_q] = self.inverse_widths;
        let point = [half.x / half.z * per_p, half.y / half.z * per_q];
        let position = rotated(point, self.axis);
        let mut density = per_p * per_q * per_steradian(half, self.wo);
        for ((x, extent), slice) in position.into_iter().zip(self.extents).zip(self.slices) {
            if !(extent[0] <= x && x <= extent[1]) {
                return 0.0;
            }
            density *= slice.density(x);
        }
        density
    }
}

/// Along an axis and across it.
fn rotated([x, y]: [f64; 2], axis: [f64; 2]) -> [f64; 2] {
    [axis[0] * x + axis[1] * y, axis[0] * y - axis[1] * x]
}

/// How often the nearest point of the outline is corrected for the outline's being curved. Three
/// times finds where even a highly anisotropic lobe crosses it.
const CORRECTIONS: usize = 3;

/// The corners of a polygon and the middles of its sides, and their points.
struct Outline {
    known: [Known; 2 * CORNERS_MAX],
    count: usize,
}

impl Outline {
    /// Of a polygon of at most [`CORNERS_MAX`] corners.
    fn new(polygon: &[[f64; 2]], point: impl Fn([f64; 2]) -> [f64; 2]) -> Self {
        let mut known = [([0.0; 2], [0.0; 2]); 2 * CORNERS_MAX];
        for (index, from) in polygon.iter().enumerate() {
            let to = polygon[(index + 1) % polygon.len()];
            let middle = [0, 1].map(|axis| 0.5 * (from[axis] + to[axis]));
            known[2 * index] = (*from, point(*from));
            known[2 * index + 1] = (middle, point(middle));
        }
        let count = 2 * polygon.len();
        Self { known, count }
    }

    fn known(&self) -> &[Known] {
        &self.known[..self.count]
    }

    /// The point of all within that is nearest to the origin, by a function that gives more points.
    fn nearest(&self, point: impl Fn([f64; 2]) -> [f64; 2]) -> [f64; 2] {
        let known = self.known();
        let edge = |from: usize| [known[from], known[(from + 1) % known.len()]];
        let mut line = edge(0);
        let mut found = nearest_of_line(&line);
        let (mut left, mut right) = (false, false);
        for from in 0..known.len() {
            let edge = edge(from);
            let [(_, a), (_, b)] = edge;
            let cross = a[0] * b[1] - a[1] * b[0];
            left |= cross > 0.0;
            right |= cross < 0.0;
            let of_edge = nearest_of_line(&edge);
            if of_edge.distance2 < found.distance2 {
                (line, found) = (edge, of_edge);
            }
        }
        if !(left && right) {
            return [0.0; 2];
        }
        for _ in 0..CORRECTIONS {
            let between = (found.position, point(found.position));
            let halves = [[line[0], between], [between, line[1]]];
            let of_halves = halves.each_ref().map(nearest_of_line);
            let closer = usize::from(of_halves[1].distance2 < of_halves[0].distance2);
            (line, found) = (halves[closer], of_halves[closer]);
        }
        // Where a side bends far, it comes nowhere near the chord that seemed nearest.
        let length2 = |[x, y]: [f64; 2]| x * x + y * y;
        let points = known.iter().map(|(_, point)| *point);
        points.fold(found.point, |nearest, point| {
            if length2(point) < length2(nearest) {
                point
            } else {
                nearest
            }
        })
    }
}

/// The point of a line that is nearest to the origin.
#[derive(Clone, Copy)]
struct Nearest {
    /// On the surface, never beyond its edges.
    position: [f64; 2],
    /// Between the two that the line is drawn through.
    point: [f64; 2],
    distance2: f64,
}

/// A position on a surface and its point.
type Known = ([f64; 2], [f64; 2]);

fn nearest_of_line([(position, from), (position_to, to)]: &[Known; 2]) -> Nearest {
    let step = [to[0] - from[0], to[1] - from[1]];
    let length2 = step[0] * step[0] + step[1] * step[1];
    let along = -(from[0] * step[0] + from[1] * step[1]) / length2.max(f64::MIN_POSITIVE);
    let along = along.clamp(0.0, 1.0);
    let position = [0, 1].map(|axis| position[axis] + (position_to[axis] - position[axis]) * along);
    let point = [from[0] + step[0] * along, from[1] + step[1] * along];
    Nearest {
        position,
        point,
        distance2: point[0] * point[0] + point[1] * point[1],
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::path::glint::tests::{LOBES, WO, grid};
    use crate::path::visible_part::SQUARE;

    const TRIANGLE: [[f64; 2]; 3] = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]];

    #[test]
    fn a_window_knows_the_density_of_its_samples() {
        let wo = WO.normalized();
        for (roughness, anisotropy) in LOBES {
            let lobe = Lobe::new(roughness, anisotropy, 35.0);
            let sides = [Vec3::new(0.16, 0.0, 0.0), Vec3::new(0.0, 0.19, 0.15)];
            let corner = Vec3::new(-0.05, 0.06, 0.0);
            for polygon in [&SQUARE[..], &TRIANGLE] {
                let window = Window::new(&lobe, wo, corner, sides, polygon).expect("a window");
                for point in grid(20) {
                    let sample = window.sample(point);
                    let ratio = window.density(sample.wi) / sample.density;
                    assert!((ratio - 1.0).abs() < 1e-6, "{ratio}");
                }
            }
        }
    }

    /// Three of four directions to a part of a surface are in its window, whose sides are straight, and more where most
    /// light is.
    #[test]
    fn a_window_holds_the_part_of_a_surface() {
        let wo = WO.normalized();
        let sides = [Vec3::new(0.16, 0.0, 0.1), Vec3::new(0.0, 0.19, 0.15)];
        let corner = Vec3::new(-0.05, 0.06, 0.0);
        for (roughness, anisotropy) in LOBES {
            let lobe = Lobe::new(roughness, anisotropy, 35.0);
            let window = Window::new(&lobe, wo, corner, sides, &TRIANGLE).expect("a window");
            let places = grid(40).filter(|[u, v]| u + v < 1.0);
            let directions = places.map(|[u, v]| corner + sides[0] * u + sides[1] * v);
            let (mut all, mut held) = (0, 0);
            for wi in directions.map(Vec3::normalized) {
                all += 1;
                held += usize::from(window.density(wi) > 0.0);
            }
            assert!(4 * held >= 3 * all, "{held} of {all}");
        }
    }

    /// A highly anisotropic lobe that crosses a surface is found there.
    #[test]
    fn a_window_finds_a_highly_anisotropic_lobe() {
        let lobe = Lobe::new(0.0, 1.0, 130.0);
        let wo = Vec3::new(0.05, 0.0, 1.0).normalized();
        let sides = [Vec3::new(0.16, 0.0, 0.0), Vec3::new(0.0, 0.19, 0.15)];
        let corner = Vec3::new(-0.08, 0.06, 0.0);
        let window = Window::new(&lobe, wo, corner, sides, &SQUARE).expect("a window");
        let bright = grid(32).filter(|&point| lobe.power(window.sample(point).wi + wo) > 1e-2);
        assert!(bright.count() > 256);
    }
}
