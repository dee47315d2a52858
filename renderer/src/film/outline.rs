//! What a convex outline has of each pixel.

use crate::numerics::polygon::{Polygon, Rectangle};
use std::ops::Range;

/// A convex outline on the film. What it has of each pixel is worked out once.
#[derive(Clone, Debug)]
pub struct Outline {
    polygon: Polygon,
    first_row: u32,
    rows: Vec<Row>,
    /// The pixels that it cuts, row by row.
    cut: Vec<CutPixel>,
}

/// The part of an outline that lies on a pixel which is not all inside.
#[derive(Clone, Debug)]
pub struct CutPixel {
    /// May be empty.
    pub part: Polygon,
    /// In square pixels.
    pub area: f64,
}

/// A row of pixels.
#[derive(Clone, Debug)]
struct Row {
    /// The columns of pixels that may have something of the outline.
    touched: Range<u32>,
    /// Those of pixels that lie inside.
    inside: Range<u32>,
    /// Where the first of the pixels that are cut stands.
    first_cut: usize,
}

impl Outline {
    /// An outline on a film of so many columns and rows.
    pub fn new(polygon: Polygon, [width, height]: [u32; 2]) -> Self {
        let film = Rectangle {
            low: [0.0; 2],
            high: [width, height].map(f64::from),
        };
        let mut outline = Self {
            polygon,
            first_row: 0,
            rows: Vec::new(),
            cut: Vec::new(),
        };
        if let Some(shared) = polygon.bounds().intersection(&film) {
            let [_, rows] = shared.pixel_ranges();
            outline.first_row = rows.start;
            for row in rows {
                outline.push(row, width);
            }
        }
        outline
    }

    /// Adds the next row of a film that is so wide.
    fn push(&mut self, row: u32, width: u32) {
        let strip = Rectangle {
            low: [0.0, f64::from(row)],
            high: [f64::from(width), f64::from(row) + 1.0],
        };
        let on_strip = self.polygon.clipped(&strip);
        let touched = match on_strip.bounds().intersection(&strip) {
            // What rounding makes of the ends may lie on a pixel more.
            Some(bounds) => {
                let [Range { start, end }, _] = bounds.pixel_ranges();
                start.saturating_sub(1)..(end + 1).min(width)
            }
            None => 0..0,
        };
        let Range { mut start, mut end } = touched.clone();
        let is_inside = |column| self.polygon.contains(&Rectangle::pixel(column, row));
        while start < end && !is_inside(start) {
            start += 1;
        }
        while start < end && !is_inside(end - 1) {
            end -= 1;
        }
        let cut = (touched.start..start)
            .chain(end..touched.end)
            .map(|column| {
                let part = self.polygon.clipped(&Rectangle::pixel(column, row));
                let area = part.area();
                CutPixel { part, area }
            });
        let first_cut = self.cut.len();
        self.cut.extend(cut);
        self.rows.push(Row {
            touched,
            inside: start..end,
            first_cut,
        });
    }

    /// The outline itself.
    pub fn polygon(&self) -> &Polygon {
        &self.polygon
    }

    /// What it has of the pixel in a column and row; `None` where that is nothing or all.
    pub fn cut_pixel(&self, (column, row): (u32, u32)) -> Option<&CutPixel> {
        let of_row = self.row(row)?;
        let is_cut = of_row.touched.contains(&column) && !of_row.inside.contains(&column);
        is_cut.then(|| &self.cut[of_row.cut_at(column)])
    }

    /// The columns of a row's pixels that lie inside.
    pub fn inside(&self, row: u32) -> Range<u32> {
        self.row(row).map_or(0..0, |row| row.inside.clone())
    }

    /// The pixels in some columns of a row of which it has something, but not all.
    pub fn cut(&self, columns: &Range<u32>, row: u32) -> impl Iterator<Item = (u32, &CutPixel)> {
        let touched = self.row(row).map_or(0..0, |row| {
            row.touched.start.max(columns.start)..row.touched.end.min(columns.end)
        });
        touched.filter_map(move |column| Some((column, self.cut_pixel((column, row))?)))
    }

    fn row(&self, row: u32) -> Option<&Row> {
        self.rows.get(row.checked_sub(self.first_row)? as usize)
    }
}

impl Row {
    /// Where a pixel that is cut stands.
    fn cut_at(&self, column: u32) -> usize {
        let before = column - self.touched.start;
        let inside = if column < self.inside.start {
            0
        } else {
            self.inside.end - self.inside.start
        };
        self.first_cut + (before - inside) as usize
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// Pixel by pixel it is what the polygon is, and there is nothing of it elsewhere.
        #[test]
        fn an_outline_is_its_polygon_on_every_pixel(
            corners in prop::array::uniform4(prop::array::uniform2(-3.0..15.0f64)),
            size in prop::array::uniform2(1u32..13),
            on_edges in any::<bool>(),
        ) {
            // About their middle, so that they make a convex polygon; some on edges between pixels.
            let middle = [0, 1].map(|axis| 0.25 * corners.iter().map(|c| c[axis]).sum::<f64>());
            let hull = convex(corners, middle);
            let hull = hull.map(|corner| if on_edges { corner.map(f64::round) } else { corner });
            let polygon = Polygon::quadrilateral(hull);
            prop_assume!(is_convex(&polygon) && polygon.area() > 1e-3);
            let outline = Outline::new(polygon, size);
            let (mut area, [width, height]) = (0.0, size);
            for row in 0..height {
                let mut cut = Vec::new();
                for column in 0..width {
                    let pixel = Rectangle::pixel(column, row);
                    let part = polygon.clipped(&pixel);
                    if let Some(found) = outline.cut_pixel((column, row)) {
                        prop_assert!(!polygon.contains(&pixel));
                        prop_assert_eq!(found.part.corners(), part.corners());
                        prop_assert_eq!(found.area, part.area());
                        cut.push((column, found.area));
                    } else if outline.inside(row).contains(&column) {
                        prop_assert!(polygon.contains(&pixel));
                    } else {
                        prop_assert!(part.area() < 1e-12);
                    }
                    area += part.area();
                }
                let columns = 0..width;
                let found = outline.cut(&columns, row);
                let found: Vec<_> = found.map(|(column, cut)| (column, cut.area)).collect();
                prop_assert_eq!(found, cut);
            }
            let film = Rectangle { low: [0.0; 2], high: size.map(f64::from) };
            prop_assert!((area - polygon.clipped(&film).area()).abs() < 1e-9);
        }
    }

    /// Corners in the order of their angles about a point.
    fn convex(mut corners: [[f64; 2]; 4], middle: [f64; 2]) -> [[f64; 2]; 4] {
        let angle = |corner: &[f64; 2]| libm::atan2(corner[1] - middle[1], corner[0] - middle[0]);
        corners.sort_by(|a, b| angle(a).total_cmp(&angle(b)));
        corners
    }

    fn is_convex(polygon: &Polygon) -> bool {
        let corners = polygon.corners();
        (0..4).all(|i| {
            let [a, b, c] = [i, (i + 1) % 4, (i + 2) % 4].map(|i| corners[i]);
            (b[0] - a[0]) * (c[1] - b[1]) - (b[1] - a[1]) * (c[0] - b[0]) > 1e-6
        })
    }
}
