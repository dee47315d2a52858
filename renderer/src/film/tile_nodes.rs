//! The values of a function at a tile's nodes, worked out a row or a column at a time.
//!
//! Most tiles that are too coarse show it on a few lines of their nodes. The first two, a row and a
//! column through the middle, tell along which axis the function is steeper.

/// Terms of the series along each side of a tile.
pub const MANY: usize = 8;

/// The same where little is asked for: see [`super::demand::Terms`].
pub const FEW: usize = 5;

/// The same on a part of one pixel for which [`MANY`] or [`FEW`] do not do.
pub const FINER: usize = 12;

/// What follows from where the nodes of a tile lie. Coordinates go from -1 to 1 along each side.
pub struct Layout {
    /// The lines that are worked out after the row and the column through the middle, until one shows that the tile is
    /// too coarse: 0 for a row and 1 for a column, and which. The outermost come first, because edges that cut a corner
    /// off show there.
    pub lines: &'static [[usize; 2]],
    /// No two nodes along a side lie farther apart than this share of it.
    pub widest_gap: f64,
    /// Points between the lines of nodes.
    pub between: [[f64; 2]; 4],
    /// Points on the sides, between the corners and the lines of nodes.
    pub on_sides: [[f64; 2]; 4],
}

const OF_MANY: Layout = Layout {
    lines: &[
        [0, 0],
        [1, 7],
        [0, 7],
        [1, 0],
        [0, 2],
        [1, 5],
        [0, 5],
        [1, 2],
        [0, 1],
        [1, 6],
        [0, 6],
        [1, 1],
        [0, 3],
        [1, 3],
    ],
    widest_gap: 0.196,
    between: [[0.38, -0.71], [-0.71, -0.38], [-0.38, 0.71], [0.71, 0.38]],
    on_sides: [[-0.29, -1.0], [1.0, -0.29], [0.29, 1.0], [-1.0, 0.29]],
};

const OF_FEW: Layout = Layout {
    lines: &[
        [0, 0],
        [1, 4],
        [0, 4],
        [1, 0],
        [0, 1],
        [1, 3],
        [0, 3],
        [1, 1],
    ],
    widest_gap: 0.295,
    between: [[0.29, -0.79], [-0.79, -0.29], [-0.29, 0.79], [0.79, 0.29]],
    on_sides: [[-0.43, -1.0], [1.0, -0.43], [0.43, 1.0], [-1.0, 0.43]],
};

const OF_FINER: Layout = Layout {
    lines: &[
        [0, 0],
        [1, 11],
        [0, 11],
        [1, 0],
        [0, 3],
        [1, 8],
        [0, 8],
        [1, 3],
        [0, 1],
        [1, 10],
        [0, 10],
        [1, 1],
        [0, 2],
        [1, 9],
        [0, 9],
        [1, 2],
        [0, 4],
        [1, 7],
        [0, 7],
        [1, 4],
        [0, 5],
        [1, 5],
    ],
    widest_gap: 0.131,
    between: [[0.26, -0.7], [-0.7, -0.26], [-0.26, 0.7], [0.7, 0.26]],
    on_sides: [[-0.19, -1.0], [1.0, -0.19], [0.19, 1.0], [-1.0, 0.19]],
};

/// That of a tile with so many terms along each side.
pub const fn layout(terms: usize) -> &'static Layout {
    match terms {
        FEW => &OF_FEW,
        FINER => &OF_FINER,
        _ => &OF_MANY,
    }
}

/// The values at the nodes of a tile, as far as they are known.
pub struct NodeValues<const TERMS: usize> {
    /// Where the nodes lie, row by row.
    nodes: Vec<[f64; 2]>,
    values: [[Option<[f64; 3]>; TERMS]; TERMS],
    /// The least of the known nodes' largest channels.
    pub least: f64,
}

impl<const TERMS: usize> NodeValues<TERMS> {
    /// Of these nodes none is known.
    pub fn unknown(nodes: Vec<[f64; 2]>) -> Self {
        Self {
            nodes,
            values: [[None; TERMS]; TERMS],
            least: f64::INFINITY,
        }
    }

    /// Forgets all values.
    pub fn forget(&mut self) {
        (self.values, self.least) = ([[None; TERMS]; TERMS], f64::INFINITY);
    }

    /// The values on a row (axis 0) or a column (axis 1) of nodes. What is not known yet `at` tells.
    pub fn line(
        &mut self,
        [axis, index]: [usize; 2],
        mut at: impl FnMut([f64; 2]) -> [f64; 3],
    ) -> [[f64; 3]; TERMS] {
        std::array::from_fn(|k| {
            let [row, column] = if axis == 0 { [index, k] } else { [k, index] };
            let known = self.values[row][column];
            let value = known.unwrap_or_else(|| at(self.nodes[row * TERMS + column]));
            self.values[row][column] = Some(value);
            self.least = self.least.min(value[0].max(value[1]).max(value[2]));
            value
        })
    }

    /// The row and the column through the middle.
    pub fn cross(&mut self, mut at: impl FnMut([f64; 2]) -> [f64; 3]) -> [[[f64; 3]; TERMS]; 2] {
        [0, 1].map(|axis| self.line([axis, TERMS / 2], &mut at))
    }

    /// All values, row by row. What is not known yet `at` tells.
    pub fn all(&mut self, mut at: impl FnMut([f64; 2]) -> [f64; 3]) -> [[[f64; 3]; TERMS]; TERMS] {
        std::array::from_fn(|row| self.line([0, row], &mut at))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numerics::chebyshev::Nodes;

    fn ask_for_every_node<const TERMS: usize>() {
        let nodes: Vec<[f64; 2]> = (0..TERMS * TERMS).map(|i| [i as f64, 0.0]).collect();
        let last = (TERMS * TERMS - 1) as f64;
        let mut asked = vec![0; TERMS * TERMS];
        let mut values = NodeValues::<TERMS>::unknown(nodes);
        let mut at = |[x, _]: [f64; 2]| {
            asked[x as usize] += 1;
            [x, 1.0, 2.0 * last - x]
        };
        let [row, column] = values.cross(&mut at);
        let middle = TERMS / 2;
        assert_eq!(
            row.map(|value| value[0] as usize),
            std::array::from_fn(|i| middle * TERMS + i)
        );
        assert_eq!(
            column.map(|value| value[0] as usize),
            std::array::from_fn(|i| middle + i * TERMS)
        );
        for line in layout(TERMS).lines {
            values.line(*line, &mut at);
        }
        assert!(
            values.values.iter().flatten().all(Option::is_some),
            "no line is forgotten"
        );
        let all = values.all(&mut at);
        assert_eq!(all.as_flattened()[17][0], 17.0);
        assert_eq!(values.least, last);
        assert_eq!(asked, vec![1; TERMS * TERMS]);
    }

    #[test]
    fn every_node_is_asked_for_once() {
        ask_for_every_node::<MANY>();
        ask_for_every_node::<FEW>();
        ask_for_every_node::<FINER>();
    }

    /// Points that are looked at lie on no line of nodes, and no gap is wider than is said.
    fn look_between<const TERMS: usize>() {
        let nodes = Nodes::<TERMS>::new().points;
        let Layout {
            widest_gap,
            between,
            on_sides,
            ..
        } = layout(TERMS);
        let gaps = nodes.windows(2).map(|pair| 0.5 * (pair[0] - pair[1]));
        let widest = gaps.fold(0.0, f64::max);
        assert!(widest <= *widest_gap && *widest_gap < 1.01 * widest);
        for at in between.iter().chain(on_sides).flatten() {
            let nearest = nodes.map(|node| (node - at).abs());
            let nearest = nearest.into_iter().fold(f64::INFINITY, f64::min);
            assert!(nearest > 0.25 * widest || at.abs() == 1.0, "{at}");
        }
    }

    #[test]
    fn points_lie_between_nodes() {
        look_between::<MANY>();
        look_between::<FEW>();
        look_between::<FINER>();
    }
}
