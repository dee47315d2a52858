//! Cells and cuts of lines side by side, one a lane.

use crate::numerics::batch::LANES;
use crate::numerics::elementary::ROUND;

/// Numbers side by side, one a line.
pub type Lanes = [f64; LANES];

/// Where lines begin, are cut and end, row by row in ascending order. Behind its last cut a line has its end in every
/// row.
pub type Cuts = Vec<Lanes>;

/// The column or row of a position, of `count` of them; on an edge it is either neighbour's.
#[inline(always)]
pub fn cell(position: f64, count: f64) -> f64 {
    let position = if position > 0.5 { position } else { 0.5 };
    let position = if position < count - 0.5 {
        position
    } else {
        count - 0.5
    };
    let rounded = (position - 0.5 + ROUND) - ROUND;
    // A half is rounded to even.
    if rounded < count - 1.0 {
        rounded
    } else {
        count - 1.0
    }
}

/// The numbers of the patches at positions, in patches from the chart's corner.
#[inline(always)]
pub fn patches(positions: &[Lanes; 2], [columns, rows]: [f64; 2]) -> [usize; LANES] {
    let mut bits = [0; LANES];
    for i in 0..LANES {
        let column = cell(positions[0][i], columns);
        let row = cell(positions[1][i], rows);
        bits[i] = ((rows - 1.0 - row) * columns + column + ROUND).to_bits();
    }
    bits.map(|bits| (bits - ROUND.to_bits()) as usize)
}

/// Up to this many cuts a line, comparing rows in a fixed order beats sorting line by line.
const FEW_CUTS: usize = 24;

/// Sorts every line's cuts.
#[inline(always)]
pub fn sort(cuts: &mut [Lanes]) {
    if cuts.len() > FEW_CUTS {
        let mut line = Vec::with_capacity(cuts.len());
        for i in 0..LANES {
            line.clear();
            line.extend(cuts.iter().map(|row| row[i]));
            line.sort_unstable_by(f64::total_cmp);
            for (row, cut) in cuts.iter_mut().zip(&line) {
                row[i] = *cut;
            }
        }
        return;
    }
    // A fixed order needs no branches.
    for last in 1..cuts.len() {
        // The row is carried down past those that are larger.
        let mut carried = cuts[last];
        for at in (0..last).rev() {
            let low = cuts[at];
            let mut high = [0.0; LANES];
            for i in 0..LANES {
                let (a, b) = (low[i], carried[i]);
                carried[i] = if a < b { a } else { b };
                high[i] = if a < b { b } else { a };
            }
            cuts[at + 1] = high;
        }
        cuts[0] = carried;
    }
}
