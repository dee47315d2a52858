//! Linear functions on a cell of the film.

/// A linear function on a cell: at its middle, and its rise from side to side.
#[derive(Clone, Copy)]
pub struct Affine {
    /// At the cell's middle.
    pub middle: f64,
    /// From the left to the right.
    pub across: f64,
    /// From above to below.
    pub down: f64,
}

impl Affine {
    /// From the corners: upper left, upper right, lower left, lower right.
    #[inline(always)]
    pub fn through([a, b, c, d]: [f64; 4]) -> Self {
        Self {
            middle: 0.25 * ((a + b) + (c + d)),
            across: 0.5 * ((b - a) + (d - c)),
            down: 0.5 * ((c - a) + (d - b)),
        }
    }

    /// The least.
    #[inline(always)]
    pub fn low(self) -> f64 {
        self.middle - 0.5 * (self.across.abs() + self.down.abs())
    }

    /// The largest.
    #[inline(always)]
    pub fn high(self) -> f64 {
        self.middle + 0.5 * (self.across.abs() + self.down.abs())
    }

    /// The share of the cell on which the function lies between `from` and `from + 1`.
    #[inline(always)]
    pub fn share_of_unit(self, from: f64) -> f64 {
        self.share_below(from + 1.0) - self.share_below(from)
    }

    /// The share of the cell on which the function is below `limit`: all cases are worked out, as
    /// kernels do not branch.
    #[inline(always)]
    fn share_below(self, limit: f64) -> f64 {
        let (x, y) = (self.across.abs(), self.down.abs());
        let (less, more) = if x < y { (x, y) } else { (y, x) };
        let rise = limit - self.low();
        let left = less + more - rise;
        let (at_low, at_high) = (rise < less, rise >= more);
        // A triangle at the low corner, a trapezoid, or all but a triangle at the high corner.
        let side = if at_low { rise } else { left };
        let trapezoid = rise - 0.5 * less;
        let triangle = 0.5 * side * side;
        let in_triangle = at_low | at_high;
        let dividend = if in_triangle { triangle } else { trapezoid };
        let divisor = if in_triangle { less * more } else { more };
        let share = dividend / divisor;
        let share = if at_high { 1.0 - share } else { share };
        let share = if left <= 0.0 { 1.0 } else { share };
        if rise <= 0.0 { 0.0 } else { share }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn shares_are_those_of_a_fine_raster(
            across in -3.0..3.0f64, down in -3.0..3.0f64, from in -3.0..2.0f64,
        ) {
            const STEPS: u32 = 400;
            let position = Affine { middle: 0.0, across, down };
            let step = |i: u32| (f64::from(i) + 0.5) / f64::from(STEPS) - 0.5;
            let inside = (0..STEPS)
                .flat_map(|i| (0..STEPS).map(move |j| across * step(i) + down * step(j)))
                .filter(|at| (from..from + 1.0).contains(at))
                .count();
            let expected = inside as f64 / f64::from(STEPS * STEPS);
            // Of the two edges a cell of the raster may go either way.
            prop_assert!((position.share_of_unit(from) - expected).abs() < 4.0 / f64::from(STEPS));
        }
    }

    #[test]
    fn a_constant_lies_in_one_unit() {
        let position = Affine {
            middle: 0.5,
            across: 0.0,
            down: 0.0,
        };
        assert_eq!(
            [-1.0, 0.0, 1.0].map(|from| position.share_of_unit(from)),
            [0.0, 1.0, 0.0]
        );
    }
}
