//! The colour chart in a sample whose lobe is narrow along at least one axis.
//!
//! In the slope plane of half vectors (p, q) (see [`bulb`](super::bulb)) the edges of the chart's
//! patches are conics ([`conic`]). Along the lobe's narrow axis p the lobe is a normal density times
//! a factor that a few points tell, so a line of constant q is integrated in closed form piece by
//! piece between the edges it crosses ([`moments`]). The wide axis q is integrated by Gauss rules
//! between the places where that integral is not smooth: where an edge crosses the axis p = 0, where
//! a corner of a patch lies in the lobe, and where an edge that runs along p enters and leaves it.

mod conic;
mod line;
mod moments;

use super::chart::{LIGHT_NODES, LitChart};
use super::gauss::GaussRule;
use super::slopes::Fineness;
use crate::instructions::Instructions;
use crate::reflectance::Reflectance;
use crate::vector::Vec3;
use conic::Conic;
use line::{Branches, Cuts, Lines};
use moments::Order;

/// From this exponent along the narrow axis on, and from this ratio of the two exponents on, rules
/// along the lobe's axes take fewer evaluations than those along the chart's.
const NARROW_EXPONENT: f64 = 300.0;
const ANISOTROPY: f64 = 20.0;

/// Whether the chart in a sample of this material is worked out here.
pub fn wanted(reflectance: &Reflectance) -> bool {
    let lobe = &reflectance.lobe;
    reflectance.specular_share == 1.0
        && lobe.n_u > NARROW_EXPONENT
        && lobe.n_u > ANISOTROPY * lobe.n_v
}

/// Digits beyond those that count at which the lobe's tail is cut.
const TAIL_DIGITS: f64 = 0.5;

/// Above this exponent what multiplies the lobe is a parabola over it to five digits.
const PARABOLA_EXPONENT: f64 = 3e4;

/// Widths from the middle of an edge's passage through the lobe at which it is over.
const PASSAGE: f64 = 3.5;

/// A corner of a patch shows as a kink if it lies within so many widths of the axis p = 0.
const CORNER_REACH: f64 = 2.0;

/// The most corners that are looked at.
const CORNERS_MAX: usize = 256;

/// A passage shorter than this share of the lobe's wide width is a step.
const STEP: f64 = 1e-4;

/// The chart off a narrow lobe.
pub struct GlossyChart<'a> {
    chart: &'a LitChart,
    reflectance: &'a Reflectance,
    instructions: Instructions,
    /// The panel's corner and axes in the lobe's frame, these over the pitch of its patches.
    corner: Vec3,
    axes: [Vec3; 3],
    /// The corners of patches in the lobe's frame; none if there are too many.
    corners: Vec<Vec3>,
    /// The light on each patch as in [`LitChart::light`], with channels to fill a vector.
    light: Vec<[[[f64; LIGHT_CHANNELS]; LIGHT_NODES]; LIGHT_NODES]>,
}

/// Three channels and one that is 0.
const LIGHT_CHANNELS: usize = 4;

/// Buffers.
#[derive(Default)]
pub struct Scratch {
    passages: Vec<Passage>,
    ends: Vec<End>,
    lines: Lines,
    cuts: Cuts,
}

/// An edge of patches that passes through the lobe along the wide axis.
#[derive(Clone, Copy, Debug)]
struct Passage {
    /// The q at which it crosses p = 0.
    middle: f64,
    /// Widths of the lobe along p that it passes a unit of q.
    rate: f64,
}

/// Where a piece of the wide axis may end.
#[derive(Clone, Copy, Debug)]
struct End {
    q: f64,
    /// Whether the integral over p bends here, so that a piece has to end.
    kink: bool,
}

/// A piece of the wide axis.
#[derive(Clone, Copy, Debug)]
struct Piece {
    from: f64,
    to: f64,
    /// The fastest change on it, in widths a unit of q.
    rate: f64,
}

impl Piece {
    fn points(&self, fineness: Fineness) -> usize {
        fineness.points((self.to - self.from) * self.rate, 0.0)
    }

    /// The piece that covers both.
    fn with(&self, next: &Self) -> Self {
        Self {
            from: self.from,
            to: next.to,
            rate: self.rate.max(next.rate),
        }
    }

    fn is_cheaper_with(&self, next: &Self, fineness: Fineness) -> bool {
        self.with(next).points(fineness) <= self.points(fineness) + next.points(fineness)
    }
}

impl<'a> GlossyChart<'a> {
    /// Of a chart and a material.
    pub fn new(
        chart: &'a LitChart,
        reflectance: &'a Reflectance,
        instructions: Instructions,
    ) -> Self {
        let (panel, lobe) = (&chart.panel, &reflectance.lobe);
        let per_pitch = 1.0 / panel.pitch;
        let [columns, rows] = [panel.columns, panel.rows].map(|count| count + 1);
        let corners = if (columns * rows) as usize <= CORNERS_MAX {
            (0..rows)
                .flat_map(|row| (0..columns).map(move |column| [column, row].map(f64::from)))
                .map(|[a, b]| lobe.to_lobe(panel.point(a * panel.pitch, b * panel.pitch)))
                .collect()
        } else {
            Vec::new()
        };
        Self {
            chart,
            reflectance,
            instructions,
            corner: lobe.to_lobe(panel.corner),
            axes: [panel.x, panel.y, panel.z].map(|axis| lobe.to_lobe(axis * per_pitch)),
            corners,
            light: chart
                .light
                .iter()
                .map(|patch| patch.map(|row| row.map(|[r, g, b]| [r, g, b, 0.0])))
                .collect(),
        }
    }

    /// The chart's light off the sample at `position` toward `wo` (unit, the world's frame), in units
    /// of white, and how many evaluations it took.
    pub fn reflected(
        &self,
        position: Vec3,
        wo: Vec3,
        fineness: Fineness,
        scratch: &mut Scratch,
    ) -> ([f64; 3], u32) {
        let lobe = &self.reflectance.lobe;
        let response = self.reflectance.tint_response(wo.z);
        let point = Point::new(self, position, wo, response.knee, fineness);
        point.gather(scratch);
        let sums = line::add_lines(self.instructions, &point, &scratch.lines, &mut scratch.cuts);
        let scale = lobe.normalization / (2.0 * std::f64::consts::PI);
        let radiance = std::array::from_fn(|channel| {
            scale * response.at_moments(sums.fresnel[channel], sums.excess[channel])[channel]
        });
        (radiance, sums.evaluations)
    }
}

/// A point of the sample, a viewer, and how fine to be.
pub struct Point<'a> {
    glossy: &'a GlossyChart<'a>,
    /// In the lobe's frame.
    wo: Vec3,
    position: Vec3,
    /// The place on the chart in patches from its corner, times `depth`, and the depth itself:
    /// positive where the direction meets the front.
    across: Conic,
    up: Conic,
    depth: Conic,
    branches: Branches,
    fineness: Fineness,
    /// Half the lobe's reach along p, in widths.
    reach: f64,
    /// Columns and rows of patches.
    counts: [f64; 2],
    order: Order,
}

impl<'a> Point<'a> {
    fn new(
        glossy: &'a GlossyChart<'a>,
        position: Vec3,
        wo: Vec3,
        knee: f64,
        fineness: Fineness,
    ) -> Self {
        let reflectance = glossy.reflectance;
        let lobe = &reflectance.lobe;
        let (wo, position) = (lobe.to_lobe(wo), lobe.to_lobe(position));
        let [x, y, z] = glossy.axes;
        let offset = position - glossy.corner;
        // Patches from the panel's plane. A direction w meets it at offset + w height / -(z.w).
        let pitch = glossy.chart.panel.pitch;
        let height = pitch * z.dot(offset);
        let unit_z = z * pitch;
        let order = if lobe.n_u > PARABOLA_EXPONENT {
            Order::Three
        } else {
            Order::Five
        };
        Self {
            glossy,
            wo,
            position,
            across: Conic::of(x * height - unit_z * x.dot(offset), wo),
            up: Conic::of(y * height - unit_z * y.dot(offset), wo),
            depth: Conic::of(-unit_z, wo),
            branches: Branches::new(wo, knee, reflectance.ior),
            fineness,
            reach: 0.5 * fineness.reach_widths(TAIL_DIGITS),
            counts: [glossy.chart.panel.columns, glossy.chart.panel.rows].map(f64::from),
            order: if fineness.is_check() {
                order.finer()
            } else {
                order
            },
        }
    }

    /// Gathers the lines of the rule.
    fn gather(&self, scratch: &mut Scratch) {
        scratch.lines.clear();
        let [low, high] = self.extent();
        if low >= high {
            return;
        }
        let mut passages = std::mem::take(&mut scratch.passages);
        let mut ends = std::mem::take(&mut scratch.ends);
        self.find_passages([low, high], &mut passages, &mut ends);
        self.find_kinks([low, high], &mut ends);
        let mut piece: Option<Piece> = None;
        for pair in ends.windows(2) {
            let (from, to) = (pair[0].q, pair[1].q);
            if from >= to {
                continue;
            }
            let next = Piece {
                from,
                to,
                rate: self.rate(0.5 * (from + to), &passages),
            };
            piece = match piece {
                Some(piece) if !pair[0].kink && piece.is_cheaper_with(&next, self.fineness) => {
                    Some(piece.with(&next))
                }
                Some(done) => {
                    self.add_lines(&done, scratch);
                    Some(next)
                }
                None => Some(next),
            };
        }
        if let Some(piece) = piece {
            self.add_lines(&piece, scratch);
        }
        (scratch.passages, scratch.ends) = (passages, ends);
    }

    /// Adds the lines of a piece of the wide axis.
    #[inline(always)]
    fn add_lines(&self, piece: &Piece, scratch: &mut Scratch) {
        let rule = GaussRule::of(piece.points(self.fineness));
        // q = 2x/(1 - x^2): a lobe that is wide along q runs to infinity.
        for (x, weight) in rule.on(half_tangent(piece.from), half_tangent(piece.to)) {
            let per = 1.0 / (1.0 - x * x);
            let slope = 2.0 * (1.0 + x * x) * per * per;
            scratch.lines.push([2.0 * x * per, weight * slope]);
        }
    }

    /// How fast the integral over p changes at q: widths of the lobe or of an edge's passage a unit.
    #[inline(always)]
    fn rate(&self, q: f64, passages: &[Passage]) -> f64 {
        let per_width = self.glossy.reflectance.lobe.n_v.sqrt();
        let covering = passages
            .iter()
            .filter(|passage| (q - passage.middle).abs() * passage.rate < PASSAGE);
        covering.fold(per_width, |rate, passage| rate.max(passage.rate))
    }

    /// The q between which the lobe is integrated: it reaches no farther, or light stands below the
    /// horizon beyond.
    #[inline(always)]
    fn extent(&self) -> [f64; 2] {
        let lobe = &self.glossy.reflectance.lobe;
        let reach = self.fineness.reach(lobe.n_v, TAIL_DIGITS);
        let horizon = Conic::level(0.0, self.wo);
        let widest = self.reach / lobe.n_u.sqrt();
        let (mut low, mut high) = (0.0f64, 0.0f64);
        for p in [-widest, 0.0, widest] {
            for q in horizon
                .on_column(p)
                .zeros()
                .into_iter()
                .filter(|q| q.is_finite())
            {
                (low, high) = (low.min(q), high.max(q));
            }
        }
        [low.max(-reach), high.min(reach)]
    }

    /// Finds where edges of patches pass through the lobe, and where pieces may end for them.
    #[inline(always)]
    fn find_passages(
        &self,
        [low, high]: [f64; 2],
        passages: &mut Vec<Passage>,
        ends: &mut Vec<End>,
    ) {
        passages.clear();
        ends.clear();
        let panel = &self.glossy.chart.panel;
        let lobe = &self.glossy.reflectance.lobe;
        let (per_width, wide) = (lobe.n_u.sqrt(), 1.0 / lobe.n_v.sqrt());
        let counts = [panel.columns, panel.rows];
        let along = [&self.across, &self.up];
        for axis in 0..2 {
            for line in 0..=counts[axis] {
                let edge = along[axis].less(f64::from(line), &self.depth);
                for middle in edge.on_axis().zeros() {
                    if !(middle > low && middle < high) {
                        continue;
                    }
                    let depth = self.depth.value(0.0, middle);
                    let other = along[1 - axis].value(0.0, middle);
                    let most = f64::from(counts[1 - axis]) + 1.0;
                    if !(depth > 0.0 && other > -depth && other < most * depth) {
                        continue;
                    }
                    let rate = edge.drift(middle) * per_width;
                    let half = PASSAGE / rate;
                    if half < STEP * wide {
                        ends.push(End {
                            q: middle,
                            kink: true,
                        });
                    } else if rate * wide > 1.0 {
                        passages.push(Passage { middle, rate });
                        ends.extend([middle - half, middle + half].map(|q| End { q, kink: false }));
                    }
                }
            }
        }
        ends.retain(|end| end.q > low && end.q < high);
        ends.extend([low, high].map(|q| End { q, kink: true }));
    }

    /// Finds where the integral over p has a kink, and sorts all ends.
    #[inline(always)]
    fn find_kinks(&self, [low, high]: [f64; 2], ends: &mut Vec<End>) {
        let per_width = self.glossy.reflectance.lobe.n_u.sqrt();
        let levels = self
            .branches
            .levels()
            .flat_map(|level| level.on_axis().zeros());
        let corners = self.glossy.corners.iter().filter_map(|corner| {
            let half = self.wo + (*corner - self.position).normalized();
            let [p, q] = [half.x / half.z, half.y / half.z];
            (p.abs() * per_width < CORNER_REACH).then_some(q)
        });
        let kinks = levels.chain(corners).filter(|&q| q > low && q < high);
        ends.extend(kinks.map(|q| End { q, kink: true }));
        ends.sort_unstable_by(|a, b| a.q.total_cmp(&b.q));
    }
}

/// tan(atan(q)/2), which stays finite as q does not.
fn half_tangent(q: f64) -> f64 {
    q / (1.0 + (1.0 + q * q).sqrt())
}
