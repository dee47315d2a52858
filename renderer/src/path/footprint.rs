//! What a pixel sees: the part of it that each surface may fill.
//!
//! A surface that fills a thousandth of a pixel is missed by most sets of samples, and one of them
//! that hits it is far off. So every surface is sampled on a part of the pixel that just holds its
//! projection. A sample that meets another surface there counts nothing; that surface has its own.

use crate::geometry::Cylinder;
use crate::scene::PinholeCamera;
use crate::vector::Vec3;
use crate::warp::perpendiculars;
use std::f64::consts::PI;

/// Sides of the polygons about a sphere's outline. Their areas differ by 1.5e-4 of either.
const OUTLINE_SIDES: u32 = 256;

/// A film larger than any.
const EVERYWHERE: [[f64; 3]; 4] = [
    [-1.0, -1.0, 1e-9],
    [1.0, -1.0, 1e-9],
    [1.0, 1.0, 1e-9],
    [-1.0, 1.0, 1e-9],
];

/// The convex outline of a surface in homogeneous film coordinates: [`PinholeCamera::homogeneous`].
#[derive(Clone, Debug)]
pub struct Outline {
    corners: Vec<[f64; 3]>,
    /// The least and largest column and row, where all of it is in front of the camera.
    bounds: Option<[[f64; 2]; 2]>,
}

impl Outline {
    fn new(camera: &PinholeCamera, directions: impl Iterator<Item = Vec3>) -> Self {
        Self::of_corners(directions.map(|to| camera.homogeneous(to)).collect())
    }

    pub fn of_corners(corners: Vec<[f64; 3]>) -> Self {
        let in_front = corners.iter().all(|[_, _, depth]| *depth > 0.0);
        let bounds = [0, 1].map(|axis| {
            let positions = corners.iter().map(|corner| corner[axis] / corner[2]);
            positions.fold(
                [f64::INFINITY, f64::NEG_INFINITY],
                |[low, high], position| [low.min(position), high.max(position)],
            )
        });
        Self {
            corners,
            bounds: in_front.then_some(bounds),
        }
    }

    /// How large the box about it is, in pixels; `None` where not all of it is in front of the camera.
    pub fn box_size(&self) -> Option<f64> {
        let [[left, right], [top, bottom]] = self.bounds?;
        Some((right - left) * (bottom - top))
    }

    /// The outline of a convex polygon.
    pub fn of_polygon(camera: &PinholeCamera, corners: &[Vec3]) -> Self {
        Self::new(camera, corners.iter().map(|&at| at - camera.position))
    }

    /// Polygons around and inside the outline of a sphere that does not hold the camera.
    pub fn of_sphere(camera: &PinholeCamera, centre: Vec3, radius: f64) -> [Self; 2] {
        let offset = centre - camera.position;
        let axis = offset.normalized();
        let (x, y) = perpendiculars(axis);
        // The tangent of the half angle: that of the circle on which the inner corners lie.
        let inner = radius / (offset.length_squared() - radius * radius).sqrt();
        let outer = inner / libm::cos(PI / f64::from(OUTLINE_SIDES));
        [outer, inner].map(|tangent| {
            let corners = (0..OUTLINE_SIDES).map(|side| {
                let angle = 2.0 * PI * f64::from(side) / f64::from(OUTLINE_SIDES);
                let (sin, cos) = libm::sincos(angle);
                axis + x * (tangent * cos) + y * (tangent * sin)
            });
            Self::new(camera, corners)
        })
    }

    /// A polygon around the outline of a cylinder.
    pub fn of_cylinder(camera: &PinholeCamera, cylinder: &Cylinder) -> Self {
        let (x, y) = perpendiculars(cylinder.axis);
        let radius = cylinder.radius / libm::cos(PI / f64::from(OUTLINE_SIDES));
        let ends = [0.0, cylinder.length].map(|along| cylinder.start + cylinder.axis * along);
        let corners = ends.into_iter().flat_map(|end| {
            (0..OUTLINE_SIDES).map(move |side| {
                let angle = 2.0 * PI * f64::from(side) / f64::from(OUTLINE_SIDES);
                let (sin, cos) = libm::sincos(angle);
                end + (x * cos + y * sin) * radius
            })
        });
        Self::hull(camera, corners)
    }

    /// A polygon around a box, of which these are the least and the largest corner.
    pub fn of_box(camera: &PinholeCamera, corners: [Vec3; 2]) -> Self {
        let places = (0..8).map(|place: usize| {
            let [x, y, z] = [0, 1, 2].map(|axis| corners[(place >> axis) & 1][axis]);
            Vec3::new(x, y, z)
        });
        Self::hull(camera, places)
    }

    /// The convex hull of what the camera sees of these points; all that it can see where one of them is
    /// not in front of it.
    pub fn hull(camera: &PinholeCamera, points: impl Iterator<Item = Vec3>) -> Self {
        let projected: Option<Vec<[f64; 2]>> = points.map(|at| camera.project(at)).collect();
        let corners = projected.map_or_else(
            || EVERYWHERE.to_vec(),
            |points| {
                let corners = convex_hull(points).into_iter();
                corners.map(|[column, row]| [column, row, 1.0]).collect()
            },
        );
        Self::of_corners(corners)
    }

    /// The part of the pixel that lies inside.
    pub fn within_pixel(&self, column: u32, row: u32) -> Option<Area> {
        let first = [f64::from(column), f64::from(row)];
        self.within([first, first.map(|first| first + 1.0)])
    }

    /// The part of a rectangle of the film that lies inside, from its least and its largest column and row.
    pub fn within(&self, [least, largest]: [[f64; 2]; 2]) -> Option<Area> {
        if let Some(bounds) = self.bounds {
            let apart = |axis: usize| {
                let [low, high] = bounds[axis];
                high <= least[axis] || low >= largest[axis]
            };
            if apart(0) || apart(1) {
                return None;
            }
        }
        // Inside where the product is not negative. All four together leave what is in front of
        // the camera.
        let sides = [
            [1.0, 0.0, -least[0]],
            [-1.0, 0.0, largest[0]],
            [0.0, 1.0, -least[1]],
            [0.0, -1.0, largest[1]],
        ];
        let mut corners = self.corners.clone();
        for side in sides {
            corners = clip(&corners, side);
            if corners.is_empty() {
                return None;
            }
        }
        let corners: Vec<[f64; 2]> = corners
            .iter()
            .map(|[x, y, depth]| {
                [
                    (x / depth).clamp(least[0], largest[0]),
                    (y / depth).clamp(least[1], largest[1]),
                ]
            })
            .collect();
        Area::new(&corners)
    }
}

/// The corners of the convex hull of some points, in order (Andrew 1979).
pub fn convex_hull(mut points: Vec<[f64; 2]>) -> Vec<[f64; 2]> {
    points.sort_unstable_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
    let turns_left = |[a, b]: [[f64; 2]; 2], c: [f64; 2]| {
        (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]) > 0.0
    };
    let chain = |points: &mut dyn Iterator<Item = [f64; 2]>| {
        let mut chain: Vec<[f64; 2]> = Vec::new();
        for point in points {
            while let [.., a, b] = chain[..]
                && !turns_left([a, b], point)
            {
                chain.pop();
            }
            chain.push(point);
        }
        // The other chain begins with it.
        chain.pop();
        chain
    };
    let mut hull = chain(&mut points.iter().copied());
    hull.extend(chain(&mut points.iter().rev().copied()));
    hull
}

/// The part of a convex polygon where `side` is not negative (Sutherland and Hodgman 1974).
fn clip(corners: &[[f64; 3]], side: [f64; 3]) -> Vec<[f64; 3]> {
    let height = |[x, y, depth]: [f64; 3]| side[0] * x + side[1] * y + side[2] * depth;
    let mut kept = Vec::with_capacity(corners.len() + 1);
    for (index, &to) in corners.iter().enumerate() {
        let from = corners[(index + corners.len() - 1) % corners.len()];
        let (before, after) = (height(from), height(to));
        if (before < 0.0) != (after < 0.0) {
            let share = before / (before - after);
            kept.push(std::array::from_fn(|axis| {
                from[axis] + (to[axis] - from[axis]) * share
            }));
        }
        if after >= 0.0 {
            kept.push(to);
        }
    }
    kept
}

/// A convex part of a pixel, as columns between consecutive corners from left to right.
#[derive(Clone, Debug)]
pub struct Area {
    slabs: Vec<Slab>,
    size: f64,
}

/// A trapezium with two vertical sides.
#[derive(Clone, Copy, Debug)]
struct Slab {
    left: f64,
    width: f64,
    /// Where the left and the right side begin and end.
    sides: [[f64; 2]; 2],
    /// The area up to its right side.
    size_up_to: f64,
}

impl Area {
    fn new(corners: &[[f64; 2]]) -> Option<Self> {
        if corners.iter().flatten().any(|x| !x.is_finite()) {
            return None;
        }
        let mut columns: Vec<f64> = corners.iter().map(|corner| corner[0]).collect();
        columns.sort_unstable_by(f64::total_cmp);
        columns.dedup();
        let mut size = 0.0;
        let mut slabs = Vec::with_capacity(columns.len());
        for pair in columns.windows(2) {
            let sides = [chord(corners, pair, pair[0]), chord(corners, pair, pair[1])];
            let heights = sides.map(|[low, high]| high - low);
            let width = pair[1] - pair[0];
            let slab_size = 0.5 * (heights[0] + heights[1]) * width;
            if slab_size > 0.0 {
                size += slab_size;
                slabs.push(Slab {
                    left: pair[0],
                    width,
                    sides,
                    size_up_to: size,
                });
            }
        }
        (size > 0.0).then_some(Self { slabs, size })
    }

    /// Its area, 1 for the whole pixel.
    pub fn size(&self) -> f64 {
        self.size
    }

    /// Its least and its largest column and row.
    pub fn bounds(&self) -> [[f64; 2]; 2] {
        let everywhere = [[f64::INFINITY; 2], [f64::NEG_INFINITY; 2]];
        self.slabs
            .iter()
            .fold(everywhere, |[least, largest], slab| {
                let [near, far] = slab.sides;
                [
                    [least[0].min(slab.left), least[1].min(near[0]).min(far[0])],
                    [
                        largest[0].max(slab.left + slab.width),
                        largest[1].max(near[1]).max(far[1]),
                    ],
                ]
            })
    }

    /// Its point that is nearest to another.
    pub fn nearest(&self, point: [f64; 2]) -> [f64; 2] {
        if self.holds(point) {
            return point;
        }
        let sides = self.slabs.iter().flat_map(|slab| {
            let right = slab.left + slab.width;
            let [[low, high], [far_low, far_high]] = slab.sides;
            let [a, b, c, d] = [
                [slab.left, low],
                [right, far_low],
                [right, far_high],
                [slab.left, high],
            ];
            [[a, b], [b, c], [c, d], [d, a]]
        });
        let nearest = sides.map(|[from, to]| {
            let [along, off] = [to, point].map(|at| [at[0] - from[0], at[1] - from[1]]);
            let length2 = along[0] * along[0] + along[1] * along[1];
            let share = (off[0] * along[0] + off[1] * along[1]) / length2.max(f64::MIN_POSITIVE);
            [0, 1].map(|axis| from[axis] + share.clamp(0.0, 1.0) * along[axis])
        });
        let distance = |at: &[f64; 2]| libm::hypot(at[0] - point[0], at[1] - point[1]);
        let nearest = nearest.min_by(|a, b| distance(a).total_cmp(&distance(b)));
        nearest.unwrap_or(point)
    }

    /// Whether it holds a point.
    pub fn holds(&self, [x, y]: [f64; 2]) -> bool {
        self.slabs.iter().any(|slab| {
            let share = (x - slab.left) / slab.width;
            let [low, high] = [0, 1]
                .map(|end| slab.sides[0][end] + (slab.sides[1][end] - slab.sides[0][end]) * share);
            (0.0..=1.0).contains(&share) && (low..=high).contains(&y)
        })
    }

    /// A point of it from one of the open unit square. Equal areas stay equal.
    pub fn point(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let wanted = x * self.size;
        let last = self.slabs.len() - 1;
        let index = self
            .slabs
            .partition_point(|slab| slab.size_up_to <= wanted)
            .min(last);
        let slab = &self.slabs[index];
        let before = if index == 0 {
            0.0
        } else {
            self.slabs[index - 1].size_up_to
        };
        let [near, far] = slab.sides;
        let (first, second) = (near[1] - near[0], far[1] - far[0]);
        // The share of the slab's width, left of which it has this area.
        let part = (wanted - before) / slab.width;
        let root = (first * first + 2.0 * (second - first) * part)
            .max(0.0)
            .sqrt();
        let share = (2.0 * part / (first + root).max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
        let low = near[0] + (far[0] - near[0]) * share;
        let high = near[1] + (far[1] - near[1]) * share;
        [slab.left + slab.width * share, low + (high - low) * y]
    }
}

/// Where the vertical line at `x` enters and leaves a convex polygon, by the edges that span
/// `pair`: columns between which there is no corner.
fn chord(corners: &[[f64; 2]], pair: &[f64], x: f64) -> [f64; 2] {
    let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
    for (index, to) in corners.iter().enumerate() {
        let from = corners[(index + corners.len() - 1) % corners.len()];
        if from[0].min(to[0]) <= pair[0] && from[0].max(to[0]) >= pair[1] {
            let y = from[1] + (to[1] - from[1]) * ((x - from[0]) / (to[0] - from[0]));
            (low, high) = (low.min(y), high.max(y));
        }
    }
    [low, high]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_whole_pixel_keeps_its_points() {
        let area = Area::new(&[[3.0, 5.0], [4.0, 5.0], [4.0, 6.0], [3.0, 6.0]]).expect("a square");
        assert_eq!(area.size(), 1.0);
        assert_eq!(area.point([0.25, 0.75]), [3.25, 5.75]);
    }

    #[test]
    fn a_hull_is_convex_and_holds_its_points() {
        let points: Vec<[f64; 2]> = (0..500u32)
            .map(|k| {
                let (sin, cos) = libm::sincos(f64::from(k) * 2.4);
                let radius = f64::from(k * k % 97);
                [radius * cos, 0.3 * radius * sin]
            })
            .collect();
        let hull = convex_hull(points.clone());
        for (index, from) in hull.iter().enumerate() {
            let to = hull[(index + 1) % hull.len()];
            for point in &points {
                let cross = (to[0] - from[0]) * (point[1] - from[1])
                    - (to[1] - from[1]) * (point[0] - from[0]);
                assert!(cross >= -1e-9, "{point:?} is outside");
            }
        }
    }

    #[test]
    fn no_place_of_an_area_is_nearer_than_its_nearest() {
        let area = Area::new(&[[0.1, 0.2], [0.9, 0.0], [0.6, 0.8], [0.3, 0.9]]).expect("an area");
        let [least, largest] = area.bounds();
        assert_eq!((least, largest), ([0.1, 0.0], [0.9, 0.9]));
        let distance = |a: [f64; 2], b: [f64; 2]| libm::hypot(a[0] - b[0], a[1] - b[1]);
        let side = 60;
        let places = || (0..side * side).map(|i| [i % side, i / side].map(|k| f64::from(k) + 0.5));
        for from in places().map(|at| at.map(|k| 2.0 * k / f64::from(side) - 0.5)) {
            let nearest = area.nearest(from);
            let inward = [0, 1].map(|axis| nearest[axis] + 1e-9 * (0.5 - nearest[axis]));
            assert!(area.holds(inward), "{nearest:?}");
            for at in places().map(|at| area.point(at.map(|k| k / f64::from(side)))) {
                assert!(
                    distance(from, nearest) <= distance(from, at) + 1e-12,
                    "{from:?}"
                );
            }
        }
    }

    #[test]
    fn a_triangle_is_filled_evenly() {
        let area = Area::new(&[[0.0, 0.0], [1.0, 0.0], [0.25, 1.0]]).expect("a triangle");
        assert!((area.size() - 0.5).abs() < 1e-15);
        let side = 200;
        let mut mean = [0.0; 2];
        for i in 0..side * side {
            let at = [i % side, i / side].map(|k| (f64::from(k) + 0.5) / f64::from(side));
            let point = area.point(at);
            for (mean, x) in mean.iter_mut().zip(point) {
                *mean += x / f64::from(side * side);
            }
        }
        assert!((mean[0] - 1.25 / 3.0).abs() < 1e-4, "{mean:?}");
        assert!((mean[1] - 1.0 / 3.0).abs() < 1e-4, "{mean:?}");
    }
}
