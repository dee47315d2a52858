//! An interval of a line, and the integral of a function over it by one of two rules.

use crate::numerics::channels::{add_scaled, largest_difference};
use crate::numerics::gauss::{KRONROD, KRONROD_SHORT, Kronrod};

/// A step may lie anywhere between two points; this times its height and their distance is stated.
/// Chosen: with the half of the height that [`step`] leaves out it is a quarter of both.
const STEP: f64 = 0.5;

/// By how many points an interval is integrated.
#[derive(Clone, Copy)]
pub enum Rule {
    /// By 7.
    Short,
    /// By 15.
    Full,
}

/// An interval, the values at its ends, and how often it was halved to be one.
#[derive(Clone, Copy)]
pub struct Interval {
    pub low: f64,
    pub high: f64,
    pub ends: [[f64; 3]; 2],
    pub depth: u32,
    pub rule: Rule,
}

/// The integral over an interval.
pub struct Integral {
    pub value: [f64; 3],
    /// What it may be off by.
    pub missed: f64,
    /// The function in the middle of the interval.
    middle: [f64; 3],
}

impl Rule {
    pub const fn points(self) -> u64 {
        let points = match self {
            Self::Short => KRONROD_SHORT.len(),
            Self::Full => KRONROD.len(),
        };
        points as u64
    }
}

impl Interval {
    /// The integral of `function`, which is told its argument and the weight that it has.
    pub fn integral(&self, function: impl FnMut(f64, f64) -> [f64; 3]) -> Integral {
        match self.rule {
            Rule::Short => self.by(&KRONROD_SHORT, function),
            Rule::Full => self.by(&KRONROD, function),
        }
    }

    fn by<const POINTS: usize>(
        &self,
        rule: &Kronrod<POINTS>,
        mut function: impl FnMut(f64, f64) -> [f64; 3],
    ) -> Integral {
        let (middle, half) = (0.5 * (self.low + self.high), 0.5 * (self.high - self.low));
        let values = rule.map(|(node, weight, _)| function(middle + half * node, half * weight));
        let (value, missed) = integral(rule, &values, self.ends, half);
        Integral {
            value,
            missed,
            middle: values[POINTS / 2],
        }
    }

    /// How many points the finer intervals take.
    pub fn points_of_finer(&self) -> u64 {
        match self.rule {
            Rule::Short => Rule::Full.points(),
            Rule::Full => 2 * Rule::Full.points(),
        }
    }

    /// What takes its place where this integral misses too much: itself by more points, or its halves.
    pub fn finer(&self, integral: &Integral) -> impl Iterator<Item = Self> + use<> {
        let [first, last] = self.ends;
        let (middle, rule) = (0.5 * (self.low + self.high), Rule::Full);
        let finer = match self.rule {
            Rule::Short => [Some(Self { rule, ..*self }), None],
            Rule::Full => [
                (self.low, middle, [first, integral.middle]),
                (middle, self.high, [integral.middle, last]),
            ]
            .map(|(low, high, ends)| {
                let depth = self.depth + 1;
                Some(Self {
                    low,
                    high,
                    ends,
                    depth,
                    rule,
                })
            }),
        };
        finer.into_iter().flatten()
    }
}

/// The integral over an interval of this half length, and what it may miss: what three null rules show or what a step
/// leaves open, and what the values at the ends tell of features between them and the outermost points.
///
/// The difference of 15 and 7 points is a null rule: it gives 0 for polynomials of degree 13 and less. With a kink at
/// one of a dozen places it gives 0, too, and the 15 points are off. Times Chebyshev's polynomials of the second kind
/// in the position, 2 x and 4 x^2 - 1, it gives two more null rules, for degree 12 and less and for degree 11 and
/// less. They show a kink where the first does not.
fn integral<const POINTS: usize>(
    rule: &Kronrod<POINTS>,
    values: &[[f64; 3]; POINTS],
    ends: [[f64; 3]; 2],
    half: f64,
) -> ([f64; 3], f64) {
    let [mut fine, mut first, mut second, mut third] = [[0.0; 3]; 4];
    for (value, &(node, kronrod, gauss)) in values.iter().zip(rule) {
        let null = half * (kronrod - gauss);
        add_scaled(&mut fine, *value, half * kronrod);
        add_scaled(&mut first, *value, null);
        add_scaled(&mut second, *value, 2.0 * node * null);
        add_scaled(&mut third, *value, (4.0 * node * node - 1.0) * null);
    }
    let shown = |channel: usize| {
        let rules = [first, second, third].map(|rule| rule[channel]);
        rules.into_iter().map(|shown| shown * shown).sum::<f64>()
    };
    let shown = shown(0).max(shown(1)).max(shown(2)).sqrt();
    let gap = half * (1.0 + rule[0].0);
    let outermost = [
        [values[0], values[1]],
        [values[POINTS - 1], values[POINTS - 2]],
    ];
    let beyond = ends.iter().zip(outermost).map(|(end, [last, before])| {
        // Of a smooth function the end is five times nearer to the last point than that to the one before.
        let jump = largest_difference(*end, last) - largest_difference(last, before);
        jump.max(0.0) * gap
    });
    let missed = shown.max(half * step(rule, values));
    (fine, missed + beyond.sum::<f64>())
}

/// What a step leaves open that lies somewhere between two neighbouring points, of an interval of length
/// 2. By how much 15 and 7 points differ over a step says nothing: there are a dozen places of it where
/// they agree.
fn step<const POINTS: usize>(rule: &Kronrod<POINTS>, values: &[[f64; 3]; POINTS]) -> f64 {
    let most = |pick: fn(f64, f64) -> f64| {
        let rest = values[1..].iter();
        rest.fold(values[0], |most, value| {
            [0, 1, 2].map(|channel| pick(most[channel], value[channel]))
        })
    };
    let range = largest_difference(most(f64::max), most(f64::min));
    let pairs = values.windows(2).zip(rule.windows(2));
    pairs
        .map(|(pair, nodes)| {
            // Over one of fourteen gaps nothing smooth changes by half of all that it changes by.
            let jump = largest_difference(pair[0], pair[1]) - 0.5 * range;
            STEP * jump.max(0.0) * (nodes[1].0 - nodes[0].0)
        })
        .fold(0.0, f64::max)
}
