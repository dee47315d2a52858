//! The part of a rectangle that is above a horizon.

/// The most corners of a rectangle that a line has cut.
const CORNERS_MAX: usize = 5;

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
        const SQUARE: [[f64; 2]; 4] = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
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

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
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
