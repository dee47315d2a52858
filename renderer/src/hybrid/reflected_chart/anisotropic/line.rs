//! A line of constant q in the slope plane: pieces of patches, in closed form along p.

use super::kernel::PieceBatch;
use super::moments::{self, Moments, POINTS_MAX};
use super::point::Point;
use crate::hybrid::reflected_chart::lit_chart::patch_at;
use crate::numerics::elementary::log1p;

/// Buffers.
#[derive(Default)]
pub struct LineScratch {
    /// Where pieces end.
    ends: Vec<f64>,
}

/// Weights of the points of a line, by whether the tint is beyond its knee; then by channel where
/// light stands higher than the viewer, and by channel where lower.
struct Weights {
    used: [bool; 2],
    weights: [[[f64; POINTS_MAX]; 6]; 2],
}

impl Point<'_> {
    /// Adds the points of the line of this q, whose integral along p has this weight.
    #[inline(always)]
    pub fn add_line(&self, q: f64, weight: f64, scratch: &mut LineScratch, batch: &mut PieceBatch) {
        let lobe = &self.anisotropic.reflectance.lobe;
        let q2 = q * q;
        // The lobe is exp(-(n_u p^2 + n_v q^2) ln(1+t)/(2t)), t about q^2.
        let widening = if q2 > 1e-12 { log1p(q2) / q2 } else { 1.0 };
        let per_width = (lobe.n_u * widening).sqrt();
        let reach = self.reach / per_width;
        let ends = &mut scratch.ends;
        if !self.find_ends(q, reach, ends) {
            return;
        }
        let mut weights = Weights {
            used: [false; 2],
            weights: [[[0.0; POINTS_MAX]; 6]; 2],
        };
        let (mut from, mut below) = (-reach, moments::NOTHING);
        let mut seen = None;
        for index in 0..=ends.len() {
            let (to, above) = match ends.get(index) {
                Some(&end) => (end, moments::up_to(end * per_width)),
                None => (reach, moments::EVERYTHING),
            };
            let piece = [from, to];
            if let Some(at) = self.add_piece(q, piece, [&below, &above], &mut weights) {
                seen = Some(at);
            }
            (from, below) = (to, above);
        }
        if let Some(seen) = seen {
            self.add_points([q, per_width], weight / per_width, &weights, seen, batch);
        }
    }

    /// Where on the line pieces end: edges of patches and bends of the integrand. False where the line
    /// shows nothing of the chart.
    #[inline(always)]
    fn find_ends(&self, q: f64, reach: f64, ends: &mut Vec<f64>) -> bool {
        ends.clear();
        let depth = self.depth.on_line(q);
        let depths = [-reach, 0.0, reach].map(|p| depth.value(p));
        let in_front = depths.iter().all(|&depth| depth > 0.0);
        let plane = &self.anisotropic.chart.plane;
        let counts = [plane.columns, plane.rows];
        let positions = [&self.across, &self.up].map(|position| position.on_line(q));
        let mut lines = [[0, plane.columns], [0, plane.rows]];
        if in_front {
            for axis in 0..2 {
                let at = [-reach, 0.0, reach];
                let at: [f64; 3] =
                    std::array::from_fn(|i| positions[axis].value(at[i]) / depths[i]);
                let [low, high] = [at[0].min(at[1]).min(at[2]), at[0].max(at[1]).max(at[2])];
                // Between the three it may bend, but by less than a patch.
                let most = f64::from(counts[axis]);
                if high < -1.0 || low > most + 1.0 {
                    return false;
                }
                lines[axis] = [
                    low.max(0.0) as u32,
                    (high.min(most - 1.0).max(-1.0) + 1.0) as u32,
                ];
            }
        }
        for axis in 0..2 {
            let (position, other) = (&positions[axis], &positions[1 - axis]);
            let most = f64::from(counts[1 - axis]);
            for edge in lines[axis][0]..=lines[axis][1] {
                let edge = position.less(f64::from(edge), &depth);
                if !edge.may_vanish(reach) {
                    continue;
                }
                for p in edge.zeros() {
                    // Beyond the chart its lattice parts nothing.
                    let (at, depth) = (other.value(p), depth.value(p));
                    if p.abs() < reach && at >= 0.0 && at <= most * depth {
                        ends.push(p);
                    }
                }
            }
        }
        for level in self.branches.levels() {
            let level = level.on_line(q);
            if level.may_vanish(reach) {
                ends.extend(level.zeros().into_iter().filter(|p| p.abs() < reach));
            }
        }
        ends.sort_unstable_by(f64::total_cmp);
        true
    }

    /// Adds a piece's weights if it shows a patch, and tells where on the chart its middle is.
    #[inline(always)]
    fn add_piece(
        &self,
        q: f64,
        [from, to]: [f64; 2],
        [below, above]: [&Moments; 2],
        weights: &mut Weights,
    ) -> Option<[f64; 2]> {
        let middle = 0.5 * (from + to);
        let depth = self.depth.value(middle, q);
        let [across, up] =
            [&self.across, &self.up].map(|position| position.value(middle, q) / depth);
        let chart = self.anisotropic.chart;
        let [columns, rows] = [chart.plane.columns, chart.plane.rows];
        let on_chart = depth > 0.0
            && (0.0..f64::from(columns)).contains(&across)
            && (0.0..f64::from(rows)).contains(&up);
        if !on_chart || from >= to {
            return None;
        }
        let colour = &chart.patches[chart.patch(across as u32, up as u32)];
        let [low, beyond] = self.branches.at(self.wo, middle, q);
        let mut piece = [0.0; POINTS_MAX];
        self.order
            .add_weights(&mut piece, &moments::between(below, above), 1.0);
        let branch = usize::from(beyond);
        weights.used[branch] = true;
        let weights = &mut weights.weights[branch];
        let count = self.order.nodes().len();
        let first = if low { 3 } else { 0 };
        for (weights, colour) in weights[first..].iter_mut().zip(colour) {
            for (weight, piece) in weights[..count].iter_mut().zip(&piece[..count]) {
                *weight += colour * piece;
            }
        }
        Some([across, up])
    }

    /// Adds the points of a line. Light is a smooth function of the position on the chart, told beyond
    /// its edges by the parabolas of the outer patches.
    #[inline(always)]
    fn add_points(
        &self,
        [q, per_width]: [f64; 2],
        scale: f64,
        all: &Weights,
        seen: [f64; 2],
        batch: &mut PieceBatch,
    ) {
        let depth = self.depth.on_line(q);
        let [across, up] = [&self.across, &self.up].map(|position| position.on_line(q));
        let inverse_densities = self.order.inverse_densities();
        for (k, &z) in self.order.nodes().iter().enumerate() {
            let p = z / per_width;
            let depth = depth.value(p);
            let at = if depth > 0.0 {
                [across.value(p) / depth, up.value(p) / depth]
            } else {
                seen
            };
            // The density's own fall is in the weights, and the kernel gives all of the lobe.
            let scale = scale * inverse_densities[k];
            let light = self.light(at).map(|light| scale * light);
            for (beyond, weights) in all.weights.iter().enumerate() {
                if !all.used[beyond] {
                    continue;
                }
                let [r, g, b, r_low, g_low, b_low] =
                    std::array::from_fn(|i| weights[i][k] * light[i % 3]);
                batch.push([p, q, beyond as f64, r, g, b, r_low, g_low, b_low]);
            }
        }
    }

    /// The light on the chart, in patches from its corner.
    #[inline(always)]
    fn light(&self, at: [f64; 2]) -> [f64; 3] {
        let chart = self.anisotropic.chart;
        let counts = [chart.plane.columns, chart.plane.rows].map(f64::from);
        let cell: [u32; 2] =
            std::array::from_fn(|axis| at[axis].clamp(0.0, counts[axis] - 1.0) as u32);
        let within =
            std::array::from_fn(|axis| (at[axis] - f64::from(cell[axis])).clamp(-1.0, 2.0));
        let patch = chart.patch(cell[0], cell[1]);
        patch_at(&chart.light[patch], &[1.0; 3], within)
    }
}
