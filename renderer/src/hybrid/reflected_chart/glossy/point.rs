//! The chart and a point of the sample in the frame of the lobe.

use super::branches::Branches;
use super::conic::Conic;
use super::hidden::{Corners, groups};
use super::light_cells::LightCells;
use super::moments::Order;
use crate::hybrid::budget::glossy::{
    CONSTANT_EXPONENT, CORNERS_MAX, PARABOLA_EXPONENT, QUARTIC_EXPONENT, TAIL_DIGITS,
};
use crate::hybrid::reflected_chart::lit_chart::{LitChart, PARABOLA};
use crate::numerics::batch::Batch;
use crate::numerics::elementary::log1p;
use crate::numerics::instructions::Instructions;
use crate::numerics::tolerance::Tolerance;
use crate::reflectance::Reflectance;
use crate::scene::ChartPlane;
use crate::vector::Vec3;

/// The chart off a glossy lobe.
#[derive(Clone)]
pub struct GlossyChart<'a> {
    pub reflectance: &'a Reflectance,
    pub(super) instructions: Instructions,
    /// The chart, in whole patches.
    pub plane: ChartPlane,
    /// Reflectances of whole patches.
    pub(super) colours: Vec<[f64; 3]>,
    /// The chart's corner and axes in the lobe's frame, these over the pitch of its patches.
    corner: Vec3,
    axes: [Vec3; 3],
    /// The corners of patches in the lobe's frame; none if there are too many.
    pub(super) corners: Batch<3>,
    /// Rectangles of patches that may show by themselves, in the lobe's frame.
    pub(super) groups: Vec<Corners>,
    /// The gap between the chart and the sample, in patches.
    pub(super) gap: f64,
    /// The light on it.
    pub(super) light: LightCells,
}

impl<'a> GlossyChart<'a> {
    /// Of a chart and a material.
    pub fn new(
        chart: &LitChart<PARABOLA>,
        reflectance: &'a Reflectance,
        instructions: Instructions,
    ) -> Self {
        let lobe = &reflectance.lobe;
        let plane = chart.whole_plane();
        let per_pitch = 1.0 / plane.pitch;
        let [columns, rows] = [plane.columns, plane.rows].map(|count| count + 1);
        let mut corners = Batch::default();
        if (columns * rows) as usize <= CORNERS_MAX {
            for row in 0..rows {
                for column in 0..columns {
                    let [a, b] = [column, row].map(|index| f64::from(index) * plane.pitch);
                    corners.push(lobe.to_lobe(plane.point(a, b)).into());
                }
            }
        }
        let colours: Vec<_> = (0..(plane.columns * plane.rows) as usize)
            .map(|index| {
                let [column, row] = plane.cell(index).map(|index| index * chart.parts);
                chart.patches[chart.patch(column, row)]
            })
            .collect();
        Self {
            reflectance,
            instructions,
            plane,
            groups: groups(&plane, &colours)
                .into_iter()
                .map(|group| group.map(|corner| lobe.to_lobe(corner)))
                .collect(),
            colours,
            corner: lobe.to_lobe(plane.corner),
            axes: [plane.x, plane.y, plane.z].map(|axis| lobe.to_lobe(axis * per_pitch)),
            corners,
            gap: chart.heights.gap * per_pitch,
            light: LightCells::new(chart),
        }
    }

    /// The same chart, all of it white.
    pub fn white(&self) -> Self {
        Self {
            colours: vec![[1.0; 3]; self.colours.len()],
            ..self.clone()
        }
    }

    /// The reflectance of the patch in a column and row, counted from the chart's corner.
    pub fn colour(&self, column: u32, row: u32) -> [f64; 3] {
        self.colours[self.plane.patch(column, row)]
    }
}

/// A point of the sample, a viewer, and how fine to be.
pub struct Point<'a> {
    pub(super) glossy: &'a GlossyChart<'a>,
    /// In the lobe's frame.
    pub(super) wo: Vec3,
    pub(super) position: Vec3,
    /// The position on the chart in patches from its corner, times `depth`, and the depth itself:
    /// positive where the direction meets the front.
    pub(super) across: Conic,
    pub(super) up: Conic,
    pub(super) depth: Conic,
    pub(super) branches: Branches,
    pub(super) tolerance: Tolerance,
    /// The error that it asks for.
    pub(super) error: f64,
    /// Widths of the lobe along q for a unit of slope.
    pub(super) per_wide_width: f64,
    /// Half the lobe's reach along p, in widths.
    pub(super) reach: f64,
    /// Columns and rows of patches.
    pub(super) counts: [f64; 2],
    pub(super) order: Order,
}

impl<'a> Point<'a> {
    pub fn new(
        glossy: &'a GlossyChart<'a>,
        position: Vec3,
        wo: Vec3,
        knee: f64,
        tolerance: Tolerance,
    ) -> Self {
        let reflectance = glossy.reflectance;
        let lobe = &reflectance.lobe;
        let (wo, position) = (lobe.to_lobe(wo), lobe.to_lobe(position));
        let [x, y, z] = glossy.axes;
        let offset = position - glossy.corner;
        // Patches from the chart's plane. A direction w meets it at offset + w height / -(z.w).
        let pitch = glossy.plane.pitch;
        let height = pitch * z.dot(offset);
        let unit_z = z * pitch;
        let order = if lobe.n_u > CONSTANT_EXPONENT {
            Order::One
        } else if lobe.n_u > PARABOLA_EXPONENT {
            Order::Three
        } else if lobe.n_u > QUARTIC_EXPONENT {
            Order::Five
        } else {
            Order::Seven
        };
        Self {
            glossy,
            wo,
            position,
            across: Conic::of(x * height - unit_z * x.dot(offset), wo),
            up: Conic::of(y * height - unit_z * y.dot(offset), wo),
            depth: Conic::of(-unit_z, wo),
            branches: Branches::new(wo, knee, reflectance.ior),
            tolerance,
            error: tolerance.error(),
            per_wide_width: lobe.n_v.sqrt(),
            reach: 0.5 * tolerance.reach_widths(TAIL_DIGITS),
            counts: [glossy.plane.columns, glossy.plane.rows].map(f64::from),
            order: (0..tolerance.level()).fold(order, |order, _| order.finer()),
        }
    }

    /// Widths of the lobe along p for a unit of slope, at q: the lobe is
    /// exp(-(n_u p^2 + n_v q^2) ln(1+t)/(2t)), t about q^2, and the wider the larger q is.
    #[inline(always)]
    pub fn widths_per_slope(&self, q: f64) -> f64 {
        let q2 = q * q + f64::MIN_POSITIVE;
        (self.glossy.reflectance.lobe.n_u * (log1p(q2) / q2)).sqrt()
    }
}
