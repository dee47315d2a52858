//! Where the chords' integrals bend.
//!
//! The integrand bends at cosines of the light's direction, *levels*: half vectors with one of them lie on a
//! circle of the slope plane. What a chord of the bulb's ellipse adds up to bends, as a function of p, where
//! the circle touches the chord, where it leaves the ellipse, and where it leaves the lobe within a width of
//! it.

use super::bulb_view::BulbView;
use super::chords::{Depth, Disc, LEVELS};
use crate::hybrid::budget::direct::{BULK_WIDTHS, STEEP_WIDTHS};
use crate::reflectance::slope_plane::Slopes;
use crate::vector::Vec3;

/// A level's circle touches two chords, leaves the bulb twice, and the lobe's bulk four times.
const BREAKS_A_LEVEL: usize = 8;

/// The angles of the chords at which their integrals bend. The first `count` are set.
pub struct Breaks {
    angles: [f64; LEVELS * BREAKS_A_LEVEL],
    count: usize,
}

impl Breaks {
    /// Those between two angles, for these levels.
    pub fn new(
        view: &BulbView,
        slopes: &Slopes<'_>,
        disc: &Disc,
        levels: &[f64; LEVELS],
        [low, high]: [f64; 2],
        depth: Depth,
    ) -> Self {
        let mut breaks = Self {
            angles: [high; LEVELS * BREAKS_A_LEVEL],
            count: 0,
        };
        let [least, largest] = view.cosines();
        for &level in levels {
            if level <= least || level >= largest {
                continue;
            }
            let circle = Circle {
                view,
                slopes,
                disc,
                level,
            };
            for p in circle.bends(depth.most) {
                let sine = (p - disc.p) / disc.radius;
                let angle = libm::asin(sine.clamp(-1.0, 1.0));
                if low < angle && angle < high {
                    breaks.angles[breaks.count] = angle;
                    breaks.count += 1;
                }
            }
        }
        breaks.angles[..breaks.count].sort_unstable_by(f64::total_cmp);
        breaks
    }

    /// In ascending order.
    pub fn angles(&self) -> &[f64] {
        &self.angles[..self.count]
    }
}

/// A level's circle, and what it runs through.
struct Circle<'a> {
    view: &'a BulbView,
    slopes: &'a Slopes<'a>,
    disc: &'a Disc,
    level: f64,
}

impl Circle<'_> {
    /// The p at which the chords' integrals bend. Where the lobe's exponent is above `most` nothing counts.
    fn bends(&self, most: f64) -> impl Iterator<Item = f64> {
        let [n_u, n_v] = [self.slopes.lobe.n_u, self.slopes.lobe.n_v];
        let counts = move |&[p, q]: &[f64; 2]| 0.5 * (n_u * p * p + n_v * q * q) <= most;
        let met = self.touched().chain(self.on_edge()).filter(counts);
        met.map(|[p, _]| p).chain(self.leaving_lobe())
    }

    /// Where it touches chords, if on the bulb.
    fn touched(&self) -> impl Iterator<Item = [f64; 2]> {
        let wo = self.slopes.wo;
        let sum = self.level + wo.z;
        let (p, q) = (wo.x / sum, wo.y / sum);
        let radius = (p * p + q * q + 2.0 * wo.z / sum - 1.0).max(0.0).sqrt();
        let least_cosine = (1.0 - self.view.sin2).sqrt();
        [p - radius, p + radius]
            .map(|p| [p, q])
            .into_iter()
            .filter(move |&[p, q]| self.slopes.light(p, q).dot(self.view.centre) > least_cosine)
    }

    /// Where it leaves the bulb.
    fn on_edge(&self) -> impl Iterator<Item = [f64; 2]> {
        let Vec3 { x, y, z } = self.view.centre;
        let wo = self.slopes.wo;
        // Light there has x and y on a line across the bulb's azimuth, and on a circle.
        let across2 = x * x + y * y;
        let along = ((1.0 - self.view.sin2).sqrt() - self.level * z) / across2;
        let beside2 = (1.0 - self.level * self.level) / across2 - along * along;
        let beside = beside2.sqrt();
        let met = beside2.is_finite() && beside2 > 0.0;
        [-beside, beside]
            .into_iter()
            .filter(move |_| met)
            .map(move |beside| {
                let half =
                    Vec3::new(x * along - y * beside, y * along + x * beside, self.level) + wo;
                [half.x / half.z, half.y / half.z]
            })
    }

    /// Where it enters and leaves the lobe's bulk, if it runs nearly along the chords there.
    fn leaving_lobe(&self) -> impl Iterator<Item = f64> {
        let (lobe, disc) = (self.slopes.lobe, self.disc);
        let (bottom, top) = (disc.q - disc.height(), disc.q + disc.height());
        let near = 0f64.clamp(bottom, top);
        let bulk = BULK_WIDTHS / lobe.n_v.sqrt();
        let [[a, c], [b, d]] = [(near - bulk).max(bottom), (near + bulk).min(top)]
            .map(|q| self.slopes.crossings_along(q, self.level));
        let width = 1.0 / lobe.n_u.sqrt();
        [[a, b], [c, d]]
            .into_iter()
            .filter(move |[from, to]| (from - to).abs() < STEEP_WIDTHS * width)
            .flatten()
    }
}
