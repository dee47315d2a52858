//! A glance at the orders from 2 on, which may be all that they deserve.

use super::Senders;
use crate::hybrid::budget::interreflection::EVALUATIONS_MAX;
use crate::hybrid::interreflection::matrix::{Planned, rows};
use crate::hybrid::interreflection::tiles::lattice;
use crate::numerics::channels::largest;

/// What was seen of the orders.
pub(super) struct Glance {
    /// More light than there is anywhere on the chart, if that is no more than was allowed.
    pub most: Option<f64>,
    pub evaluations: u64,
}

impl<Order1: Fn([f64; 2]) -> [f64; 3]> Senders<'_, Order1> {
    /// Looks at some points of the chart, by the coarsest rules, until one shows that more light than is `allowed` may
    /// lie between them.
    pub(super) fn glance(&self, allowed: f64) -> Glance {
        let points = self.points(0);
        let by = self.frame.view.budget.glance();
        let lattice = lattice(&self.frame.bounds()).take(by.points);
        let planned: Vec<Planned> = lattice.map(|at| Planned::new(self.frame, at, 0)).collect();
        let mut glance = Glance {
            most: None,
            evaluations: 0,
        };
        let planned_evaluations = planned
            .iter()
            .map(|planned| planned.evaluations(self.cells(0).1));
        if planned_evaluations.sum::<u64>() > EVALUATIONS_MAX {
            return glance;
        }
        let mut most = 0.0f64;
        for planned in planned.chunks(1) {
            for row in rows(self.frame, planned, points) {
                glance.evaluations += row.evaluations;
                most = most.max(by.margin * largest(row.apply(points, |i| points.first(i))));
                if most > allowed || !row.resolved {
                    return glance;
                }
            }
        }
        glance.most = Some(most);
        glance
    }
}
