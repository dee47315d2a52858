//! The directions that a lobe reaches.

use crate::hybrid::budget::is_glossy;
use crate::hybrid::budget::wide::{TAIL_DIGITS, WINDOW_REACH_MAX};
use crate::numerics::batch::LANES;
use crate::numerics::tolerance::Tolerance;
use crate::reflectance::Reflectance;
use crate::reflectance::lobe::Lobe;
use crate::reflectance::slope_plane::Slopes;
use crate::scene::ChartPlane;
use crate::vector::Vec3;
use std::f64::consts::PI;

/// Points along each side of a lobe's reach at which the window is measured.
const BOUNDARY_STEPS: u32 = 4;

/// What is added to a window on either side, as a share of it.
const WINDOW_MARGIN: f64 = 0.05;

/// Directions count as no lower than this sine when widths are told.
const LEAST_HEIGHT: f64 = 0.05;

/// The directions that a lobe reaches, as a box of sines from the plane across x and of angles
/// beta in it, and its widths there.
pub struct Window {
    /// The least sine and angle.
    pub low: [f64; 2],
    /// The largest.
    pub high: [f64; 2],
    /// The widths, for a lobe that is no ridge.
    pub width: [f64; 2],
    /// Of a lobe that is narrow along one axis and reaches far along the other.
    ridge: Option<Ridge>,
}

/// A lobe that is narrow along one axis and reaches far along the other: away from the direction of perfect reflection
/// it grows narrower.
#[derive(Clone, Copy)]
struct Ridge {
    lobe: Lobe,
    /// Toward the viewer.
    wo: Vec3,
}

impl Window {
    /// The box around what the lobe reaches from `position` toward `wo`.
    pub fn new(
        position: Vec3,
        wo: Vec3,
        reflectance: &Reflectance,
        plane: &ChartPlane,
        tolerance: Tolerance,
    ) -> Self {
        debug_assert!(plane.x.x == 1.0 && position.z == 0.0);
        let lobe = &reflectance.lobe;
        let (reach_p, reach_q) = (
            tolerance.reach(lobe.n_u, TAIL_DIGITS),
            tolerance.reach(lobe.n_v, TAIL_DIGITS),
        );
        // Beyond it, the directions are no box about the direction of perfect reflection any more.
        let wide = reflectance.specular_share < 1.0 || reach_p.max(reach_q) > WINDOW_REACH_MAX;
        // One width is about 1/sqrt(n) of a slope: twice that of an angle up and down, and sideways
        // less, the more so the lower the viewer stands.
        let width = 2.0 / lobe.n_u.sqrt();
        let mut window = Self {
            low: [-1.0, 0.0],
            high: [1.0, PI],
            width: [width * wo.z.max(LEAST_HEIGHT), width],
            ridge: (wide && is_glossy(reflectance)).then_some(Ridge { lobe: *lobe, wo }),
        };
        if wide {
            return window;
        }
        let slopes = Slopes::new(lobe.to_lobe(wo), lobe);
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for step in 0..4 * BOUNDARY_STEPS {
            // Around the square of side 2.
            let along = 2.0 * f64::from(step % BOUNDARY_STEPS) / f64::from(BOUNDARY_STEPS) - 1.0;
            let (p, q) = match step / BOUNDARY_STEPS {
                0 => (along, -1.0),
                1 => (1.0, along),
                2 => (-along, 1.0),
                _ => (-1.0, -along),
            };
            let wi = lobe.to_surface(slopes.light(p * reach_p, q * reach_q));
            if wi.z < 0.0 {
                (low[1], high[1]) = (0.0, PI);
            }
            let position = [wi.x, libm::atan2(wi.z.max(0.0), wi.y)];
            for axis in 0..2 {
                low[axis] = low[axis].min(position[axis]);
                high[axis] = high[axis].max(position[axis]);
            }
        }
        for axis in 0..2 {
            let reach = high[axis] - low[axis];
            window.width[axis] =
                window.width[axis].min(reach / tolerance.reach_widths(TAIL_DIGITS));
            // Between the points of its boundary it may reach farther.
            window.low[axis] = window.low[axis].max(low[axis] - WINDOW_MARGIN * reach);
            window.high[axis] = window.high[axis].min(high[axis] + WINDOW_MARGIN * reach);
        }
        window
    }

    /// Whether the lobe is narrow along one axis and reaches far along the other.
    #[inline(always)]
    pub fn is_ridge(&self) -> bool {
        self.ridge.is_some()
    }

    /// How many of the lobe's widths long a turn of light from the plane across x is, for each radian, at these sines
    /// from the plane. `across` are the cosine and the sine of its angle in the plane. `None` for a lobe that is no
    /// ridge.
    #[inline(always)]
    pub fn widths_sideways(&self, sines: &[f64; LANES], [y, z]: [f64; 2]) -> Option<[f64; LANES]> {
        let ridge = self.ridge.as_ref()?;
        let mut widths = [0.0; LANES];
        for i in 0..LANES {
            let sine = sines[i];
            let cos = (1.0 - sine * sine).max(0.0).sqrt();
            let turn = Vec3::new(cos, -sine * y, -sine * z);
            widths[i] = ridge.widths(Vec3::new(sine, cos * y, cos * z), turn);
        }
        Some(widths)
    }

    /// The same of a turn in that plane.
    #[inline(always)]
    pub fn widths_up(&self, sine: f64, [y, z]: [f64; 2]) -> Option<f64> {
        let ridge = self.ridge.as_ref()?;
        let cos = (1.0 - sine * sine).max(0.0).sqrt();
        let turn = Vec3::new(0.0, -cos * z, cos * y);
        Some(ridge.widths(Vec3::new(sine, cos * y, cos * z), turn))
    }
}

impl Ridge {
    /// How many widths light moves over the lobe as it turns from `wi` by this much.
    #[inline(always)]
    fn widths(&self, wi: Vec3, turn: Vec3) -> f64 {
        let sum = self.wo + wi;
        let per_height = 1.0 / sum.z.max(2.0 * LEAST_HEIGHT);
        // The half vector's slopes are (x, y) / z of the sum.
        let slopes = sum * per_height;
        let change = (turn - slopes * turn.z) * per_height;
        let change = self.lobe.to_lobe(change);
        let square = self.lobe.n_u * change.x * change.x + self.lobe.n_v * change.y * change.y;
        // The lobe is exp(-(n_u u^2 + n_v v^2) ln(1 + s) / (2 s)) of slopes whose squared length is s, and
        // ln(1 + s) / s is at most (6 + s) / (6 + 4 s).
        let s = slopes.x * slopes.x + slopes.y * slopes.y;
        (square * (6.0 + s) / (6.0 + 4.0 * s)).sqrt()
    }
}
