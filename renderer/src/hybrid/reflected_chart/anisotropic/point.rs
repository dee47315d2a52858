//! The chart and a point of the sample in the frame of the lobe.

use super::branches::Branches;
use super::conic::Conic;
use super::moments::Order;
use crate::hybrid::budget::anisotropic::{CORNERS_MAX, PARABOLA_EXPONENT, TAIL_DIGITS};
use crate::hybrid::reflected_chart::lit_chart::{LIGHT_NODES, LitChart};
use crate::numerics::instructions::Instructions;
use crate::numerics::tolerance::Tolerance;
use crate::reflectance::Reflectance;
use crate::vector::Vec3;

/// The chart off a narrow lobe.
pub struct AnisotropicChart<'a> {
    pub(super) chart: &'a LitChart,
    pub(super) reflectance: &'a Reflectance,
    pub(super) instructions: Instructions,
    /// The chart's corner and axes in the lobe's frame, these over the pitch of its patches.
    pub(super) corner: Vec3,
    pub(super) axes: [Vec3; 3],
    /// The corners of patches in the lobe's frame; none if there are too many.
    pub(super) corners: Vec<Vec3>,
    /// The light on each patch as in [`LitChart::light`], with channels to fill a vector.
    pub(super) light: Vec<[[[f64; LIGHT_CHANNELS]; LIGHT_NODES]; LIGHT_NODES]>,
}

/// Three channels and one that is 0.
pub const LIGHT_CHANNELS: usize = 4;

impl<'a> AnisotropicChart<'a> {
    /// Of a chart and a material.
    pub fn new(
        chart: &'a LitChart,
        reflectance: &'a Reflectance,
        instructions: Instructions,
    ) -> Self {
        let (plane, lobe) = (&chart.plane, &reflectance.lobe);
        let per_pitch = 1.0 / plane.pitch;
        let [columns, rows] = [plane.columns, plane.rows].map(|count| count + 1);
        let corners = if (columns * rows) as usize <= CORNERS_MAX {
            (0..rows)
                .flat_map(|row| (0..columns).map(move |column| [column, row].map(f64::from)))
                .map(|[a, b]| lobe.to_lobe(plane.point(a * plane.pitch, b * plane.pitch)))
                .collect()
        } else {
            Vec::new()
        };
        Self {
            chart,
            reflectance,
            instructions,
            corner: lobe.to_lobe(plane.corner),
            axes: [plane.x, plane.y, plane.z].map(|axis| lobe.to_lobe(axis * per_pitch)),
            corners,
            light: chart
                .light
                .iter()
                .map(|patch| patch.map(|row| row.map(|[r, g, b]| [r, g, b, 0.0])))
                .collect(),
        }
    }
}

/// A point of the sample, a viewer, and how fine to be.
pub struct Point<'a> {
    pub(super) anisotropic: &'a AnisotropicChart<'a>,
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
    /// Half the lobe's reach along p, in widths.
    pub(super) reach: f64,
    /// Columns and rows of patches.
    pub(super) counts: [f64; 2],
    pub(super) order: Order,
}

impl<'a> Point<'a> {
    pub fn new(
        anisotropic: &'a AnisotropicChart<'a>,
        position: Vec3,
        wo: Vec3,
        knee: f64,
        tolerance: Tolerance,
    ) -> Self {
        let reflectance = anisotropic.reflectance;
        let lobe = &reflectance.lobe;
        let (wo, position) = (lobe.to_lobe(wo), lobe.to_lobe(position));
        let [x, y, z] = anisotropic.axes;
        let offset = position - anisotropic.corner;
        // Patches from the chart's plane. A direction w meets it at offset + w height / -(z.w).
        let pitch = anisotropic.chart.plane.pitch;
        let height = pitch * z.dot(offset);
        let unit_z = z * pitch;
        let order = if lobe.n_u > PARABOLA_EXPONENT {
            Order::Three
        } else {
            Order::Five
        };
        Self {
            anisotropic,
            wo,
            position,
            across: Conic::of(x * height - unit_z * x.dot(offset), wo),
            up: Conic::of(y * height - unit_z * y.dot(offset), wo),
            depth: Conic::of(-unit_z, wo),
            branches: Branches::new(wo, knee, reflectance.ior),
            tolerance,
            reach: 0.5 * tolerance.reach_widths(TAIL_DIGITS),
            counts: [
                anisotropic.chart.plane.columns,
                anisotropic.chart.plane.rows,
            ]
            .map(f64::from),
            order: if tolerance.is_check() {
                order.finer()
            } else {
                order
            },
        }
    }
}
