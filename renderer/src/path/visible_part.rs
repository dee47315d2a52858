//! The part of a rectangle that is above a horizon.

use crate::vector::Vec3;
use std::f64::consts::PI;

/// The most corners of a rectangle that a line has cut.
pub const CORNERS_MAX: usize = 5;

/// The corners of the unit square.
pub const SQUARE: [[f64; 2]; 4] = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];

/// A convex part of the unit square, as triangles about its first corner.
#[derive(Clone, Copy, Debug)]
pub struct VisiblePart {
    corners: [[f64; 2]; CORNERS_MAX],
    count: usize,
    /// The areas of the triangles up to each.
    up_to: [f64; CORNERS_MAX],
}

impl VisiblePart {
    /// The part where a height is positive that is linear over the square and has these values at
    /// (0, 0), (1, 0), (1, 1) and (0, 1). `None` where there is none.
    pub fn new(heights: [f64; 4]) -> Option<Self> {
        let mut part = Self {
            corners: [[0.0; 2]; CORNERS_MAX],
            count: 0,
            up_to: [0.0; CORNERS_MAX],
        };
        for to in 0..4 {
            let from = (to + 3) % 4;
            let (before, after) = (heights[from], heights[to]);
            if (before > 0.0) != (after > 0.0) {
                let share = before / (before - after);
                part.push([0, 1].map(|axis| {
                    SQUARE[from][axis] + (SQUARE[to][axis] - SQUARE[from][axis]) * share
                }));
            }
            if after > 0.0 {
                part.push(SQUARE[to]);
            }
        }
        for last in 2..part.count {
            let [a, b, c] = [0, last - 1, last].map(|index| part.corners[index]);
            let double = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
            part.up_to[last] = part.up_to[last - 1] + 0.5 * double.max(0.0);
        }
        (part.area() > 0.0).then_some(part)
    }

    fn push(&mut self, corner: [f64; 2]) {
        // A line that runs through a corner may cut both its sides there.
        if self.count < CORNERS_MAX {
            self.corners[self.count] = corner;
            self.count += 1;
        }
    }

    /// Its corners, in the order of the square's.
    pub fn corners(&self) -> &[[f64; 2]] {
        &self.corners[..self.count]
    }

    /// Its share of the square.
    pub fn area(&self) -> f64 {
        if self.count < 3 {
            0.0
        } else {
            self.up_to[self.count - 1]
        }
    }

    /// A point of it from one of the open unit square. Equal areas stay equal.
    pub fn point(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let wanted = x * self.area();
        let last = (2..self.count - 1)
            .find(|last| wanted < self.up_to[*last])
            .unwrap_or(self.count - 1);
        let (before, size) = (
            self.up_to[last - 1],
            self.up_to[last] - self.up_to[last - 1],
        );
        let [a, b, c] = [0, last - 1, last].map(|index| self.corners[index]);
        // Turk, "Generating Random Points in Triangles", Graphics Gems, 1990.
        let root = ((wanted - before) / size.max(f64::MIN_POSITIVE))
            .clamp(0.0, 1.0)
            .sqrt();
        let shares = [1.0 - root, root * (1.0 - y), root * y];
        [0, 1].map(|axis| shares[0] * a[axis] + shares[1] * b[axis] + shares[2] * c[axis])
    }
}

/// The angle from a unit direction to the nearest of those to a convex polygon, in radians; 0 where it is one
/// of them.
pub fn angle_from(direction: Vec3, corners: impl Iterator<Item = Vec3> + Clone) -> f64 {
    let (mut left, mut right) = (false, false);
    let mut least = PI;
    let mut previous = corners.clone().last();
    for b in corners {
        let Some(a) = previous.replace(b) else {
            break;
        };
        let across = a.cross(b);
        let off = direction.dot(across);
        left |= off > 0.0;
        right |= off < 0.0;
        let foot = direction * across.length_squared() - across * off;
        let is_between = a.cross(foot).dot(across) >= 0.0 && foot.cross(b).dot(across) >= 0.0;
        least = least.min(if is_between && foot.length_squared() > 0.0 {
            angle_between(direction, foot)
        } else {
            angle_between(direction, b).min(angle_between(direction, a))
        });
    }
    if left && right { least } else { 0.0 }
}

/// The angle between two vectors, also where it is small.
pub fn angle_between(a: Vec3, b: Vec3) -> f64 {
    libm::atan2(a.cross(b).length(), a.dot(b))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn no_direction_to_a_polygon_is_nearer_than_its_angle(
            heights in prop::array::uniform4(-1.0..1.0f64),
            direction in prop::array::uniform3(-1.0..1.0f64),
            at in prop::array::uniform2(0.0..1.0f64),
            [distance, tilt] in [0.01..2.0f64, -2.0..2.0],
        ) {
            let direction = Vec3::from(direction);
            prop_assume!(direction.length() > 0.1);
            let Some(part) = VisiblePart::new([heights[0], heights[1], heights[2],
                heights[0] + heights[2] - heights[1]]) else {
                return Ok(());
            };
            let place = |[u, v]: [f64; 2]| Vec3::new(u - 0.4, v - 0.7 + tilt * u, distance);
            let corners = part.corners().iter().map(|corner| place(*corner));
            let angle = angle_from(direction.normalized(), corners);
            let off = angle_between(direction, place(part.point(at)));
            prop_assert!(angle <= off + 1e-9, "{angle} {off}");
        }

        #[test]
        fn a_part_holds_its_points_and_fills_its_share(
            at in (-1.0..1.0f64, -1.0..1.0f64, -1.0..1.0f64)
        ) {
            let height = |[u, v]: [f64; 2]| at.0 + at.1 * u + at.2 * v;
            let heights = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]].map(height);
            let grid: Vec<[f64; 2]> = (0..4096u32)
                .map(|k| [k % 64, k / 64].map(|k| (f64::from(k) + 0.5) / 64.0))
                .collect();
            let above = grid.iter().filter(|point| height(**point) > 0.0).count();
            let share = above as f64 / 4096.0;
            let Some(part) = VisiblePart::new(heights) else {
                prop_assert!(share < 0.05);
                return Ok(());
            };
            prop_assert!((part.area() - share).abs() < 0.05, "{} for {share}", part.area());
            let mut mean = [0.0; 2];
            for point in &grid {
                let found = part.point(*point);
                prop_assert!(height(found) > -1e-12);
                for axis in 0..2 {
                    prop_assert!((-1e-12..=1.0 + 1e-12).contains(&found[axis]));
                    mean[axis] += found[axis] / 4096.0;
                }
            }
            // The centre of what is above, by the grid.
            if share > 0.1 {
                for axis in 0..2 {
                    let inside = grid.iter().filter(|point| height(**point) > 0.0);
                    let centre = inside.map(|point| point[axis]).sum::<f64>() / above as f64;
                    prop_assert!((centre - mean[axis]).abs() < 0.03, "{mean:?}");
                }
            }
        }
    }
}
