//! Rectangles and convex polygons on the film, in pixels.

use std::ops::Range;

/// An axis-parallel rectangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rectangle {
    /// Least column and row.
    pub low: [f64; 2],
    /// Largest column and row.
    pub high: [f64; 2],
}

/// A rule over triangles: Gauss-Legendre's points and weights along a side, Gauss-Jacobi's from the corner across
/// to it.
pub struct TriangleRule<const N: usize> {
    across: [(f64, f64); N],
    along: [(f64, f64); N],
}

/// Exact for polynomials of degree 3.
pub const OF_DEGREE_3: TriangleRule<2> = TriangleRule {
    across: [
        (0.355_051_025_721_682_2, 0.181_958_618_256_022_83),
        (0.844_948_974_278_317_8, 0.318_041_381_743_977_17),
    ],
    along: [
        (0.211_324_865_405_187_1, 0.5),
        (0.788_675_134_594_812_9, 0.5),
    ],
};

/// Exact for polynomials of degree 7.
pub const OF_DEGREE_7: TriangleRule<4> = TriangleRule {
    across: [
        (0.139_759_864_343_780_55, 0.031_180_970_950_008_08),
        (0.416_409_567_631_083_18, 0.129_847_547_608_232_44),
        (0.723_156_986_361_876_2, 0.203_464_568_010_271_36),
        (0.942_895_803_885_482_3, 0.135_506_913_431_488_12),
    ],
    along: [
        (0.069_431_844_202_973_71, 0.173_927_422_568_726_93),
        (0.330_009_478_207_571_87, 0.326_072_577_431_273_07),
        (0.669_990_521_792_428_1, 0.326_072_577_431_273_07),
        (0.930_568_155_797_026_3, 0.173_927_422_568_726_93),
    ],
};

impl Rectangle {
    /// The pixel in a column and row.
    pub fn pixel(column: u32, row: u32) -> Self {
        let low = [f64::from(column), f64::from(row)];
        Self {
            low,
            high: low.map(|edge| edge + 1.0),
        }
    }

    /// Width and height.
    pub fn sides(&self) -> [f64; 2] {
        std::array::from_fn(|axis| self.high[axis] - self.low[axis])
    }

    /// A coordinate along an axis, -1 at the low end and 1 at the high one.
    pub fn local(&self, axis: usize, at: f64) -> f64 {
        let Self { low, high } = self;
        (2.0 * at - low[axis] - high[axis]) / (high[axis] - low[axis])
    }

    /// The point at coordinates that are -1 at the low ends and 1 at the high ones.
    pub fn point(&self, local: [f64; 2]) -> [f64; 2] {
        let Self { low, high } = self;
        std::array::from_fn(|axis| {
            0.5 * (low[axis] + high[axis]) + 0.5 * local[axis] * (high[axis] - low[axis])
        })
    }

    /// The corners.
    pub fn corners(&self) -> [[f64; 2]; 4] {
        let ([left, top], [right, bottom]) = (self.low, self.high);
        [[left, top], [right, top], [right, bottom], [left, bottom]]
    }

    /// The area.
    pub fn area(&self) -> f64 {
        let [width, height] = self.sides();
        width * height
    }

    /// What it shares with another; `None` where that has no area.
    pub fn intersection(&self, other: &Self) -> Option<Self> {
        let shared = Self {
            low: std::array::from_fn(|axis| self.low[axis].max(other.low[axis])),
            high: std::array::from_fn(|axis| self.high[axis].min(other.high[axis])),
        };
        (0..2)
            .all(|axis| shared.low[axis] < shared.high[axis])
            .then_some(shared)
    }

    /// The smallest rectangle of whole pixels around it.
    pub fn rounded_out(&self) -> Self {
        Self {
            low: self.low.map(f64::floor),
            high: self.high.map(f64::ceil),
        }
    }

    /// Columns and rows that it meets.
    pub fn pixel_ranges(&self) -> [Range<u32>; 2] {
        let Self { low, high } = self.rounded_out();
        [0, 1].map(|axis| low[axis] as u32..high[axis] as u32)
    }

    /// The pixels that it meets: columns and rows.
    pub fn pixels(&self) -> impl Iterator<Item = (u32, u32)> + use<> {
        let [columns, rows] = self.pixel_ranges();
        rows.flat_map(move |row| columns.clone().map(move |column| (column, row)))
    }

    /// The edges between pixels along an axis, and the rectangle's own at the ends.
    pub fn pixel_edges(&self, axis: usize) -> Vec<f64> {
        let (low, high) = (self.low[axis], self.high[axis]);
        let inner = (low.floor() as u32 + 1..high.ceil() as u32).map(f64::from);
        std::iter::once(low).chain(inner).chain([high]).collect()
    }

    /// Whether a boundary between pixels lies inside along an axis.
    pub fn spans_pixels(&self, axis: usize) -> bool {
        self.low[axis].floor() + 1.0 < self.high[axis]
    }

    /// The nearest of its points to a point.
    pub fn nearest(&self, at: [f64; 2]) -> [f64; 2] {
        std::array::from_fn(|axis| at[axis].clamp(self.low[axis], self.high[axis]))
    }

    /// The parts below and above a coordinate along an axis; the whole where it is not inside.
    pub fn cut(&self, axis: usize, at: f64) -> Vec<Self> {
        if !(at > self.low[axis] && at < self.high[axis]) {
            return vec![*self];
        }
        let (mut below, mut above) = (*self, *self);
        below.high[axis] = at;
        above.low[axis] = at;
        vec![below, above]
    }

    /// Two halves along an axis, parted between pixels wherever it spans several.
    pub fn halves(&self, axis: usize) -> [Self; 2] {
        let middle = 0.5 * (self.low[axis] + self.high[axis]);
        // If any boundary lies inside, the nearest to the middle does.
        let middle = if self.spans_pixels(axis) {
            middle.round()
        } else {
            middle
        };
        let (mut first, mut second) = (*self, *self);
        first.high[axis] = middle;
        second.low[axis] = middle;
        [first, second]
    }
}

/// The most corners: a quadrilateral cut by a rectangle and four lines more.
const CORNERS_MAX: usize = 16;

/// A convex polygon, counter-clockwise in (column, row).
#[derive(Clone, Copy, Debug)]
pub struct Polygon {
    corners: [[f64; 2]; CORNERS_MAX],
    count: usize,
}

impl Polygon {
    /// From a quadrilateral's corners, in either sense.
    pub fn quadrilateral(corners: [[f64; 2]; 4]) -> Self {
        let mut polygon = Self {
            corners: [[0.0; 2]; CORNERS_MAX],
            count: 4,
        };
        polygon.corners[..4].copy_from_slice(&corners);
        if polygon.area() < 0.0 {
            polygon.corners[..4].reverse();
        }
        polygon
    }

    /// Its corners.
    pub fn corners(&self) -> &[[f64; 2]] {
        &self.corners[..self.count]
    }

    fn edges(&self) -> impl Iterator<Item = ([f64; 2], [f64; 2])> + '_ {
        let corners = self.corners();
        let next = move |i: usize| if i + 1 < corners.len() { i + 1 } else { 0 };
        (0..corners.len()).map(move |i| (corners[i], corners[next(i)]))
    }

    /// The polygon whose corners are these ones' images.
    pub fn map(&self, image: impl Fn([f64; 2]) -> [f64; 2]) -> Self {
        let mut polygon = *self;
        for corner in &mut polygon.corners[..self.count] {
            *corner = image(*corner);
        }
        polygon
    }

    /// The signed area.
    pub fn area(&self) -> f64 {
        0.5 * self
            .edges()
            .map(|(a, b)| a[0] * b[1] - a[1] * b[0])
            .sum::<f64>()
    }

    /// Whether nothing is left.
    pub fn is_empty(&self) -> bool {
        self.count < 3
    }

    /// The smallest rectangle around it.
    pub fn bounds(&self) -> Rectangle {
        let mut bounds = Rectangle {
            low: [f64::INFINITY; 2],
            high: [f64::NEG_INFINITY; 2],
        };
        for corner in self.corners() {
            for (low, at) in bounds.low.iter_mut().zip(corner) {
                *low = low.min(*at);
            }
            for (high, at) in bounds.high.iter_mut().zip(corner) {
                *high = high.max(*at);
            }
        }
        bounds
    }

    /// Whether a rectangle lies inside.
    pub fn contains(&self, cell: &Rectangle) -> bool {
        self.edges().all(|(a, b)| {
            let normal = [a[1] - b[1], b[0] - a[0]];
            // The corner of the rectangle that lies farthest out.
            let corner: [f64; 2] = std::array::from_fn(|axis| {
                if normal[axis] > 0.0 {
                    cell.low[axis]
                } else {
                    cell.high[axis]
                }
            });
            normal[0] * (corner[0] - a[0]) + normal[1] * (corner[1] - a[1]) >= 0.0
        })
    }

    /// The centroid, and the area. Where that is nothing the centroid is any point.
    pub fn centroid(&self) -> ([f64; 2], f64) {
        let Some((&a, others)) = self.corners().split_first() else {
            return ([0.0; 2], 0.0);
        };
        let (mut sums, mut double) = ([0.0; 2], 0.0);
        for pair in others.windows(2) {
            let [b, c] = [0, 1].map(|end| [0, 1].map(|axis| pair[end][axis] - a[axis]));
            let of_triangle = b[0] * c[1] - b[1] * c[0];
            double += of_triangle;
            for (axis, sum) in sums.iter_mut().enumerate() {
                *sum += of_triangle * (b[axis] + c[axis]);
            }
        }
        let per_third = if double > 0.0 {
            1.0 / (3.0 * double)
        } else {
            0.0
        };
        let centroid = [0, 1].map(|axis| a[axis] + per_third * sums[axis]);
        (centroid, 0.5 * double)
    }

    /// The part inside a rectangle.
    pub fn clipped(&self, cell: &Rectangle) -> Self {
        let mut polygon = *self;
        for axis in 0..2 {
            let (low, high) = (cell.low[axis], cell.high[axis]);
            polygon.keep(|point| point[axis] - low);
            polygon.keep(|point| high - point[axis]);
            // Cuts lie on the rectangle's sides but for rounding.
            for corner in &mut polygon.corners[..polygon.count] {
                corner[axis] = corner[axis].clamp(low, high);
            }
        }
        polygon
    }

    /// The part on which a linear function is not negative.
    pub fn cut(&self, function: impl Fn([f64; 2]) -> f64) -> Self {
        let mut part = *self;
        part.keep(function);
        part
    }

    /// Keeps the part on which a linear function is not negative (Sutherland and Hodgman).
    fn keep(&mut self, function: impl Fn([f64; 2]) -> f64) {
        let (mut heights, mut all) = ([0.0; CORNERS_MAX], true);
        for (height, corner) in heights.iter_mut().zip(self.corners()) {
            *height = function(*corner);
            all &= *height >= 0.0;
        }
        if all {
            return;
        }
        let whole = *self;
        let heights = &heights[..whole.count];
        self.count = 0;
        for (i, (a, b)) in whole.edges().enumerate() {
            let next = if i + 1 < heights.len() { i + 1 } else { 0 };
            let (da, db) = (heights[i], heights[next]);
            if da >= 0.0 {
                self.push(a);
            }
            if (da > 0.0 && db < 0.0) || (da < 0.0 && db > 0.0) {
                let t = da / (da - db);
                self.push([a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1])]);
            }
        }
    }

    fn push(&mut self, corner: [f64; 2]) {
        debug_assert!(self.count < CORNERS_MAX);
        self.corners[self.count] = corner;
        self.count += 1;
    }

    /// Points and weights of a rule over the polygon, exact for polynomials of degree 7.
    pub fn for_each_point(&self, visit: impl FnMut([f64; 2], f64)) {
        self.for_each_point_of(&OF_DEGREE_7, visit);
    }

    /// The same for a rule over triangles.
    pub fn for_each_point_of<const N: usize>(
        &self,
        rule: &TriangleRule<N>,
        mut visit: impl FnMut([f64; 2], f64),
    ) {
        let corners = self.corners();
        if corners.len() < 3 {
            return;
        }
        let a = corners[0];
        for pair in corners[1..].windows(2) {
            let (b, c) = (pair[0], pair[1]);
            let double = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
            for (r, weight) in rule.across {
                for (s, share) in rule.along {
                    let point = std::array::from_fn(|i| {
                        let edge = b[i] + s * (c[i] - b[i]);
                        a[i] + r * (edge - a[i])
                    });
                    visit(point, weight * share * double);
                }
            }
        }
    }

    /// Where a line of constant `axis` coordinate crosses it: the other coordinate's range.
    pub fn chord(&self, axis: usize, at: f64) -> Option<[f64; 2]> {
        let other = 1 - axis;
        let mut range = [f64::INFINITY, f64::NEG_INFINITY];
        for (a, b) in self.edges() {
            let (da, db) = (a[axis] - at, b[axis] - at);
            if da * db <= 0.0 && da != db {
                let cut = a[other] + da / (da - db) * (b[other] - a[other]);
                range = [range[0].min(cut), range[1].max(cut)];
            }
        }
        (range[0] < range[1]).then_some(range)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const QUADRILATERAL: [[f64; 2]; 4] = [[1.0, 1.0], [9.0, 2.0], [8.0, 7.0], [2.0, 6.0]];

    #[test]
    fn pixels_cut_a_polygon_into_its_area() {
        let polygon = Polygon::quadrilateral(QUADRILATERAL);
        let (mut area, mut inside) = (0.0, 0);
        for (column, row) in polygon.bounds().pixels() {
            let pixel = Rectangle::pixel(column, row);
            let cut = polygon.clipped(&pixel);
            area += cut.area();
            if polygon.contains(&pixel) {
                inside += 1;
                assert!((cut.area() - 1.0).abs() < 1e-14);
            }
        }
        assert!((area - polygon.area()).abs() < 1e-12 && inside > 10);
    }

    #[test]
    fn halves_are_never_empty_and_part_pixels_first() {
        for (low, high) in [
            (0.9, 1.2),
            (0.05, 1.02),
            (0.98, 1.95),
            (0.2, 3.1),
            (0.3, 0.6),
        ] {
            let whole = Rectangle {
                low: [low, 0.0],
                high: [high, 1.0],
            };
            let [first, second] = whole.halves(0);
            let middle = first.high[0];
            assert_eq!(middle, second.low[0]);
            assert!(low < middle && middle < high, "{low} to {high}: {middle}");
            assert_eq!(whole.spans_pixels(0), middle == middle.round());
        }
    }

    #[test]
    fn either_sense_of_the_corners_gives_the_same_polygon() {
        let mut reversed = QUADRILATERAL;
        reversed.reverse();
        let areas = [QUADRILATERAL, reversed].map(|it| Polygon::quadrilateral(it).area());
        assert!(areas[0] > 0.0 && areas[0] == areas[1]);
    }

    #[test]
    fn rules_integrate_to_their_degrees() {
        // Over the unit square: x^7 + x^3 y^4 gives 1/8 + 1/20, and x^3 + x y^2 1/4 + 1/6.
        let square = Polygon::quadrilateral([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]);
        let [mut of_seven, mut of_three] = [0.0; 2];
        square.for_each_point(|[x, y], weight| {
            let (x3, y2) = (x * x * x, y * y);
            of_seven += weight * (x3 * x3 * x + x3 * y2 * y2);
        });
        square.for_each_point_of(&OF_DEGREE_3, |[x, y], weight| {
            of_three += weight * (x * x * x + x * y * y);
        });
        assert!((of_seven - (0.125 + 0.05)).abs() < 1e-14, "{of_seven}");
        assert!((of_three - (0.25 + 1.0 / 6.0)).abs() < 1e-14, "{of_three}");
    }

    #[test]
    fn a_chord_spans_the_polygon() {
        let polygon = Polygon::quadrilateral(QUADRILATERAL);
        assert_eq!(polygon.chord(0, 0.5), None);
        let [low, high] = polygon.chord(0, 5.0).expect("a chord");
        assert!((low - 1.5).abs() < 1e-14 && (high - 6.5).abs() < 1e-14);
    }
}
