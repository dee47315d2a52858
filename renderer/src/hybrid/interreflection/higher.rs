//! Orders from 2 on: from the chart off the sample to the chart, over and over.
//!
//! A cubature over the chart gives points that send light; the nodes of tiles receive it. For every
//! pair the integral over the sample is worked out once. That matrix takes the bulb's light on the
//! chart to order 2, order 1 to order 3, and any order to the second next.
//!
//! Where the chart is not much wider than the sample, one tile with few terms holds all of it. So that
//! is tried first. If points off its nodes show that it does not, the chart is cut into the columns of
//! order 1, and the worst tile is halved, or has finer rules, until none misses too much or the limit
//! on evaluations is reached. Then the tiles state what they miss.

use super::frame::Frame;
use super::levels::{TERMS, compared};
use super::matrix::{Points, Row, rows};
use super::tiles::{Tiles, columns, halved, lattice};
use super::unresolved::{Unresolved, unresolved_error};
use crate::hybrid::budget::interreflection::{
    EVALUATIONS_MAX, EXCESS_WORTH_ALL, HALVINGS_MAX, LEVEL_MAX, LEVEL_TIMES, OFF_NODES,
    OFF_NODES_DOUBT, RULE_SHARE, STUCK, STUCK_MISSED, TERMS_TIMES, UNRESOLVED_SHARE,
};
use crate::numerics::channels::{add_scaled, largest, largest_difference};
use crate::numerics::chebyshev::Basis;
use crate::numerics::polygon::Rectangle;
use std::cell::OnceCell;

/// Interreflection of all orders from 2 on.
pub struct Higher {
    /// For paths of `max_bounces` hits, and of one hit less.
    pub tiles: [Tiles; 2],
    pub evaluations: u64,
}

/// What sends light, at each level.
struct Senders<'a, Order1> {
    frame: &'a Frame<'a>,
    order_1: Order1,
    levels: [OnceCell<Points>; LEVEL_MAX + 2],
}

/// Terms along either side of one tile for all of the chart, one after the other.
const COUNTS: [usize; 3] = [4, 6, TERMS];

/// All of the chart as one tile.
struct Whole {
    solved: Solved,
    level: usize,
    /// Evaluations that a tile with all terms takes at this level.
    spent: u64,
    evaluations: u64,
}

/// A part of the chart as one tile, worked out at a level.
struct Part<const COUNT: usize> {
    rectangle: Rectangle,
    level: usize,
    depth: u32,
    /// What its nodes receive.
    rows: Vec<Row>,
    /// What the rules miss against the next finer ones, at the worst of several points.
    missed: f64,
    /// What the series of the first orders leaves out by its last coefficients, and along either side.
    fit_error: f64,
    tails: [f64; 2],
    /// What it leaves out by points off its nodes.
    off_nodes: f64,
    /// Whether halving did not help.
    stuck: bool,
    evaluations: u64,
    resolved: bool,
}

/// What finer rules tell.
struct Finer {
    missed: f64,
    evaluations: u64,
    /// Whether they have points enough for the lobe.
    resolved: bool,
}

/// The orders from 2 on at the nodes of a part.
struct Sums {
    /// For paths of `max_bounces` hits, and of one hit less.
    values: [Vec<[f64; 3]>; 2],
    /// What the series of the orders leave out.
    fit_error: f64,
}

/// All orders on all parts.
struct Solved {
    tiles: [Tiles; 2],
    left_out: f64,
    missed: f64,
    largest: f64,
    resolved: bool,
}

impl Higher {
    /// Works out the orders in tiles with as many terms, or as small, and with rules as fine, as this share of
    /// the tolerance asks for.
    pub fn solve(
        frame: &Frame<'_>,
        share: f64,
        order_1: impl Fn([f64; 2]) -> [f64; 3],
    ) -> Result<Self, Unresolved> {
        let senders = Senders {
            frame,
            order_1,
            levels: Default::default(),
        };
        let allowed = share * frame.tolerance(&frame.bounds());
        let Whole {
            mut solved,
            level,
            spent,
            mut evaluations,
        } = senders.whole(allowed);
        let columns = columns(frame);
        let likely = evaluations + columns.len() as u64 * spent;
        let excess = (solved.left_out + solved.missed) / allowed;
        if excess > 1.0 && likely <= evaluations_max(excess) {
            let parts = senders.parts(columns, level, share, &mut evaluations);
            solved = senders.solved(&parts);
        }
        let Solved {
            mut tiles,
            missed,
            largest,
            resolved,
            ..
        } = solved;
        if !resolved || missed > (UNRESOLVED_SHARE * largest).max(allowed) {
            let error = unresolved_error(largest, missed)?;
            for tiles in &mut tiles {
                tiles.everywhere += error;
            }
        }
        Ok(Self { tiles, evaluations })
    }
}

impl<Order1: Fn([f64; 2]) -> [f64; 3]> Senders<'_, Order1> {
    /// The points of a level.
    fn points(&self, level: usize) -> &Points {
        self.levels[level].get_or_init(|| Points::new(self.frame, level, &self.order_1))
    }

    /// All of the chart as one tile with as many terms and rules as fine as `allowed` asks for and a limit on
    /// evaluations lets it have.
    fn whole(&self, allowed: f64) -> Whole {
        let (mut level, mut terms, mut evaluations) = (0, 0, 0);
        let mut before = f64::INFINITY;
        loop {
            let (solved, spent) = match terms {
                0 => self.whole_with::<{ COUNTS[0] }>(level),
                1 => self.whole_with::<{ COUNTS[1] }>(level),
                _ => self.whole_with::<TERMS>(level),
            };
            evaluations += spent;
            let Solved {
                left_out, missed, ..
            } = solved;
            let rules_fail = missed > RULE_SHARE * allowed || stuck(left_out, before, missed);
            let rough = rules_fail && level < LEVEL_MAX;
            let short = left_out > (1.0 - RULE_SHARE) * allowed && terms < 2;
            let times = if rough { LEVEL_TIMES } else { 1 } * if short { TERMS_TIMES } else { 1 };
            let excess = (left_out + missed) / allowed;
            let dear = evaluations + times * spent > evaluations_max(excess);
            if excess <= 1.0 || !(rough || short) || dear {
                return Whole {
                    solved,
                    level,
                    spent: spent * (TERMS * TERMS) as u64 / (COUNTS[terms] * COUNTS[terms]) as u64,
                    evaluations,
                };
            }
            level += usize::from(rough);
            terms += usize::from(short);
            before = if rough { f64::INFINITY } else { left_out };
        }
    }

    fn whole_with<const COUNT: usize>(&self, level: usize) -> (Solved, u64) {
        let part = self.part::<COUNT>(self.frame.bounds(), level, 0);
        let spent = part.evaluations;
        (self.solved(&[part]), spent)
    }

    /// The chart in tiles. The worst is halved, or its rules are refined, until none misses more than a share of
    /// its tolerance or the limit on evaluations is reached.
    fn parts(
        &self,
        columns: Vec<Rectangle>,
        level: usize,
        share: f64,
        evaluations: &mut u64,
    ) -> Vec<Part<TERMS>> {
        let columns = columns.into_iter();
        let mut parts: Vec<_> = columns.map(|column| self.part(column, level, 0)).collect();
        *evaluations += parts.iter().map(|part| part.evaluations).sum::<u64>();
        loop {
            let excesses = parts
                .iter()
                .map(|part| self.excess(part, share))
                .enumerate();
            let worst = excesses.max_by(|(_, [a, b]), (_, [c, d])| a.max(*b).total_cmp(&c.max(*d)));
            let Some((worst, [short, rough])) = worst.filter(|(_, [a, b])| a.max(*b) > 1.0) else {
                return parts;
            };
            let part = &parts[worst];
            let next: &[_] = match short >= rough {
                true => &halved(&part.rectangle, part.tails),
                false => &[part.rectangle],
            };
            let halves = next.len() > 1;
            let likely = part.evaluations * if halves { 2 } else { LEVEL_TIMES };
            if *evaluations + likely > evaluations_max(short.max(rough)) {
                return parts;
            }
            let level = part.level + usize::from(!halves);
            let depth = part.depth + u32::from(halves);
            let before = if halves {
                part.left_out()
            } else {
                f64::INFINITY
            };
            parts.swap_remove(worst);
            for rectangle in next {
                let mut part = self.part(*rectangle, level, depth);
                part.stuck = stuck(part.left_out(), before, part.missed);
                *evaluations += part.evaluations;
                parts.push(part);
            }
        }
    }

    /// What a part's series leaves out and what its rules miss, over what each may: 0 for what cannot be helped.
    fn excess(&self, part: &Part<TERMS>, share: f64) -> [f64; 2] {
        let allowed = share * self.frame.tolerance(&part.rectangle);
        let short = part.left_out() / ((1.0 - RULE_SHARE) * allowed);
        let rough = part.missed / (RULE_SHARE * allowed);
        let halving_helps = part.depth < HALVINGS_MAX && !part.stuck;
        match (part.level < LEVEL_MAX, halving_helps) {
            (true, true) => [short, rough],
            (true, false) => [0.0, short.max(rough)],
            (false, true) => [short, 0.0],
            (false, false) => [0.0; 2],
        }
    }

    /// A part of the chart at a level.
    fn part<const COUNT: usize>(
        &self,
        rectangle: Rectangle,
        level: usize,
        depth: u32,
    ) -> Part<COUNT> {
        let frame = self.frame;
        let basis = Basis::<COUNT>::new();
        let nodes: Vec<[f64; 2]> = basis.nodes(&rectangle).collect();
        let off_nodes = off_nodes(frame, &rectangle);
        let points = self.points(level);
        let at_nodes = rows(frame, &nodes, points, level);
        let beside = rows(frame, &off_nodes, points, level);
        let first = |row: &Row| match frame.view.bounces_max {
            3 => row.apply(points, |i| points.direct[i]),
            _ => row.apply(points, |i| points.first(i)),
        };
        let (tile, fit) = basis.fit(rectangle, at_nodes.iter().map(first));
        let (mut off, mut most, mut brightest) = (0.0f64, 0.0, 0);
        for (index, (at, row)) in off_nodes.iter().zip(&beside).enumerate() {
            let value = first(row);
            off = off.max(largest_difference(value, tile.value(*at)));
            if largest(value) > most {
                (most, brightest) = (largest(value), index);
            }
        }
        // Far from the column that receives most, all nodes may be dark. At the corners far from the sample rules
        // miss least.
        let [left, right, .., middle] = compared(COUNT);
        let mut checked = [left, right, middle]
            .map(|node| (nodes[node], &at_nodes[node]))
            .to_vec();
        checked.push((off_nodes[brightest], &beside[brightest]));
        let Finer {
            missed,
            evaluations,
            resolved,
        } = self.finer(level, &checked);
        let rows = at_nodes.iter().chain(&beside);
        Part {
            evaluations: evaluations + rows.map(|row| row.evaluations).sum::<u64>(),
            rectangle,
            level,
            depth,
            missed,
            fit_error: fit.error,
            tails: fit.tails,
            off_nodes: OFF_NODES_DOUBT * off,
            stuck: false,
            resolved,
            rows: at_nodes,
        }
    }

    /// What rules of a level miss against the next finer ones.
    fn finer(&self, level: usize, checked: &[([f64; 2], &Row)]) -> Finer {
        let (points, finer_points) = (self.points(level), self.points(level + 1));
        let nodes: Vec<[f64; 2]> = checked.iter().map(|(at, _)| *at).collect();
        let finer = rows(self.frame, &nodes, finer_points, level + 1);
        let missed = checked.iter().zip(&finer).map(|((_, coarse), finer)| {
            let coarse = coarse.apply(points, |i| points.first(i));
            let finer = finer.apply(finer_points, |i| finer_points.first(i));
            largest_difference(coarse, finer)
        });
        Finer {
            missed: missed.fold(0.0, f64::max),
            evaluations: finer.iter().map(|row| row.evaluations).sum(),
            resolved: finer.iter().all(|row| row.resolved),
        }
    }

    /// All orders on parts that make up the chart.
    fn solved<const COUNT: usize>(&self, parts: &[Part<COUNT>]) -> Solved {
        let basis = Basis::<COUNT>::new();
        let mut solved = Solved {
            tiles: Default::default(),
            left_out: 0.0,
            missed: 0.0,
            largest: 0.0,
            resolved: parts.iter().all(|part| part.resolved),
        };
        for (part, sums) in parts.iter().zip(self.sums(parts)) {
            let left_out = part.off_nodes.max(sums.fit_error);
            solved.left_out = solved.left_out.max(left_out);
            solved.missed = solved.missed.max(part.missed);
            for value in &sums.values[0] {
                solved.largest = solved.largest.max(largest(*value));
            }
            for (tiles, values) in solved.tiles.iter_mut().zip(sums.values) {
                let (tile, _) = basis.fit(part.rectangle, values.into_iter());
                tiles.push(tile.widened(), left_out + part.missed);
            }
        }
        solved
    }

    /// The orders from 2 on at the nodes of each part.
    fn sums<const COUNT: usize>(&self, parts: &[Part<COUNT>]) -> Vec<Sums> {
        let bounces_max = self.frame.view.bounces_max;
        let basis = Basis::<COUNT>::new();
        let nothing = |_| Sums {
            values: [(); 2].map(|()| vec![[0.0; 3]; COUNT * COUNT]),
            fit_error: 0.0,
        };
        let mut all: Vec<Sums> = parts.iter().map(nothing).collect();
        // The light on the points of each level by the two orders before the one that comes next.
        let mut before = self.first_orders(parts);
        for order in 2..bounces_max {
            let which = order as usize % 2;
            let counted = if order + 1 < bounces_max { 2 } else { 1 };
            let mut tiles = Tiles::default();
            for (part, sums) in parts.iter().zip(&mut all) {
                let (points, from) = (self.points(part.level), &before[part.level][which]);
                let values = part.rows.iter().map(|row| row.apply(points, |i| from[i]));
                let values: Vec<[f64; 3]> = values.collect();
                for sums in &mut sums.values[..counted] {
                    for (sum, value) in sums.iter_mut().zip(&values) {
                        add_scaled(sum, *value, 1.0);
                    }
                }
                let (tile, fit) = basis.fit(part.rectangle, values.into_iter());
                sums.fit_error += fit.error;
                tiles.push(tile.widened(), 0.0);
            }
            for (level, before) in before.iter_mut().enumerate() {
                if !before[which].is_empty() {
                    before[which] = self.on_points(level, &tiles);
                }
            }
        }
        all
    }

    /// The bulb's light and order 1 on the points of each level that parts have; nothing for the others.
    fn first_orders<const COUNT: usize>(
        &self,
        parts: &[Part<COUNT>],
    ) -> [[Vec<[f64; 3]>; 2]; LEVEL_MAX + 1] {
        std::array::from_fn(|level| {
            if parts.iter().all(|part| part.level != level) {
                return Default::default();
            }
            let points = self.points(level);
            [points.direct.clone(), points.order_1.clone()]
        })
    }

    /// What tiles send to the points of a level.
    fn on_points(&self, level: usize, tiles: &Tiles) -> Vec<[f64; 3]> {
        let points = self.points(level).points.iter();
        let values = points.map(|point| tiles.value(self.frame.on_tiles(point.at)));
        values
            .map(|value| value.map(|channel| channel.max(0.0)))
            .collect()
    }
}

impl<const COUNT: usize> Part<COUNT> {
    /// What the series of the first orders leaves out.
    fn left_out(&self) -> f64 {
        self.fit_error.max(self.off_nodes)
    }
}

/// How many evaluations light is worth that misses this many times what it may.
fn evaluations_max(excess: f64) -> u64 {
    (EVALUATIONS_MAX as f64 * (excess / EXCESS_WORTH_ALL).min(1.0)) as u64
}

/// Whether a series with more nodes still leaves out most of what it left out before. For a smooth function it does
/// not: then the rules are not fine enough elsewhere than where they were compared, if they miss anything there.
fn stuck(left_out: f64, before: f64, missed: f64) -> bool {
    left_out > STUCK * before && missed > STUCK_MISSED * left_out
}

/// Points of a part of the chart that lie in no pattern of its nodes, as many in each of the columns that it has
/// parts of.
fn off_nodes(frame: &Frame<'_>, part: &Rectangle) -> Vec<[f64; 2]> {
    let columns = columns(frame).into_iter();
    let columns: Vec<Rectangle> = columns
        .filter_map(|column| part.intersection(&column))
        .collect();
    let mut points = Vec::with_capacity(OFF_NODES);
    for column in &columns {
        points.extend(lattice(column).take(OFF_NODES / columns.len()));
    }
    points
}
