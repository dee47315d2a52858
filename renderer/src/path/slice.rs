//! A density on an interval, about its point nearest to 0.

/// A density on an interval, (1 + (k (x - x0))^2)^(-3/2) up to a factor, x0 its point nearest to 0:
/// Student's t with two degrees of freedom, whose integral is algebraic. It is as wide as the slice
/// of the lobe that it stands for and has heavier tails, so no sample weighs much.
#[derive(Clone, Copy, Debug)]
pub struct Slice {
    /// The point nearest to 0.
    pub nearest: f64,
    k: f64,
    /// The integrals to the left and to the right of `nearest`.
    left: f64,
    right: f64,
}

impl Slice {
    /// On `interval`, for a slice exp(-n x^2 / (2 (1 + t))). About the slice's top, and on its
    /// slopes, where it falls exponentially, these k leave the least variance: 0.08 and 0.07.
    pub fn new(interval: [f64; 2], n: f64, t: f64) -> Self {
        let nearest = nearest_to_zero(interval);
        let n = n / (1.0 + t);
        let k = (0.95 * n.sqrt()).max(0.7 * n * nearest.abs());
        let integral = |length: f64| length / (1.0 + k * k * length * length).sqrt();
        Self {
            nearest,
            k,
            left: integral(nearest - interval[0]),
            right: integral(interval[1] - nearest),
        }
    }

    /// At a point of the interval.
    pub fn density(&self, x: f64) -> f64 {
        let offset = self.k * (x - self.nearest);
        let scale2 = 1.0 + offset * offset;
        1.0 / (scale2 * scale2.sqrt() * (self.left + self.right))
    }

    /// A point of the interval and its density, from a number in 0 to 1.
    pub fn sample(&self, uniform: f64) -> (f64, f64) {
        let total = self.left + self.right;
        let integral = uniform * total - self.left;
        // Positive but for rounding, far out on an interval that is long beside 1/k.
        let rest = (1.0 - self.k * self.k * integral * integral).max(f64::EPSILON);
        let scale = 1.0 / rest.sqrt();
        let offset = integral * scale;
        (self.nearest + offset, 1.0 / (scale * scale * scale * total))
    }
}

/// The point of an interval that is nearest to 0.
pub fn nearest_to_zero([low, high]: [f64; 2]) -> f64 {
    0f64.max(low).min(high)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// An interval anywhere about a slice, from far shorter than it to far longer, and the slice's n and t.
    fn drawn() -> impl Strategy<Value = ([f64; 2], f64, f64)> {
        let numbers = (-4.0..4.0f64, -8.0..2.0f64, 0.0..9.0f64, -3.0..3.0f64);
        numbers.prop_map(|(at, length, n, t)| {
            let n = libm::exp10(n);
            // In widths of the slice.
            let [low, length] = [at * at * at, libm::exp10(length)].map(|number| number / n.sqrt());
            ([low, low + length], n, libm::exp10(t))
        })
    }

    proptest! {
        #[test]
        fn samples_lie_in_the_interval_and_know_their_density(
            (interval, n, t) in drawn(), uniform in 0.0..1.0f64
        ) {
            let slice = Slice::new(interval, n, t);
            let (x, density) = slice.sample(uniform);
            let [low, high] = interval;
            let rounding = 1e-9 * (high - low);
            prop_assert!(low - rounding <= x && x <= high + rounding, "{x} in {interval:?}");
            let expected = slice.density(x);
            prop_assert!((density / expected - 1.0).abs() < 1e-6, "{density} {expected}");
        }

        /// As many samples lie below a point as the density has below it.
        #[test]
        fn samples_are_spread_as_the_density_says(
            (interval, n, t) in drawn(), uniforms in prop::array::uniform2(0.0..1.0f64)
        ) {
            let slice = Slice::new(interval, n, t);
            let [from, to] = uniforms.map(|uniform| slice.sample(uniform).0);
            // Gauss's two points on each of many parts, evenly spread in what the density is about flat in.
            let [from_flat, to_flat] = [from, to].map(|x| libm::asinh(slice.k * (x - slice.nearest)));
            let parts = 4000;
            let step = (to_flat - from_flat) / f64::from(parts);
            let mut sum = 0.0;
            for part in 0..parts {
                for off in [0.5 - 0.5 / 3f64.sqrt(), 0.5 + 0.5 / 3f64.sqrt()] {
                    let flat = from_flat + step * (f64::from(part) + off);
                    let x = slice.nearest + libm::sinh(flat) / slice.k;
                    sum += 0.5 * step * slice.density(x) * libm::cosh(flat) / slice.k;
                }
            }
            let expected = uniforms[1] - uniforms[0];
            prop_assert!((sum - expected).abs() < 1e-6, "{sum} {expected}");
        }
    }

    #[test]
    fn the_point_nearest_to_0() {
        for ([low, high], expected) in [
            ([-2.0, -1.0], -1.0),
            ([-1.0, 2.0], 0.0),
            ([1.0, 2.0], 1.0),
            ([0.0, 0.0], 0.0),
        ] {
            assert_eq!(nearest_to_zero([low, high]), expected);
        }
    }
}
