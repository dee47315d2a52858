//! Orders from 2 on by the rules of a material beside this one.

use super::{Higher, Part, Senders};
use crate::hybrid::interreflection::frame::Frame;
use crate::hybrid::interreflection::levels::Series;
use crate::hybrid::interreflection::matrix::{Planned, rows};
use crate::numerics::polygon::Rectangle;

/// By which rules a part of the chart was worked out, and what they and its series leave out.
#[derive(Clone, Copy, Debug)]
pub(super) struct PartRules {
    rectangle: Rectangle,
    level: usize,
    series: Series,
    missed: f64,
    off_nodes: f64,
}

impl Higher {
    /// The orders on the parts of the chart that another was worked out on and by its rules, which miss as much
    /// here as they do there.
    pub fn solve_like(
        frame: &Frame<'_>,
        like: &Self,
        order_1: impl Fn([f64; 2]) -> [f64; 3],
    ) -> Self {
        let senders = Senders {
            frame,
            order_1,
            levels: Default::default(),
        };
        let parts = like.rules.iter().map(|rules| senders.part_like(rules));
        let parts: Vec<Part> = parts.collect();
        let mut tiles = senders.solved(&parts).tiles;
        for (tiles, like) in tiles.iter_mut().zip(&like.tiles) {
            tiles.everywhere = like.everywhere;
        }
        Self {
            tiles,
            evaluations: parts.iter().map(|part| part.evaluations).sum(),
            rules: like.rules.clone(),
        }
    }
}

impl<Order1: Fn([f64; 2]) -> [f64; 3]> Senders<'_, Order1> {
    /// A part of the chart, worked out by these rules.
    fn part_like(&self, rules: &PartRules) -> Part {
        let PartRules {
            rectangle,
            level,
            series,
            missed,
            off_nodes,
        } = *rules;
        let nodes = series.nodes(&rectangle).into_iter();
        let nodes: Vec<Planned> = nodes
            .map(|at| Planned::new(self.frame, at, level))
            .collect();
        let rows = rows(self.frame, &nodes, self.points(level));
        Part {
            rectangle,
            level,
            series,
            depth: 0,
            evaluations: rows.iter().map(|row| row.evaluations).sum(),
            largest: 0.0,
            missed,
            fit_error: 0.0,
            tails: [0.0; 2],
            off_nodes,
            stuck: false,
            resolved: true,
            rows,
        }
    }
}

impl Part {
    pub(super) fn rules(&self) -> PartRules {
        PartRules {
            rectangle: self.rectangle,
            level: self.level,
            series: self.series,
            missed: self.missed,
            off_nodes: self.off_nodes,
        }
    }
}
