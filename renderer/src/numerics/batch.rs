//! Points that a kernel works out together.

/// Points side by side: a multiple of the widest vector's lanes. Sums have this many parts on every
/// instruction set, so that all add in one order.
pub const LANES: usize = 8;

/// Points of a rule that are worked out together: most rules have fewer than [`LANES`].
pub const FOUR: usize = 4;

/// Points of `N` numbers each, number by number, in blocks of [`LANES`].
///
/// What fills the last block up is zeros or what [`Batch::push_of_four`] was given there.
#[derive(Clone, Debug)]
pub struct Batch<const N: usize> {
    /// Each as long as whole blocks. Those beyond `begun` wait to be used again.
    columns: [Vec<f64>; N],
    count: usize,
    /// As many numbers of each column have been written to, or filled with zeros.
    begun: usize,
}

impl<const N: usize> Default for Batch<N> {
    fn default() -> Self {
        Self {
            columns: std::array::from_fn(|_| Vec::new()),
            count: 0,
            begun: 0,
        }
    }
}

impl<const N: usize> Batch<N> {
    /// Takes all points out.
    pub fn clear(&mut self) {
        (self.count, self.begun) = (0, 0);
    }

    /// Adds a point.
    #[inline(always)]
    pub fn push(&mut self, point: [f64; N]) {
        self.make_room(1);
        for (column, value) in self.columns.iter_mut().zip(point) {
            column[self.count] = value;
        }
        self.count += 1;
    }

    /// Adds the first `count` of four points. The others may be read with the last block: they must
    /// be finite and weigh nothing.
    #[inline(always)]
    pub fn push_of_four(&mut self, points: [[f64; FOUR]; N], count: usize) {
        self.make_room(FOUR);
        for (column, values) in self.columns.iter_mut().zip(points) {
            column[self.count..self.count + FOUR].copy_from_slice(&values);
        }
        self.count += count;
    }

    /// Gives a number of all points one value.
    ///
    /// # Panics
    /// When a point has no more than `number` numbers.
    pub fn set(&mut self, number: usize, value: f64) {
        self.columns[number][..self.begun].fill(value);
    }

    /// How many points there are.
    pub fn count(&self) -> usize {
        self.count
    }

    /// A point.
    ///
    /// # Panics
    /// When there are no more than `index`.
    #[inline(always)]
    pub fn point(&self, index: usize) -> [f64; N] {
        self.columns.each_ref().map(|column| column[index])
    }

    /// The points, number by number.
    #[inline(always)]
    pub fn blocks(&self) -> impl ExactSizeIterator<Item = [&[f64; LANES]; N]> {
        let columns = self.columns.each_ref().map(|column| column.as_chunks().0);
        (0..self.count.div_ceil(LANES)).map(move |block| {
            // `map` would be a call for each block, as kernels do not inline it.
            let mut numbers = [&[0.0; LANES]; N];
            for (numbers, column) in numbers.iter_mut().zip(columns) {
                *numbers = &column[block];
            }
            numbers
        })
    }

    #[inline(always)]
    fn make_room(&mut self, points: usize) {
        if self.count + points > self.begun {
            let end = self.begun + LANES;
            for column in &mut self.columns {
                if column.len() < end {
                    column.resize(end, 0.0);
                }
                column[self.begun..][..LANES].fill(0.0);
            }
            self.begun = end;
        }
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
        assert_eq!(batch.blocks().len(), 0);
    }

    #[test]
    fn fours_follow_one_another_without_their_fillers() {
        let mut batch = Batch::<1>::default();
        let mut expected: Vec<f64> = Vec::new();
        for (step, count) in [4, 1, 3, 2, 4, 4, 1].into_iter().enumerate() {
            let first = 10.0 * step as f64;
            let values = std::array::from_fn(|i| first + i as f64);
            batch.push_of_four([values], count);
            expected.extend(&values[..count]);
        }
        let found: Vec<f64> = batch.blocks().flat_map(|[column]| *column).collect();
        assert_eq!(found[..expected.len()], expected);
        assert_eq!(found.len(), 24);
    }
}
