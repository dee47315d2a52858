//! Edges and corners of patches near the lobe's wide axis, side by side, one a lane.

use super::conic::{Conic, Conics};
use super::lanes::Lanes;
use super::passages::{End, Found, Passage};
use super::point::Point;
use crate::hybrid::budget::glossy::{BEND_MAX, BENT, PASSAGE, STEP};
use crate::numerics::batch::LANES;
use crate::numerics::instructions::kernel;
use crate::vector::Vec3;

type Flags = [bool; LANES];

kernel! {
    /// Finds where edges of patches pass through the lobe between two q, and where pieces may end for them.
    pub fn find_passages(point: &Point<'_>, extent: [f64; 2], found: &mut Found) {
        let plane = &point.glossy.plane;
        let counts = [plane.columns, plane.rows];
        let along = [&point.across, &point.up];
        let widths = Widths::of(point);
        for axis in 0..2 {
            let shown = Shown {
                extent,
                other: along[1 - axis],
                depth: &point.depth,
                most: f64::from(counts[1 - axis]) + 1.0,
            };
            for first in (0..=counts[axis]).step_by(LANES) {
                let mut lines = [0.0; LANES];
                for i in 0..LANES {
                    lines[i] = f64::from(first) + i as f64;
                }
                let edges = Conics::less(along[axis], &lines, &point.depth);
                let [one, other] = edges.zeros_on_axis();
                let crossings = [
                    Crossings::new(&edges, one, &shown, &widths),
                    Crossings::new(&edges, other, &shown, &widths),
                ];
                let bends = may_turn(&edges, &crossings, &widths);
                let bent = if bends == [false; LANES] {
                    None
                } else {
                    Some(bent_passages(&edges, &crossings, &shown, &widths))
                };
                let count = (counts[axis] + 1 - first) as usize;
                for i in 0..count.min(LANES) {
                    for crossings in &crossings {
                        crossings.add(i, point, found);
                    }
                    if bends[i] {
                        for bent in bent.iter().flatten() {
                            bent.add(i, found);
                        }
                    }
                }
            }
        }
    }
}

kernel! {
    /// Finds the corners of patches that lie in the lobe, up to `reach` widths from its wide axis: there the integral
    /// along the narrow one has a kink.
    pub fn find_corners(point: &Point<'_>, extent: [f64; 2], reach: f64, ends: &mut Vec<End>) {
        let [low, high] = extent;
        // The lobe is nowhere wider than at the farther end: most corners are out of reach even of that.
        let farthest = reach / point.widths_per_slope(high.max(-low));
        let Vec3 { x, y, z } = point.position;
        let wo = point.wo;
        let corners = &point.glossy.corners;
        for (block, [across, along, up]) in corners.blocks().enumerate() {
            let [mut p, mut q] = [[0.0; LANES]; 2];
            let mut may_show = [false; LANES];
            for i in 0..LANES {
                let [a, b, c] = [across[i] - x, along[i] - y, up[i] - z];
                let per_length = 1.0 / (a * a + b * b + c * c).sqrt();
                let half = [wo.x + a * per_length, wo.y + b * per_length, wo.z + c * per_length];
                p[i] = half[0] / half[2];
                q[i] = half[1] / half[2];
                may_show[i] = (q[i] > low) & (q[i] < high) & (p[i].abs() <= farthest);
            }
            if may_show == [false; LANES] {
                continue;
            }
            let count = corners.count() - block * LANES;
            for i in 0..count.min(LANES) {
                if may_show[i] && p[i].abs() * point.widths_per_slope(q[i]) < reach {
                    ends.push(End::kink(q[i]));
                }
            }
        }
    }
}

/// The lobe's widths in the slope plane.
struct Widths {
    /// Those along p for a unit of slope.
    per_p: f64,
    /// The square of the one along p.
    p_squared: f64,
    /// The one along q.
    q: f64,
    /// The error that the rule may have.
    error: f64,
}

impl Widths {
    fn of(point: &Point<'_>) -> Self {
        Self {
            per_p: point.glossy.reflectance.lobe.n_u.sqrt(),
            p_squared: 1.0 / point.glossy.reflectance.lobe.n_u,
            q: 1.0 / point.per_wide_width,
            error: point.error,
        }
    }
}

/// Where an edge is one of the chart's as the sample sees it.
struct Shown<'a> {
    extent: [f64; 2],
    /// The position on the chart along the edge, times the depth; and the depth.
    other: &'a Conic,
    depth: &'a Conic,
    /// The most patches along the edge, and one.
    most: f64,
}

impl Shown<'_> {
    /// At these q of the wide axis.
    #[inline(always)]
    fn at(&self, q: &Lanes) -> Flags {
        let [low, high] = self.extent;
        let (depth, other) = (self.depth.values_on_axis(q), self.other.values_on_axis(q));
        let mut shown = [false; LANES];
        for i in 0..LANES {
            shown[i] = (q[i] > low)
                & (q[i] < high)
                & (depth[i] > 0.0)
                & (other[i] > -depth[i])
                & (other[i] < self.most * depth[i]);
        }
        shown
    }
}

/// Where edges cross the wide axis.
struct Crossings {
    q: Lanes,
    /// Widths of the narrow axis a unit of q.
    rate: Lanes,
    /// How far the passages go on to either side.
    half: Lanes,
    /// Where steps stand for them.
    step: Lanes,
    /// The middles of passages: where an edge bends less in the lobe than it is slanted, where it crosses the axis.
    middle: Lanes,
    /// Whether it is so short that it is a kink.
    is_kink: Flags,
    /// Whether it is a longer passage of an edge that is nearly straight.
    is_passage: Flags,
    /// Whether a step in its place misses no more than the tolerance.
    is_step: Flags,
    /// Whether the edge bends within its passage.
    is_bent: Flags,
}

impl Crossings {
    #[inline(always)]
    fn new(edges: &Conics, q: Lanes, shown: &Shown<'_>, widths: &Widths) -> Self {
        let (drift, shows) = (edges.drift(&q), shown.at(&q));
        let bend_along_q = edges.bend_along_q(&q);
        let [mut rate, mut half, mut step, mut middle] = [[0.0; LANES]; 4];
        for i in 0..LANES {
            rate[i] = drift[i] * widths.per_p;
            half[i] = PASSAGE / rate[i];
        }
        let bend = edges.bend(&q, &half);
        let [mut is_kink, mut is_passage, mut is_bent, mut is_step] = [[false; LANES]; 4];
        for i in 0..LANES {
            // At one width of p. Of an edge that bends by much the first terms of its bend tell nothing.
            let bent = bend_along_q[i] * widths.p_squared;
            let is_little = bent.abs() < BEND_MAX * widths.q;
            let bent = if is_little { bent } else { 0.0 };
            let is_straight = PASSAGE * bent.abs() * rate[i] < BENT;
            step[i] = q[i] + bent;
            middle[i] = if is_straight { q[i] } else { step[i] };
            is_bent[i] = bend[i] * widths.per_p > BENT * PASSAGE;
            is_kink[i] = shows[i] & (half[i] < STEP * widths.q);
            let fast = rate[i] * widths.q;
            is_passage[i] = shows[i] & !is_kink[i] & (fast > 1.0) & !is_bent[i];
            is_step[i] = 0.5 < widths.error * fast * fast;
        }
        Self {
            q,
            rate,
            half,
            step,
            middle,
            is_kink,
            is_passage,
            is_step,
            is_bent,
        }
    }

    /// Whether one of them lies between two q, and the edge is nearly straight.
    #[inline(always)]
    fn crosses(&self, i: usize, from: f64, to: f64) -> bool {
        (from < self.q[i]) & (self.q[i] < to) & !self.is_bent[i]
    }

    /// Adds one of them.
    #[inline(always)]
    fn add(&self, i: usize, point: &Point<'_>, found: &mut Found) {
        if self.is_kink[i] {
            found.ends.push(End::kink(self.step[i]));
        } else if self.is_passage[i] {
            let passage = Passage {
                middle: self.middle[i],
                rate: self.rate[i],
                half: self.half[i],
                step: self.step[i],
            };
            if self.is_step[i] {
                found.add_step(passage);
            } else {
                found.add_passage(passage, point);
            }
        }
    }
}

/// Which edges may turn back within the lobe: those that bend where they cross the wide axis, and those that do not
/// cross it but lines as far beside it as a passage reaches.
#[inline(always)]
fn may_turn(edges: &Conics, crossings: &[Crossings; 2], widths: &Widths) -> Flags {
    let distance = PASSAGE / widths.per_p;
    let cross = |distance: f64| edges.cross_beside_axis(distance);
    let [on_axis, above, below] = [cross(0.0), cross(distance), cross(-distance)];
    let [one, other] = crossings;
    let mut may = [false; LANES];
    for i in 0..LANES {
        let comes_near = !on_axis[i] & (above[i] | below[i]);
        may[i] = comes_near | one.is_bent[i] | other.is_bent[i];
    }
    may
}

/// Passages of edges that bend: between two q at which they are as far from the wide axis as a passage reaches.
struct Bent {
    from: Lanes,
    to: Lanes,
    rate: Lanes,
    is_passage: Flags,
}

impl Bent {
    /// Adds one of them.
    #[inline(always)]
    fn add(&self, i: usize, found: &mut Found) {
        if !self.is_passage[i] {
            return;
        }
        let (from, to) = (self.from[i], self.to[i]);
        let middle = 0.5 * (from + to);
        found.passages.push(Passage {
            middle,
            rate: self.rate[i],
            half: 0.5 * (to - from),
            step: middle,
        });
        // No rule of three lines serves it.
        found.ends.extend([from, to].map(|q| End {
            kink: false,
            ..End::kink(q)
        }));
    }
}

/// The passages of edges that bend: they may turn back before they cross the axis, or after.
#[inline(always)]
fn bent_passages(
    edges: &Conics,
    crossings: &[Crossings; 2],
    shown: &Shown<'_>,
    widths: &Widths,
) -> [Bent; 3] {
    let distance = PASSAGE / widths.per_p;
    let [a, b] = edges.zeros_beside_axis(distance);
    let [c, d] = edges.zeros_beside_axis(-distance);
    let [a, b, c, d] = &sorted([a, b, c, d]);
    [
        bent_passage(edges, [a, b], crossings, shown, widths),
        bent_passage(edges, [b, c], crossings, shown, widths),
        bent_passage(edges, [c, d], crossings, shown, widths),
    ]
}

/// The passages between two of these q, if edges are near the axis there and do not simply cross it.
#[inline(always)]
fn bent_passage(
    edges: &Conics,
    bounds: [&Lanes; 2],
    crossings: &[Crossings; 2],
    shown: &Shown<'_>,
    widths: &Widths,
) -> Bent {
    let [low, high] = shown.extent;
    let [mut from, mut to, mut middle] = [[0.0; LANES]; 3];
    for i in 0..LANES {
        from[i] = if bounds[0][i] > low {
            bounds[0][i]
        } else {
            low
        };
        to[i] = if bounds[1][i] < high {
            bounds[1][i]
        } else {
            high
        };
        middle[i] = 0.5 * (from[i] + to[i]);
    }
    let near = edges.near_axis(&middle);
    let (begins, passes, stops) = (shown.at(&from), shown.at(&middle), shown.at(&to));
    let (at_begin, at_stop) = (edges.drift(&from), edges.drift(&to));
    let [one, other] = crossings;
    let (mut rate, mut is_passage) = ([0.0; LANES], [false; LANES]);
    for i in 0..LANES {
        let (begin, stop) = (at_begin[i], at_stop[i]);
        rate[i] = if begin > stop { begin } else { stop } * widths.per_p;
        let is_near = (from[i] < to[i]) & (near[i].abs() * widths.per_p < PASSAGE);
        let is_seen = begins[i] | passes[i] | stops[i];
        let is_crossed = one.crosses(i, from[i], to[i]) | other.crosses(i, from[i], to[i]);
        is_passage[i] = is_near & is_seen & (rate[i] * widths.q > 1.0) & !is_crossed;
    }
    Bent {
        from,
        to,
        rate,
        is_passage,
    }
}

/// The numbers of each lane in ascending order.
#[inline(always)]
fn sorted(mut numbers: [Lanes; 4]) -> [Lanes; 4] {
    for [one, other] in [[0, 1], [2, 3], [0, 2], [1, 3], [1, 2]] {
        for i in 0..LANES {
            let (a, b) = (numbers[one][i], numbers[other][i]);
            numbers[one][i] = if a < b { a } else { b };
            numbers[other][i] = if a < b { b } else { a };
        }
    }
    numbers
}
