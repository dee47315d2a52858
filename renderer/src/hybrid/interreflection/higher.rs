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
//!
//! Most charts that the sample sends little send next to nothing back. So a glance at a few points comes first: if
//! what they show is far below what may be missed, there are no tiles, and a bound of it is stated.

mod glance;
mod like;

use super::frame::Frame;
use super::levels::{Series, TERMS, compared};
use super::matrix::{Planned, Points, Row, level_cells, rows};
use super::sources::Cell;
use super::tiles::{Tiles, columns, halved, lattice};
use super::unresolved::{Unresolved, unresolved_at_most, unresolved_error};
use crate::hybrid::budget::interreflection::{
    CELLS, EVALUATIONS_MAX, EXCESS_WORTH_ALL, FIRST_EVALUATIONS_MAX, HALVINGS_MAX, LEVEL_MAX,
    OFF_NODES, OFF_NODES_DOUBT, RULE_SHARE, STUCK, STUCK_MISSED, UNRESOLVED_SHARE,
};
use crate::numerics::channels::{add_scaled, largest, largest_difference};
use crate::numerics::chebyshev::Tile;
use crate::numerics::polygon::Rectangle;
use like::PartRules;
use std::cell::OnceCell;

/// Interreflection of all orders from 2 on.
#[derive(Debug)]
pub struct Higher {
    /// For paths of `max_bounces` hits, and of one hit less.
    pub tiles: [Tiles; 2],
    pub evaluations: u64,
    /// By which rules each part of the chart was worked out.
    rules: Vec<PartRules>,
}

/// What sends light, at each level.
struct Senders<'a, Order1> {
    frame: &'a Frame<'a>,
    order_1: Order1,
    levels: [Level; LEVEL_MAX + 2],
}

/// A level's cubature over the chart, made when it is first needed.
#[derive(Default)]
struct Level {
    /// The cells, and how many points they have.
    cells: OnceCell<(Vec<Cell>, usize)>,
    points: OnceCell<Points>,
}

/// All of the chart as one tile.
struct Whole {
    solved: Solved,
    level: usize,
    series: Series,
    evaluations: u64,
}

/// A part of the chart as one tile, before it is worked out.
struct Plan {
    rectangle: Rectangle,
    level: usize,
    series: Series,
    depth: u32,
    at_nodes: Vec<Planned>,
    /// At points off the nodes.
    beside: Vec<Planned>,
    /// By the rules of the next level, at some of the nodes.
    finer: Vec<Planned>,
    /// By those of a level with more points on every cell of the chart, at the points off the nodes.
    finest: Vec<Planned>,
    /// How many it takes at most.
    evaluations: u64,
}

/// A part of the chart as one tile, worked out at a level.
struct Part {
    rectangle: Rectangle,
    level: usize,
    series: Series,
    depth: u32,
    /// What its nodes receive.
    rows: Vec<Row>,
    /// The most light of the first orders at a node.
    largest: f64,
    /// What the rules miss against the next finer ones, at the worst of several points.
    missed: f64,
    /// What the series of the first orders leaves out by its last coefficients, and along either side.
    fit_error: f64,
    tails: [f64; 2],
    /// What it leaves out by points off its nodes.
    off_nodes: f64,
    /// Whether neither more terms nor halving helped.
    stuck: bool,
    evaluations: u64,
    resolved: bool,
}

/// What points beside the nodes of a tile tell of it.
struct Beside {
    /// How far the tile is off at the worst.
    off: f64,
    /// Which receives most.
    brightest: usize,
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
    rules: Vec<PartRules>,
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
        let glance = senders.glance(allowed);
        if let Some(most) = glance.most {
            return Ok(Self::left_out(most, glance.evaluations));
        }
        let Whole {
            mut solved,
            level,
            series,
            mut evaluations,
        } = senders.whole(allowed, glance.evaluations)?;
        let excess = solved.excess(allowed);
        if excess > 1.0 && solved.resolved {
            let columns = columns(frame).into_iter();
            let plans: Vec<_> = columns
                .map(|column| senders.plan(column, series, level, 0))
                .collect();
            if evaluations + all(&plans) <= evaluations_max(excess) {
                let parts = senders.parts(plans, share, &mut evaluations);
                solved = senders.solved(&parts);
            }
        }
        if solved.doubtful(allowed) {
            let error = unresolved_error(solved.largest, solved.missed)?;
            for tiles in &mut solved.tiles {
                tiles.everywhere += error;
            }
        }
        Ok(Self {
            tiles: solved.tiles,
            evaluations,
            rules: solved.rules,
        })
    }

    /// Orders that are nowhere more than this and are stated as an error.
    fn left_out(most: f64, evaluations: u64) -> Self {
        let mut nothing = Self {
            tiles: Default::default(),
            evaluations,
            rules: Vec::new(),
        };
        for tiles in &mut nothing.tiles {
            tiles.everywhere = most;
        }
        nothing
    }
}

impl<Order1: Fn([f64; 2]) -> [f64; 3]> Senders<'_, Order1> {
    fn cells(&self, level: usize) -> &(Vec<Cell>, usize) {
        let cells = &self.levels[level].cells;
        cells.get_or_init(|| level_cells(self.frame, level))
    }

    /// The points of a level.
    fn points(&self, level: usize) -> &Points {
        let (cells, _) = self.cells(level);
        let points = &self.levels[level].points;
        points.get_or_init(|| Points::new(self.frame, (cells, level), &self.order_1))
    }

    /// All of the chart as one tile with as many terms and rules as fine as `allowed` asks for and a limit on
    /// evaluations lets it have, of which some are spent.
    ///
    /// # Errors
    /// When even the coarsest rules take more than [`FIRST_EVALUATIONS_MAX`].
    fn whole(&self, allowed: f64, mut evaluations: u64) -> Result<Whole, Unresolved> {
        let bounds = self.frame.bounds();
        let mut plan = self.plan(bounds, Series::FIRST, 0, 0);
        if plan.evaluations > FIRST_EVALUATIONS_MAX {
            return Err(Unresolved);
        }
        let mut before = f64::INFINITY;
        loop {
            let (level, series) = (plan.level, plan.series);
            let part = self.part(plan);
            evaluations += part.evaluations;
            let solved = self.solved(&[part]);
            let Solved {
                left_out, missed, ..
            } = solved;
            let excess = solved.excess(allowed);
            let rules_fail = missed > RULE_SHARE * allowed || stuck(left_out, before, missed);
            let rough = rules_fail && level < LEVEL_MAX;
            let finer_series = series
                .finer()
                .filter(|_| left_out > (1.0 - RULE_SHARE) * allowed);
            let done = excess <= 1.0 || !solved.resolved || !(rough || finer_series.is_some());
            let whole = Whole {
                solved,
                level,
                series,
                evaluations,
            };
            if done {
                return Ok(whole);
            }
            let next_level = level + usize::from(rough);
            plan = self.plan(bounds, finer_series.unwrap_or(series), next_level, 0);
            if evaluations + plan.evaluations > evaluations_max(excess) {
                return Ok(whole);
            }
            before = if rough { f64::INFINITY } else { left_out };
        }
    }

    /// The chart in tiles. The worst is halved, or gets more terms or finer rules, until none misses more than a
    /// share of its tolerance or the limit on evaluations is reached.
    fn parts(&self, plans: Vec<Plan>, share: f64, evaluations: &mut u64) -> Vec<Part> {
        let mut parts: Vec<Part> = plans.into_iter().map(|plan| self.part(plan)).collect();
        *evaluations += parts.iter().map(|part| part.evaluations).sum::<u64>();
        loop {
            let most = parts.iter().map(|part| part.largest).fold(0.0, f64::max);
            let excesses = parts
                .iter()
                .map(|part| self.excess(part, most, share))
                .enumerate();
            let worst = excesses.max_by(|(_, [a, b]), (_, [c, d])| a.max(*b).total_cmp(&c.max(*d)));
            let Some((worst, excess)) = worst.filter(|(_, [a, b])| a.max(*b) > 1.0) else {
                return parts;
            };
            let [short, rough] = excess;
            let next = self.next(&parts[worst], excess);
            if *evaluations + all(&next) > evaluations_max(short.max(rough)) {
                return parts;
            }
            let part = parts.swap_remove(worst);
            let before = match rough > 1.0 {
                true => f64::INFINITY,
                false => part.left_out(),
            };
            for plan in next {
                let mut part = self.part(plan);
                part.stuck = stuck(part.left_out(), before, part.missed);
                *evaluations += part.evaluations;
                parts.push(part);
            }
        }
    }

    /// What a part's series leaves out and what its rules miss, over what each may: 0 for what cannot be helped.
    /// Rules that do not resolve the most light there is are taken to miss what is stated for them.
    fn excess(&self, part: &Part, most: f64, share: f64) -> [f64; 2] {
        let allowed = share * self.frame.tolerance(&part.rectangle);
        let short = part.left_out() / ((1.0 - RULE_SHARE) * allowed);
        let mut rough = part.missed / (RULE_SHARE * allowed);
        if part.missed > (UNRESOLVED_SHARE * most).max(allowed) {
            rough = rough.max(unresolved_at_most(most, part.missed) / allowed);
        }
        let series_helps =
            !part.stuck && (part.series.finer().is_some() || part.depth < HALVINGS_MAX);
        match (part.level < LEVEL_MAX && part.resolved, series_helps) {
            (true, true) => [short, rough],
            (true, false) => [0.0, short.max(rough)],
            (false, true) => [short, 0.0],
            (false, false) => [0.0; 2],
        }
    }

    /// What is to take a part's place: finer rules, and more terms or both halves, as far as each is called for.
    fn next(&self, part: &Part, [short, rough]: [f64; 2]) -> Vec<Plan> {
        let level = part.level + usize::from(rough > 1.0);
        let plan = |rectangle, series, depth| self.plan(rectangle, series, level, depth);
        match part.series.finer() {
            _ if short <= 1.0 => vec![plan(part.rectangle, part.series, part.depth)],
            Some(finer) => vec![plan(part.rectangle, finer, part.depth)],
            None => {
                let halves = halved(&part.rectangle, part.tails).into_iter();
                halves
                    .map(|half| plan(half, part.series, part.depth + 1))
                    .collect()
            }
        }
    }

    /// A part of the chart as it will be worked out.
    fn plan(&self, rectangle: Rectangle, series: Series, level: usize, depth: u32) -> Plan {
        let frame = self.frame;
        let nodes = series.nodes(&rectangle);
        let off_nodes = off_nodes(frame, &rectangle);
        let planned = |all: &[[f64; 2]], level| -> Vec<Planned> {
            let all = all.iter();
            all.map(|at| Planned::new(frame, *at, level)).collect()
        };
        let (at_nodes, beside) = (planned(&nodes, level), planned(&off_nodes, level));
        let checked = checked(series).map(|node| nodes[node]);
        let finest_level = compared_with(level);
        let finer = planned(&checked, level + 1);
        let finest = planned(&off_nodes, finest_level);
        let evaluations = |planned: &Planned, level| planned.evaluations(self.cells(level).1);
        let here = at_nodes.iter().chain(&beside);
        let here: u64 = here.map(|planned| evaluations(planned, level)).sum();
        let there = finer.iter().map(|planned| evaluations(planned, level + 1));
        // Of the points beside the nodes one is looked at by finer rules. Which, the light will tell.
        let beside_them = finest
            .iter()
            .map(|planned| evaluations(planned, finest_level));
        Plan {
            rectangle,
            level,
            series,
            depth,
            evaluations: here + there.sum::<u64>() + beside_them.max().unwrap_or(0),
            at_nodes,
            beside,
            finer,
            finest,
        }
    }

    /// A part of the chart, worked out.
    fn part(&self, plan: Plan) -> Part {
        let Plan {
            rectangle,
            level,
            series,
            depth,
            at_nodes,
            beside,
            finer,
            finest,
            ..
        } = plan;
        let points = self.points(level);
        let [at_nodes, beside] = [at_nodes, beside].map(|all| rows(self.frame, &all, points));
        let first = |row: &Row| match self.frame.view.bounces_max {
            3 => row.apply(points, |i| points.direct[i]),
            _ => row.apply(points, |i| points.first(i)),
        };
        let lights: Vec<[f64; 3]> = at_nodes.iter().map(first).collect();
        let most = lights.iter().copied().map(largest).fold(0.0, f64::max);
        let (tile, fit) = series.fit(rectangle, lights.into_iter());
        let Beside { off, brightest } = self.beside(&tile, beside.iter().map(first));
        // Far from the column that receives most, all nodes may be dark. At the corners far from the sample rules
        // miss least.
        let off_by = |coarse: &Row, (finer, level): (&Row, usize)| {
            let finer_points = self.points(level);
            let coarse = coarse.apply(points, |i| points.first(i));
            let finer = finer.apply(finer_points, |i| finer_points.first(i));
            largest_difference(coarse, finer)
        };
        let (finer_level, finest_level) = (level + 1, compared_with(level));
        let finer = rows(self.frame, &finer, self.points(finer_level));
        let at_checked = checked(series).into_iter().zip(&finer);
        let at_checked =
            at_checked.map(|(node, finer)| off_by(&at_nodes[node], (finer, finer_level)));
        let finest = &finest[brightest..=brightest];
        let finest = rows(self.frame, finest, self.points(finest_level));
        let off_nodes = finest.iter();
        let off_nodes = off_nodes.map(|finest| off_by(&beside[brightest], (finest, finest_level)));
        let finer = || finer.iter().chain(&finest);
        let spent = at_nodes.iter().chain(&beside).chain(finer());
        Part {
            rectangle,
            level,
            series,
            depth,
            evaluations: spent.map(|row| row.evaluations).sum(),
            largest: most,
            missed: at_checked.chain(off_nodes).fold(0.0, f64::max),
            fit_error: fit.error,
            tails: fit.tails,
            off_nodes: OFF_NODES_DOUBT * off,
            stuck: false,
            resolved: finer().all(|row| row.resolved),
            rows: at_nodes,
        }
    }

    /// What the light at points off the nodes of a tile tells of it.
    fn beside(&self, tile: &Tile<TERMS>, lights: impl Iterator<Item = [f64; 3]>) -> Beside {
        let mut found = Beside {
            off: 0.0,
            brightest: 0,
        };
        let mut most = 0.0;
        let points = off_nodes(self.frame, &tile.rectangle);
        for (index, (at, light)) in points.into_iter().zip(lights).enumerate() {
            found.off = found.off.max(largest_difference(light, tile.value(at)));
            if largest(light) > most {
                (most, found.brightest) = (largest(light), index);
            }
        }
        found
    }

    /// All orders on parts that make up the chart.
    fn solved(&self, parts: &[Part]) -> Solved {
        let mut solved = Solved {
            tiles: Default::default(),
            rules: parts.iter().map(Part::rules).collect(),
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
                let (tile, _) = part.series.fit(part.rectangle, values.into_iter());
                tiles.push(tile, left_out + part.missed);
            }
        }
        solved
    }

    /// The orders from 2 on at the nodes of each part.
    fn sums(&self, parts: &[Part]) -> Vec<Sums> {
        let bounces_max = self.frame.view.bounces_max;
        let nothing = |part: &Part| Sums {
            values: [(); 2].map(|()| vec![[0.0; 3]; part.rows.len()]),
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
                let (tile, fit) = part.series.fit(part.rectangle, values.into_iter());
                sums.fit_error += fit.error;
                tiles.push(tile, 0.0);
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
    fn first_orders(&self, parts: &[Part]) -> [[Vec<[f64; 3]>; 2]; LEVEL_MAX + 1] {
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

impl Solved {
    /// Whether the rules do not resolve the light: they have too few points for the lobe, or the next finer ones
    /// move it by a large share.
    fn doubtful(&self, allowed: f64) -> bool {
        !self.resolved || self.missed > (UNRESOLVED_SHARE * self.largest).max(allowed)
    }

    /// What is stated, over what is allowed.
    fn excess(&self, allowed: f64) -> f64 {
        let doubt = match self.doubtful(allowed) {
            true => unresolved_at_most(self.largest, self.missed),
            false => 0.0,
        };
        (self.left_out + self.missed + doubt) / allowed
    }
}

impl Part {
    /// What the series of the first orders leaves out.
    fn left_out(&self) -> f64 {
        self.fit_error.max(self.off_nodes)
    }
}

/// The nodes of a series at which rules are compared with finer ones.
fn checked(series: Series) -> [usize; 3] {
    let [left, right, .., middle] = compared(series.terms());
    [left, right, middle]
}

/// The next level that has more points on every cell of the chart, however small the cells are: those of one that has
/// as many may be the same points.
fn compared_with(level: usize) -> usize {
    let (_, points) = CELLS[level];
    let mut finer = level + 1;
    while CELLS[finer].1 == points {
        finer += 1;
    }
    finer
}

/// What plans take in all.
fn all(plans: &[Plan]) -> u64 {
    plans.iter().map(|plan| plan.evaluations).sum()
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
