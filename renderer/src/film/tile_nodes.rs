//! The values of a function at a tile's nodes, worked out a row or a column at a time.
//!
//! Most tiles that are too coarse show it on a few lines of their nodes. The first two, a row and a
//! column through the middle, tell along which axis the function is steeper.

/// Terms of the series along each side of a tile.
pub const TERMS: usize = 8;

/// The row and the column that are worked out first.
const MIDDLE: usize = TERMS / 2;

/// The lines that are worked out after them, until one shows that the tile is too coarse: 0 for a row and 1
/// for a column, and which. The outermost come first, because edges that cut a corner off show there.
pub const LINES: [[usize; 2]; 14] = [
    [0, 0],
    [1, TERMS - 1],
    [0, TERMS - 1],
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
];

/// The values at the nodes of a tile, as far as they are known.
pub struct NodeValues {
    /// Where the nodes lie, row by row.
    nodes: Vec<[f64; 2]>,
    values: [[Option<[f64; 3]>; TERMS]; TERMS],
    /// The least of the known nodes' largest channels.
    pub least: f64,
}

impl NodeValues {
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
        [0, 1].map(|axis| self.line([axis, MIDDLE], &mut at))
    }

    /// All values, row by row. What is not known yet `at` tells.
    pub fn all(&mut self, mut at: impl FnMut([f64; 2]) -> [f64; 3]) -> [[[f64; 3]; TERMS]; TERMS] {
        std::array::from_fn(|row| self.line([0, row], &mut at))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_node_is_asked_for_once() {
        let nodes: Vec<[f64; 2]> = (0..TERMS * TERMS).map(|i| [i as f64, 0.0]).collect();
        let mut asked = vec![0; TERMS * TERMS];
        let mut values = NodeValues::unknown(nodes);
        let mut at = |[x, _]: [f64; 2]| {
            asked[x as usize] += 1;
            [x, 1.0, 100.0 - x]
        };
        let [row, column] = values.cross(&mut at);
        assert_eq!(
            row.map(|value| value[0]),
            std::array::from_fn(|i| (32 + i) as f64)
        );
        assert_eq!(
            column.map(|value| value[0]),
            std::array::from_fn(|i| (4 + 8 * i) as f64)
        );
        for line in LINES {
            values.line(line, &mut at);
        }
        assert!(
            values.values.iter().flatten().all(Option::is_some),
            "no line is forgotten"
        );
        let all = values.all(&mut at);
        assert_eq!(all.as_flattened()[37][0], 37.0);
        assert_eq!(values.least, 50.0);
        assert_eq!(asked, vec![1; TERMS * TERMS]);
    }
}
