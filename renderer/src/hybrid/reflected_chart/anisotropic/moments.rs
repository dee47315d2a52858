//! Integrals of a normal density times polynomials, from minus infinity to a point.

use std::f64::consts::{FRAC_1_SQRT_2, PI};
use std::sync::LazyLock;

/// Points at which what multiplies the density is known, and the moments that they take.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Order {
    /// Three points: what multiplies the density is a parabola over it.
    Three,
    /// Five.
    Five,
    /// Seven.
    Seven,
}

/// The most points.
pub const POINTS_MAX: usize = 7;

/// The integrals from minus infinity to z of z^i exp(-z^2/2), i from 0.
pub type Moments = [f64; POINTS_MAX];

/// The zeros of the Hermite polynomials of degree 3, 5 and 7 (of weight exp(-z^2/2)): over the whole
/// density, rules on them are Gauss's.
const NODES_THREE: [f64; 3] = [-1.732_050_807_568_877_2, 0.0, 1.732_050_807_568_877_2];
const NODES_FIVE: [f64; 5] = [
    -2.856_970_013_872_805_6,
    -1.355_626_179_974_266,
    0.0,
    1.355_626_179_974_266,
    2.856_970_013_872_805_6,
];
const NODES_SEVEN: [f64; 7] = [
    -3.750_439_717_725_742_5,
    -2.366_759_410_734_541_5,
    -1.154_405_394_739_968_2,
    0.0,
    1.154_405_394_739_968_2,
    2.366_759_410_734_541_5,
    3.750_439_717_725_742_5,
];

/// The coefficients of the polynomials that are 1 at one node and 0 at the others, node by node.
const LAGRANGE_THREE: [[f64; 3]; 3] = lagrange(NODES_THREE);
const LAGRANGE_FIVE: [[f64; 5]; 5] = lagrange(NODES_FIVE);
const LAGRANGE_SEVEN: [[f64; 7]; 7] = lagrange(NODES_SEVEN);

const fn lagrange<const N: usize>(nodes: [f64; N]) -> [[f64; N]; N] {
    let mut polynomials = [[0.0; N]; N];
    let mut k = 0;
    while k < N {
        let mut polynomial = [0.0; N];
        polynomial[0] = 1.0;
        let (mut j, mut degree) = (0, 0);
        while j < N {
            if j != k {
                let scale = 1.0 / (nodes[k] - nodes[j]);
                degree += 1;
                let mut i = degree;
                while i > 0 {
                    polynomial[i] = scale * (polynomial[i - 1] - nodes[j] * polynomial[i]);
                    i -= 1;
                }
                polynomial[0] *= -scale * nodes[j];
            }
            j += 1;
        }
        polynomials[k] = polynomial;
        k += 1;
    }
    polynomials
}

static INVERSE_DENSITIES: LazyLock<[Vec<f64>; 3]> = LazyLock::new(|| {
    [Order::Three, Order::Five, Order::Seven].map(|order| {
        let inverse = |&z: &f64| libm::exp(0.5 * z * z);
        order.nodes().iter().map(inverse).collect()
    })
});

impl Order {
    /// The points, in widths of the density.
    #[inline(always)]
    pub fn nodes(self) -> &'static [f64] {
        match self {
            Self::Three => &NODES_THREE,
            Self::Five => &NODES_FIVE,
            Self::Seven => &NODES_SEVEN,
        }
    }

    /// The density's inverse at each point.
    #[inline(always)]
    pub fn inverse_densities(self) -> &'static [f64] {
        &INVERSE_DENSITIES[self as usize]
    }

    /// The next larger.
    pub fn finer(self) -> Self {
        match self {
            Self::Three => Self::Five,
            Self::Five | Self::Seven => Self::Seven,
        }
    }

    /// Adds to `weights`, one a node, those of the integral over a piece of moments `moments`.
    #[inline(always)]
    pub fn add_weights(self, weights: &mut [f64; POINTS_MAX], moments: &Moments, factor: f64) {
        match self {
            Self::Three => add(weights, &LAGRANGE_THREE, moments, factor),
            Self::Five => add(weights, &LAGRANGE_FIVE, moments, factor),
            Self::Seven => add(weights, &LAGRANGE_SEVEN, moments, factor),
        }
    }
}

#[inline(always)]
fn add<const N: usize>(
    weights: &mut [f64; POINTS_MAX],
    polynomials: &[[f64; N]; N],
    moments: &Moments,
    factor: f64,
) {
    for (weight, polynomial) in weights.iter_mut().zip(polynomials) {
        let mut sum = 0.0;
        for (coefficient, moment) in polynomial.iter().zip(moments) {
            sum += coefficient * moment;
        }
        *weight += factor * sum;
    }
}

/// Of the empty interval.
pub const NOTHING: Moments = [0.0; POINTS_MAX];

/// Of the whole line: the square root of 2 pi times the moments 1, 0, 1, 0, 3, 0, 15.
pub const EVERYTHING: Moments = {
    const ROOT: f64 = 2.506_628_274_631_000_7;
    [ROOT, 0.0, ROOT, 0.0, 3.0 * ROOT, 0.0, 15.0 * ROOT]
};

/// Up to z, which is told from a table: within 1e-9.
#[inline(always)]
pub fn up_to(z: f64) -> Moments {
    let z = z.clamp(-TABLE_END, TABLE_END);
    let [mass, density] = table(z);
    let mut moments = NOTHING;
    moments[0] = mass;
    moments[1] = -density;
    let mut boundary = density;
    for i in 2..POINTS_MAX {
        boundary *= z;
        moments[i] = (i - 1) as f64 * moments[i - 2] - boundary;
    }
    moments
}

/// Where the table ends on either side: the density is 1e-14 there.
const TABLE_END: f64 = 8.0;

/// Its entries for a unit of z.
const TABLE_STEPS: usize = 128;

/// Its entries: the integral of the density up to z, and the density.
static TABLE: LazyLock<Vec<[f64; 2]>> = LazyLock::new(|| {
    let steps = 2 * TABLE_END as usize * TABLE_STEPS;
    (0..=steps + 1)
        .map(|step| {
            let z = step as f64 / TABLE_STEPS as f64 - TABLE_END;
            let mass = (0.5 * PI).sqrt() * libm::erfc(-FRAC_1_SQRT_2 * z);
            [mass, libm::exp(-0.5 * z * z)]
        })
        .collect()
});

/// The mass and the density at z by cubics through neighbouring entries and their slopes.
#[inline(always)]
fn table(z: f64) -> [f64; 2] {
    const STEP: f64 = 1.0 / TABLE_STEPS as f64;
    let z = z.clamp(-TABLE_END, TABLE_END);
    let position = (z + TABLE_END) * TABLE_STEPS as f64;
    let index = position as usize;
    let x = position - index as f64;
    let entries = &TABLE[index..index + 2];
    let ([mass, density], [next_mass, next_density]) = (entries[0], entries[1]);
    let at = index as f64 * STEP - TABLE_END;
    let hermite = |from: f64, to: f64, slope: f64, next_slope: f64| {
        let rise = to - from;
        let (first, last) = (STEP * slope - rise, rise - STEP * next_slope);
        from + x * (rise + (1.0 - x) * (first * (1.0 - x) + last * x))
    };
    let next = at + STEP;
    [
        hermite(mass, next_mass, density, next_density),
        hermite(density, next_density, -at * density, -next * next_density),
    ]
}

/// One less another.
#[inline(always)]
pub fn between(low: &Moments, high: &Moments) -> Moments {
    std::array::from_fn(|i| high[i] - low[i])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numerics::gauss::GaussRule;

    #[test]
    fn pieces_integrate_every_polynomial_of_the_nodes() {
        for order in [Order::Three, Order::Five, Order::Seven] {
            for (low, high) in [(-2.0, -1.9), (-0.3, 4.0), (1.0, 1.5)] {
                let moments = between(&up_to(low), &up_to(high));
                let mut weights = [0.0; POINTS_MAX];
                order.add_weights(&mut weights, &moments, 2.0);
                for degree in 0..order.nodes().len() as i32 {
                    let function = |z: f64| (0..degree).fold(1.0, |product, _| product * (z - 0.4));
                    let found: f64 = order
                        .nodes()
                        .iter()
                        .zip(weights)
                        .map(|(&z, weight)| weight * function(z))
                        .sum();
                    let expected: f64 = GaussRule::of(40)
                        .on(low, high)
                        .map(|(z, weight)| 2.0 * weight * libm::exp(-0.5 * z * z) * function(z))
                        .sum();
                    assert!(
                        (found - expected).abs() < 1e-7,
                        "{order:?}, {degree}: {found} against {expected}"
                    );
                }
            }
        }
    }

    #[test]
    fn the_ends_are_nothing_and_everything() {
        for (found, expected) in up_to(-40.0).into_iter().zip(NOTHING) {
            assert!((found - expected).abs() < 1e-8);
        }
        for (found, expected) in up_to(40.0).into_iter().zip(EVERYTHING) {
            assert!((found - expected).abs() < 1e-8);
        }
    }

    #[test]
    fn the_table_is_the_density_and_its_mass() {
        for step in 0..200_000 {
            let z = f64::from(step) * 1e-4 - 10.0;
            let [mass, density] = table(z);
            assert!((density - libm::exp(-0.5 * z * z)).abs() < 1e-9, "{z}");
            let expected = (0.5 * PI).sqrt() * libm::erfc(-FRAC_1_SQRT_2 * z);
            assert!((mass - expected).abs() < 1e-9, "{z}");
        }
    }
}
