//! Gauss-Legendre rules of any size, and the Gauss-Kronrod pair of 7 and 15 points.

use crate::numerics::batch::FOUR;
use std::sync::LazyLock;

/// The largest rule.
pub const POINTS_MAX: usize = 64;

/// A Gauss-Legendre rule on [-1, 1].
#[derive(Clone, Debug)]
pub struct GaussRule {
    nodes: Vec<f64>,
    weights: Vec<f64>,
    /// The same by fours, filled up with nodes of 0 and weights of 0.
    fours: Vec<[[f64; FOUR]; 2]>,
}

static RULES: LazyLock<Vec<GaussRule>> =
    LazyLock::new(|| (1..=POINTS_MAX).map(GaussRule::compute).collect());

impl GaussRule {
    /// The rule of `count` points, 1 to [`POINTS_MAX`]; beyond that the largest.
    pub fn of(count: usize) -> &'static Self {
        &RULES[count.clamp(1, POINTS_MAX) - 1]
    }

    /// How many points it has.
    pub fn size(&self) -> usize {
        self.nodes.len()
    }

    /// Nodes and weights moved to [low, high].
    pub fn on(&self, low: f64, high: f64) -> impl Iterator<Item = (f64, f64)> {
        let (middle, half) = (0.5 * (low + high), 0.5 * (high - low));
        self.nodes
            .iter()
            .zip(&self.weights)
            .map(move |(node, weight)| (middle + half * node, half * weight))
    }

    /// The same by fours, with how many of the four there are. The others lie in the middle and weigh
    /// nothing.
    #[inline(always)]
    pub fn fours_on(
        &self,
        low: f64,
        high: f64,
    ) -> impl Iterator<Item = ([f64; FOUR], [f64; FOUR], usize)> {
        let (middle, half) = (0.5 * (low + high), 0.5 * (high - low));
        let count = self.nodes.len();
        self.fours
            .iter()
            .enumerate()
            .map(move |(block, [nodes, weights])| {
                (
                    nodes.map(|node| middle + half * node),
                    weights.map(|weight| half * weight),
                    (count - FOUR * block).min(FOUR),
                )
            })
    }

    /// Newton's iteration on the Legendre polynomial, from the usual asymptotic nodes.
    fn compute(count: usize) -> Self {
        let n = count as f64;
        let mut nodes = vec![0.0; count];
        let mut weights = vec![0.0; count];
        for i in 0..count.div_ceil(2) {
            let mut x = libm::cos(std::f64::consts::PI * (i as f64 + 0.75) / (n + 0.5));
            let mut slope = 1.0;
            for _ in 0..100 {
                let (mut previous, mut value) = (1.0, x);
                for k in 2..=count {
                    let k = k as f64;
                    (previous, value) = (
                        value,
                        ((2.0 * k - 1.0) * x * value - (k - 1.0) * previous) / k,
                    );
                }
                slope = n * (x * value - previous) / (x * x - 1.0);
                let step = value / slope;
                x -= step;
                if step.abs() < 1e-16 {
                    break;
                }
            }
            let weight = 2.0 / ((1.0 - x * x) * slope * slope);
            nodes[i] = -x;
            nodes[count - 1 - i] = x;
            weights[i] = weight;
            weights[count - 1 - i] = weight;
        }
        if count % 2 == 1 {
            nodes[count / 2] = 0.0;
        }
        let four = |values: &[f64], block: usize| {
            std::array::from_fn(|i| values.get(FOUR * block + i).copied().unwrap_or(0.0))
        };
        let fours = (0..count.div_ceil(FOUR))
            .map(|block| [four(&nodes, block), four(&weights, block)])
            .collect();
        Self {
            nodes,
            weights,
            fours,
        }
    }
}

/// A rule of Kronrod on [-1, 1]: nodes, their weights, and those of Gauss's rule among them (0 elsewhere).
pub type Kronrod<const POINTS: usize> = [(f64, f64, f64); POINTS];

/// 15 nodes, of which 7 are Gauss's. Piessens et al., "QUADPACK", 1983.
pub const KRONROD: Kronrod<15> = {
    const HALF: Kronrod<7> = [
        (0.991_455_371_120_812_6, 0.022_935_322_010_529_224, 0.0),
        (
            0.949_107_912_342_758_5,
            0.063_092_092_629_978_56,
            0.129_484_966_168_869_7,
        ),
        (0.864_864_423_359_769_1, 0.104_790_010_322_250_19, 0.0),
        (
            0.741_531_185_599_394_4,
            0.140_653_259_715_525_92,
            0.279_705_391_489_276_7,
        ),
        (0.586_087_235_467_691_1, 0.169_004_726_639_267_9, 0.0),
        (
            0.405_845_151_377_397_2,
            0.190_350_578_064_785_4,
            0.381_830_050_505_118_9,
        ),
        (0.207_784_955_007_898_48, 0.204_432_940_075_298_89, 0.0),
    ];
    symmetric(
        &HALF,
        (0.0, 0.209_482_141_084_727_82, 0.417_959_183_673_469_4),
    )
};

/// 7 nodes, of which 3 are Gauss's. Derived: with the zeros of Stieltjes' polynomial.
pub const KRONROD_SHORT: Kronrod<7> = symmetric(
    &[
        (0.960_491_268_708_020_3, 0.104_656_226_026_467_26, 0.0),
        (0.774_596_669_241_483_4, 0.268_488_089_868_333_44, 5.0 / 9.0),
        (0.434_243_749_346_802_56, 0.401_397_414_775_962_2, 0.0),
    ],
    (0.0, 0.450_916_538_658_474_14, 8.0 / 9.0),
);

/// A rule from its half beyond the middle, from the end inwards, and the middle.
const fn symmetric<const HALF: usize, const POINTS: usize>(
    half: &Kronrod<HALF>,
    middle: (f64, f64, f64),
) -> Kronrod<POINTS> {
    let mut rule = [middle; POINTS];
    let mut i = 0;
    while i < HALF {
        let (node, kronrod, gauss) = half[i];
        rule[i] = (-node, kronrod, gauss);
        rule[POINTS - 1 - i] = (node, kronrod, gauss);
        i += 1;
    }
    rule
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The integral of x^power over [-1, 1].
    fn exact(power: i32) -> f64 {
        if power % 2 == 0 {
            2.0 / f64::from(power + 1)
        } else {
            0.0
        }
    }

    fn power(x: f64, exponent: i32) -> f64 {
        (0..exponent).fold(1.0, |product, _| product * x)
    }

    #[test]
    fn rules_are_exact_for_polynomials_of_twice_their_size() {
        for count in 1..=POINTS_MAX {
            for exponent in [0, 1, 2 * count as i32 - 2, 2 * count as i32 - 1] {
                let sum: f64 = GaussRule::of(count)
                    .on(-1.0, 1.0)
                    .map(|(node, weight)| weight * power(node, exponent))
                    .sum();
                assert!(
                    (sum - exact(exponent)).abs() < 1e-14,
                    "{count}: x^{exponent}"
                );
            }
        }
    }

    #[test]
    fn fours_are_the_same_rule() {
        for count in 1..=POINTS_MAX {
            let rule = GaussRule::of(count);
            let fours = rule.fours_on(0.5, 3.0).flat_map(|(nodes, weights, count)| {
                assert!(weights[count..].iter().all(|&weight| weight == 0.0));
                nodes.into_iter().zip(weights).take(count)
            });
            assert!(fours.eq(rule.on(0.5, 3.0)), "{count}");
        }
    }

    /// The rules of a pair are exact up to these degrees.
    fn exact_up_to<const POINTS: usize>(rule: &Kronrod<POINTS>, kronrod: i32, gauss: i32) {
        for exponent in 0..=kronrod {
            let sum = |weight: fn(&(f64, f64, f64)) -> f64| -> f64 {
                let terms = rule.iter();
                terms
                    .map(|rule| weight(rule) * power(rule.0, exponent))
                    .sum()
            };
            let off = |sum: f64| (sum - exact(exponent)).abs();
            assert!(off(sum(|rule| rule.1)) < 1e-15, "x^{exponent}");
            if exponent <= gauss {
                assert!(off(sum(|rule| rule.2)) < 1e-15, "x^{exponent}");
            }
        }
    }

    #[test]
    fn pairs_are_exact_to_their_degrees() {
        exact_up_to(&KRONROD, 22, 13);
        exact_up_to(&KRONROD_SHORT, 10, 5);
    }
}
