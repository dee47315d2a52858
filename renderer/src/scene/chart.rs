//! The colour chart: a plane of square patches.

use super::frame::Frame;
use crate::geometry::Rectangle;
use crate::vector::Vec3;
use dataset::specification::Checker;

/// The plane of the chart: where it is, and how it is divided into patches.
#[derive(Clone, Copy, Debug)]
pub struct ChartPlane {
    /// Where a and b are 0: the lower left corner.
    pub corner: Vec3,
    /// Unit, along a: from -x to +x.
    pub x: Vec3,
    /// Unit, along b: rising away from the sample.
    pub y: Vec3,
    /// Unit, the front's normal.
    pub z: Vec3,
    /// A patch's side in metres.
    pub pitch: f64,
    /// Patches along a.
    pub columns: u32,
    /// Patches along b.
    pub rows: u32,
}

impl ChartPlane {
    /// The index of the patch in a column and row, counted from the corner: patches are listed row by
    /// row, the far row first.
    #[inline(always)]
    pub fn patch(&self, column: u32, row: u32) -> usize {
        ((self.rows - 1 - row) * self.columns + column) as usize
    }

    /// The column and row of a patch, counted from the corner.
    pub fn cell(&self, index: usize) -> [u32; 2] {
        let (row, column) = (index as u32 / self.columns, index as u32 % self.columns);
        [column, self.rows - 1 - row]
    }

    /// Its sides in metres.
    pub fn size(&self) -> [f64; 2] {
        [self.columns, self.rows].map(|count| f64::from(count) * self.pitch)
    }

    /// The point at (a, b).
    pub fn point(&self, a: f64, b: f64) -> Vec3 {
        self.corner + self.x * a + self.y * b
    }

    /// The corners of each patch, in the order in which its outline visits them.
    pub fn outlines(&self) -> Vec<[Vec3; 4]> {
        let cells =
            (0..self.rows).flat_map(|row| (0..self.columns).map(move |column| [column, row]));
        cells
            .map(|cell| {
                let [column, row] = cell.map(f64::from);
                [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]
                    .map(|[x, y]| self.point((column + x) * self.pitch, (row + y) * self.pitch))
            })
            .collect()
    }

    /// Where a direction from `from`, in front of the chart, meets its plane; `None` where it does
    /// not.
    pub fn intersect(&self, from: Vec3, direction: Vec3) -> Option<[f64; 2]> {
        let offset = from - self.corner;
        let approach = -self.z.dot(direction);
        if approach <= 0.0 {
            return None;
        }
        let hit = offset + direction * (self.z.dot(offset) / approach);
        Some([hit.dot(self.x), hit.dot(self.y)])
    }
}

/// The colour chart: one rectangle that looks up its patch.
#[derive(Debug)]
pub struct Chart {
    pub(super) frame: Frame,
    plane: ChartPlane,
    /// Linear Rec.709, far row first.
    patches: Vec<[f64; 3]>,
}

impl Chart {
    /// The chart of a specification.
    pub(super) fn new(checker: &Checker) -> Self {
        let (sin, cos) = dataset::sin_cos_deg(checker.tilt_deg);
        let frame = Frame {
            x: Vec3::new(1.0, 0.0, 0.0),
            y: Vec3::new(0.0, cos, sin),
            z: Vec3::new(0.0, -sin, cos),
        };
        let width = checker.pitch_m * f64::from(checker.columns);
        let patches = checker
            .patches_srgb8
            .iter()
            .map(|patch| {
                patch.map(|code| dataset::colour::linear_from_srgb(f64::from(code) / 255.0))
            })
            .collect();
        Self {
            frame,
            plane: ChartPlane {
                corner: Vec3::new(-0.5 * width, checker.lower_edge_y_m, 0.0),
                x: frame.x,
                y: frame.y,
                z: frame.z,
                pitch: checker.pitch_m,
                columns: checker.columns,
                rows: checker.rows,
            },
            patches,
        }
    }

    /// The rectangle that rays meet.
    pub(super) fn rectangle(&self) -> Rectangle {
        let ChartPlane { corner, x, y, .. } = self.plane;
        let [width, height] = self.plane.size();
        Rectangle::new(corner, x, y, width, height)
    }

    /// Its plane.
    pub fn plane(&self) -> ChartPlane {
        self.plane
    }

    /// The patches' reflectances, linear Rec.709, far row first, each row from -x to +x.
    pub fn patches(&self) -> &[[f64; 3]] {
        &self.patches
    }

    /// The reflectance at (u, v) of the chart, v rising away from the sample.
    pub(super) fn colour(&self, u: f64, v: f64) -> [f64; 3] {
        let cell =
            |position: f64, count: u32| ((position * f64::from(count)) as u32).min(count - 1);
        let ChartPlane { columns, rows, .. } = self.plane;
        self.patches[self.plane.patch(cell(u, columns), cell(v, rows))]
    }
}
