//! What of the chart may hide between the nodes of a tile.
//!
//! A lobe that is narrow along p and wide along q blurs the chart to a stripe, which may be far thinner than its edges
//! are blurred along q, and lie far from the chart's image in a mirror. In the slope plane it is where it has to be:
//! the chart shows where its slopes, seen from a point of the sample, hold the lobe's middle.

use crate::hybrid::budget::chart_tile_pixels;
use crate::hybrid::budget::glossy::{GROUPS_MAX, HIDDEN_REACH, HIDDEN_WIDTHS};
use crate::reflectance::lobe::Lobe;
use crate::scene::ChartPlane;
use crate::vector::Vec3;

/// The corners of a rectangle of patches.
pub type Corners = [Vec3; 4];

/// Rectangles of patches that may show by themselves: the whole chart, and wherever runs of columns and rows cross that
/// have patches unlike most.
pub fn groups(plane: &ChartPlane, colours: &[[f64; 3]]) -> Vec<Corners> {
    let corners = |[left, right]: [u32; 2], [low, high]: [u32; 2]| {
        [[left, low], [right, low], [right, high], [left, high]].map(|end| {
            let [a, b] = end.map(|count| f64::from(count) * plane.pitch);
            plane.point(a, b)
        })
    };
    let usual = commonest(colours);
    let stands_out = |column, row| Some(&colours[plane.patch(column, row)]) != usual;
    let columns = runs(plane.columns, |column| {
        (0..plane.rows).any(|row| stands_out(column, row))
    });
    let rows = runs(plane.rows, |row| {
        (0..plane.columns).any(|column| stands_out(column, row))
    });
    let mut groups = vec![corners([0, plane.columns], [0, plane.rows])];
    if columns.len() * rows.len() <= GROUPS_MAX {
        let crossings = columns
            .iter()
            .flat_map(|&column| rows.iter().map(move |&row| corners(column, row)));
        groups.extend(crossings);
    }
    groups
}

/// The colour of most patches; of several that are as many, one.
fn commonest(colours: &[[f64; 3]]) -> Option<&[f64; 3]> {
    let mut sorted: Vec<_> = colours.iter().collect();
    sorted.sort_by(|a, b| a.partial_cmp(b).unwrap_or(std::cmp::Ordering::Equal));
    let same = sorted.chunk_by(|a, b| a == b);
    same.max_by_key(|same| same.len()).map(|same| same[0])
}

/// Where neighbours of which `holds` begin and end.
fn runs(count: u32, holds: impl Fn(u32) -> bool) -> Vec<[u32; 2]> {
    let mut runs: Vec<[u32; 2]> = Vec::new();
    for index in (0..count).filter(|&index| holds(index)) {
        match runs.last_mut() {
            Some([_, end]) if *end == index => *end = index + 1,
            _ => runs.push([index, index + 1]),
        }
    }
    runs
}

/// A corner of a tile.
pub struct SeenFrom {
    /// Where in the tile: -1 to 1 along its sides.
    pub at: [f64; 2],
    /// The point of the sample (the world's frame).
    pub position: Vec3,
    /// To the viewer (unit, the world's frame).
    pub wo: Vec3,
}

/// Whether a tile's nodes may all miss one of these groups of patches (the lobe's frame), by what its corners see:
/// the side of the tile along which that moves fastest.
pub fn hides_between(lobe: &Lobe, groups: &[Corners], corners: &[SeenFrom]) -> Option<usize> {
    let corners: Vec<_> = corners
        .iter()
        .map(|seen| (seen.at, lobe.to_lobe(seen.position), lobe.to_lobe(seen.wo)))
        .collect();
    let widths = [lobe.n_u, lobe.n_v].map(|n| (1.0 / n).sqrt());
    groups.iter().find_map(|group| {
        let seen: Vec<_> = corners
            .iter()
            .map(|&(at, position, wo)| Some((at, slopes(group, position, wo)?)))
            .collect::<Option<_>>()?;
        let along = [0, 1].map(|axis| {
            let of_axis = seen.iter().map(|(at, slopes)| (*at, &slopes[axis]));
            along(of_axis, widths[axis])
        });
        if !along.iter().all(|along| along.shows) {
            return None;
        }
        along.iter().find_map(|along| along.thin_along)
    })
}

/// The slopes p, and the slopes q, of a group's corners at a point of the sample; `None` if the sample faces away.
fn slopes(group: &Corners, position: Vec3, wo: Vec3) -> Option<[[f64; 4]; 2]> {
    let halves = group.map(|corner| (corner - position).normalized() + wo);
    let is_front = halves.iter().all(|half| half.z > 0.0);
    is_front.then(|| {
        [
            halves.map(|half| half.x / half.z),
            halves.map(|half| half.y / half.z),
        ]
    })
}

/// How a group of patches lies to the lobe along p or q, over a tile.
struct Along {
    /// Whether it may show.
    shows: bool,
    /// The side of the tile along which it moves fastest, if it may be shorter than what lies between two nodes.
    thin_along: Option<usize>,
}

/// By the slopes of the group's corners at each of the tile's, and by the lobe's width.
fn along<'a>(seen: impl Iterator<Item = ([f64; 2], &'a [f64; 4])>, width: f64) -> Along {
    let [mut all, mut middle, mut across, mut up] = [[f64::INFINITY, f64::NEG_INFINITY]; 4];
    let widen = |range: &mut [f64; 2], value: f64| {
        *range = [range[0].min(value), range[1].max(value)];
    };
    let mut sums = PlaneSums::default();
    for (at, &[a, b, c, d]) in seen {
        for slope in [a, b, c, d] {
            widen(&mut all, slope);
        }
        let mean = 0.25 * (a + b + c + d);
        widen(&mut middle, mean);
        sums.add(at, mean);
        widen(&mut across, 0.5 * (b + c - a - d));
        widen(&mut up, 0.5 * (c + d - a - b));
    }
    // What changes its sign over the tile is nothing somewhere on it.
    let least = |[low, high]: [f64; 2]| low.max(-high).max(0.0);
    let shown = least(across).max(least(up)) + HIDDEN_WIDTHS * width;
    let reach = HIDDEN_REACH * width;
    let is_thin = chart_tile_pixels(shown) < middle[1] - middle[0];
    Along {
        shows: all[0] <= reach && all[1] >= -reach,
        thin_along: is_thin.then(|| sums.steeper()),
    }
}

/// What the plane through values nearest to them is made of.
#[derive(Default)]
struct PlaneSums {
    count: f64,
    at: [f64; 2],
    squares: [f64; 2],
    product: f64,
    value: f64,
    values: [f64; 2],
}

impl PlaneSums {
    fn add(&mut self, at: [f64; 2], value: f64) {
        self.count += 1.0;
        self.value += value;
        self.product += at[0] * at[1];
        for axis in 0..2 {
            self.at[axis] += at[axis];
            self.squares[axis] += at[axis] * at[axis];
            self.values[axis] += at[axis] * value;
        }
    }

    /// The axis along which it rises or falls faster.
    fn steeper(&self) -> usize {
        let per = 1.0 / self.count;
        let spread = [0, 1].map(|axis| self.squares[axis] - per * self.at[axis] * self.at[axis]);
        let product = self.product - per * self.at[0] * self.at[1];
        let moved = [0, 1].map(|axis| self.values[axis] - per * self.at[axis] * self.value);
        // Both times the determinant.
        let across = moved[0] * spread[1] - moved[1] * product;
        let up = moved[1] * spread[0] - moved[0] * product;
        usize::from(up.abs() > across.abs())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plane(columns: u32, rows: u32) -> ChartPlane {
        ChartPlane {
            corner: Vec3::new(0.0, 0.0, 0.0),
            x: Vec3::new(1.0, 0.0, 0.0),
            y: Vec3::new(0.0, 1.0, 0.0),
            z: Vec3::new(0.0, 0.0, 1.0),
            pitch: 2.0,
            columns,
            rows,
        }
    }

    /// The ends of groups in columns and rows of patches.
    fn ends(plane: &ChartPlane, colours: &[[f64; 3]]) -> Vec<[f64; 4]> {
        let groups = groups(plane, colours);
        let ends = groups.iter().map(|[low, _, high, _]| {
            [low.x, low.y, high.x, high.y].map(|metres| metres / plane.pitch)
        });
        ends.collect()
    }

    #[test]
    fn patches_unlike_most_make_groups() {
        let plane = plane(4, 5);
        let mut colours = vec![[0.2, 0.3, 0.4]; 20];
        let whole = [0.0, 0.0, 4.0, 5.0];
        assert_eq!(ends(&plane, &colours), [whole]);
        for [column, row] in [[1, 3], [2, 3], [2, 0]] {
            colours[plane.patch(column, row)] = [1.0; 3];
        }
        let runs = [[1.0, 0.0, 3.0, 1.0], [1.0, 3.0, 3.0, 4.0]];
        assert_eq!(ends(&plane, &colours), [whole, runs[0], runs[1]]);
        let colours: Vec<_> = (0..20).map(|index| [f64::from(index); 3]).collect();
        assert_eq!(ends(&plane, &colours), [whole, whole]);
    }

    #[test]
    fn of_many_groups_only_the_whole_chart_is_looked_at() {
        let plane = plane(64, 64);
        let is_even = |index: u32| index.is_multiple_of(2);
        let speckled = (0..64 * 64).map(|index| is_even(index) && is_even(index / 64));
        let colours: Vec<_> = speckled.map(|lit| [f64::from(u8::from(lit)); 3]).collect();
        assert_eq!(ends(&plane, &colours), [[0.0, 0.0, 64.0, 64.0]]);
    }

    #[test]
    fn a_chart_seen_along_itself_is_thin() {
        let along = |seen: &[[f64; 4]]| {
            let at = [[-1.0, 0.0], [1.0, 0.1]].into_iter();
            along(at.zip(seen), 1e-3)
        };
        // Slopes from -1 to 1 over the tile: half a unit across all of it.
        let wide = [[-1.25, -0.75, -0.75, -1.25], [0.75, 1.25, 1.25, 0.75]];
        assert!(along(&wide).shows && along(&wide).thin_along.is_none());
        // The chart's sides change places from one end of the tile to the other.
        let turned = [[-1.25, -0.75, -0.75, -1.25], [1.25, 0.75, 0.75, 1.25]];
        assert!(along(&turned).shows && along(&turned).thin_along.is_some());
        let beside = [[0.1, 0.2, 0.2, 0.1], [0.3, 0.4, 0.4, 0.3]];
        assert!(!along(&beside).shows);
    }

    #[test]
    fn the_steeper_axis_is_that_of_the_plane() {
        let corners = [[-1.0, -1.0], [1.0, -1.0], [0.7, 1.0], [-1.0, 0.4]];
        for (slopes, steeper) in [
            ([1.0, 0.3], 0),
            ([-0.2, 0.5], 1),
            ([0.4, -0.6], 1),
            ([-2.0, 1.9], 0),
        ] {
            let mut sums = PlaneSums::default();
            for at in corners {
                sums.add(at, 7.0 + slopes[0] * at[0] + slopes[1] * at[1]);
            }
            assert_eq!(sums.steeper(), steeper, "{slopes:?}");
        }
    }
}
