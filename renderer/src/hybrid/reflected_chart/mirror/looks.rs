//! Looks at what the light is off by where edges show.

use super::blur::Edge;
use super::pixel::Pixel;
use std::collections::BTreeMap;

/// What is looked at: a stretch of an edge, by the axis that it crosses, its number along that, and the patch beside it
/// along the other; or a pixel on which edges along both axes show.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Place {
    Stretch(usize, u32, u32),
    Corner(u32, u32),
}

/// What the light at points of a place is off by.
#[derive(Clone, Copy, Debug, Default)]
pub struct Off {
    /// At a point, at most.
    most: f64,
    /// Integrated over that part of a line across a narrow edge over which it is off most, in units of the edge's blur.
    across: f64,
}

impl Off {
    /// By channel at points of an edge or a corner.
    pub fn at_points(off: &[[f64; 3]]) -> Self {
        Self {
            most: largest(off),
            across: f64::INFINITY,
        }
    }

    /// By channel at the points across a narrow edge ([`Edge::across`]).
    pub fn across(off: &[[f64; 3]]) -> Self {
        let range = |channel: usize| {
            let (mut sum, mut low, mut high) = (0.0f64, 0.0f64, 0.0f64);
            for off in off {
                sum += off[channel];
                (low, high) = (low.min(sum), high.max(sum));
            }
            high - low
        };
        Self {
            most: largest(off),
            across: range(0).max(range(1)).max(range(2)),
        }
    }
}

/// The largest of any channel.
fn largest(off: &[[f64; 3]]) -> f64 {
    let channels = off.as_flattened().iter();
    channels.fold(0.0, |most, off| most.max(off.abs()))
}

/// What places are off by, at most.
#[derive(Default)]
pub struct Looks(BTreeMap<Place, Off>);

impl Looks {
    pub fn add(&mut self, place: Place, found: Off) {
        let off = self.0.entry(place).or_default();
        off.most = off.most.max(found.most);
        off.across = off.across.max(found.across);
    }

    /// What the mean over a pixel is off by, of which the edges lie on such stretches and reach so many blurs. `None`
    /// if one of them was not looked at.
    pub fn off(&self, pixel: &Pixel, stretches: &[Place], reach: f64) -> Option<f64> {
        let edges = pixel.along.iter().flat_map(|along| &along.edges);
        if pixel.has_corners() {
            let share: f64 = edges.map(|edge| share_at(edge, reach)).sum();
            // Beyond the corner its edges are off as elsewhere.
            let beyond = stretches.iter().filter_map(|stretch| self.0.get(stretch));
            let corner = self.0.get(&Place::Corner(pixel.at.0, pixel.at.1))?;
            let most = beyond.fold(corner.most, |most, off| most.max(off.most));
            return Some(share.min(1.0) * most);
        }
        let (mut most, mut sum) = (0.0f64, 0.0);
        for (edge, stretch) in edges.zip(stretches) {
            let off = self.0.get(stretch)?;
            sum += (share_at(edge, reach) * off.most).min(edge.length_max() * off.across);
            most = most.max(off.most);
        }
        Some(sum.min(most))
    }
}

/// The share of a pixel on which an edge shows that reaches so many blurs, at most.
fn share_at(edge: &Edge, reach: f64) -> f64 {
    (2.0 * reach * edge.length_max()).min(1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_off_to_either_side_cancels_only_over_the_whole_edge() {
        let off = [-1.0, -3.0, -1.0, 0.0, 1.0, 3.0, 1.0].map(|off| [0.0, 1e-3 * off, 0.0]);
        let Off { most, across } = Off::across(&off);
        assert!(
            (most - 3e-3).abs() < 1e-15 && (across - 5e-3).abs() < 1e-15,
            "{across}"
        );
        let one_sided = off.map(|off| off.map(f64::abs));
        assert!((Off::across(&one_sided).across - 1e-2).abs() < 1e-15);
    }
}
