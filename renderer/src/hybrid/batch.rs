//! Points that a kernel works out together.

/// Points side by side: a multiple of the widest vector's lanes. Sums run in so many parts on every
/// instruction set, so that all add in one order.
pub const LANES: usize = 8;

/// Points of `N` numbers each, in blocks of [`LANES`]. The last block is filled up with zeros.
#[derive(Clone, Debug, Default)]
pub struct Batch<const N: usize> {
    blocks: Vec<[[f64; LANES]; N]>,
    count: usize,
}

impl<const N: usize> Batch<N> {
    /// Takes all points out.
    pub fn clear(&mut self) {
        self.blocks.clear();
        self.count = 0;
    }

    /// Adds a point.
    pub fn push(&mut self, point: [f64; N]) {
        let lane = self.count % LANES;
        if lane == 0 {
            self.blocks.push([[0.0; LANES]; N]);
        }
        if let Some(block) = self.blocks.last_mut() {
            for (column, value) in block.iter_mut().zip(point) {
                column[lane] = value;
            }
        }
        self.count += 1;
    }

    /// How many points there are.
    pub fn count(&self) -> usize {
        self.count
    }

    /// The points, number by number.
    pub fn blocks(&self) -> &[[[f64; LANES]; N]] {
        &self.blocks
    }
}

/// The sum of the lanes.
pub fn total([s0, s1, s2, s3, s4, s5, s6, s7]: [f64; LANES]) -> f64 {
    ((s0 + s1) + (s2 + s3)) + ((s4 + s5) + (s6 + s7))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blocks_hold_every_point_once_and_zeros_after_them() {
        let mut batch = Batch::<2>::default();
        for count in 0..30u32 {
            let mut sums = [[0.0; LANES]; 2];
            for block in batch.blocks() {
                for (sum, column) in sums.iter_mut().zip(block) {
                    for lane in 0..LANES {
                        sum[lane] += column[lane];
                    }
                }
            }
            let n = f64::from(count);
            assert_eq!(sums.map(total), [0.5 * n * (n - 1.0), n]);
            assert_eq!(batch.count(), count as usize);
            batch.push([n, 1.0]);
        }
        batch.clear();
        assert!(batch.blocks().is_empty());
    }
}
