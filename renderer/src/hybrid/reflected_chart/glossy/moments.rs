//! Integrals of a normal density times polynomials, from minus infinity to a point.

use crate::numerics::batch::LANES;
use crate::numerics::elementary::ROUND;
use std::f64::consts::{FRAC_1_SQRT_2, PI};
use std::sync::LazyLock;

/// Points at which what multiplies the density is known.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Order {
    /// One point: it is constant over the density.
    One,
    /// Three points: what multiplies the density is a parabola over it.
    Three,
    /// Five.
    Five,
    /// Seven.
    Seven,
    /// Nine.
    Nine,
    /// Eleven.
    Eleven,
}

impl Order {
    /// The next larger.
    pub fn finer(self) -> Self {
        match self {
            Self::One => Self::Three,
            Self::Three => Self::Five,
            Self::Five => Self::Seven,
            Self::Seven => Self::Nine,
            Self::Nine | Self::Eleven => Self::Eleven,
        }
    }
}

/// The integrals from minus infinity to some z of z^i exp(-z^2/2), i from 0, lane by lane.
pub type Moments<const N: usize> = [[f64; LANES]; N];

/// The points of an order and what goes with them.
pub struct Nodes<const N: usize> {
    /// The points, in widths of the density.
    pub nodes: [f64; N],
    /// The coefficients of the polynomials that are 1 at one point and 0 at the others.
    pub polynomials: [[f64; N]; N],
}

impl<const N: usize> Nodes<N> {
    fn new(nodes: [f64; N]) -> Self {
        Self {
            nodes,
            polynomials: lagrange(nodes),
        }
    }
}

/// The zeros of the Hermite polynomials of degree 1, 3, 5, 7, 9 and 11 (of weight exp(-z^2/2)): over the whole
/// density, rules on them are Gauss's.
pub static ONE: LazyLock<Nodes<1>> = LazyLock::new(|| Nodes::new([0.0]));
pub static THREE: LazyLock<Nodes<3>> =
    LazyLock::new(|| Nodes::new([-1.732_050_807_568_877_2, 0.0, 1.732_050_807_568_877_2]));
pub static FIVE: LazyLock<Nodes<5>> = LazyLock::new(|| {
    Nodes::new([
        -2.856_970_013_872_805_6,
        -1.355_626_179_974_266,
        0.0,
        1.355_626_179_974_266,
        2.856_970_013_872_805_6,
    ])
});
pub static SEVEN: LazyLock<Nodes<7>> = LazyLock::new(|| {
    Nodes::new([
        -3.750_439_717_725_742_5,
        -2.366_759_410_734_541_5,
        -1.154_405_394_739_968_2,
        0.0,
        1.154_405_394_739_968_2,
        2.366_759_410_734_541_5,
        3.750_439_717_725_742_5,
    ])
});
pub static NINE: LazyLock<Nodes<9>> = LazyLock::new(|| {
    Nodes::new([
        -4.512_745_863_399_783,
        -3.205_429_002_856_47,
        -2.076_847_978_677_83,
        -1.023_255_663_789_133,
        0.0,
        1.023_255_663_789_133,
        2.076_847_978_677_83,
        3.205_429_002_856_47,
        4.512_745_863_399_783,
    ])
});

pub static ELEVEN: LazyLock<Nodes<11>> = LazyLock::new(|| {
    Nodes::new([
        -5.188_001_224_374_871,
        -3.936_166_607_129_977,
        -2.865_123_160_643_645,
        -1.876_035_020_154_845_8,
        -0.928_868_997_381_063_9,
        0.0,
        0.928_868_997_381_063_9,
        1.876_035_020_154_845_8,
        2.865_123_160_643_645,
        3.936_166_607_129_977,
        5.188_001_224_374_871,
    ])
});

fn lagrange<const N: usize>(nodes: [f64; N]) -> [[f64; N]; N] {
    let mut polynomials = [[0.0; N]; N];
    for (k, polynomial) in polynomials.iter_mut().enumerate() {
        polynomial[0] = 1.0;
        let others = nodes.iter().enumerate().filter(|&(j, _)| j != k);
        for (degree, (_, node)) in (1..).zip(others) {
            let scale = 1.0 / (nodes[k] - node);
            for i in (1..=degree).rev() {
                polynomial[i] = scale * (polynomial[i - 1] - node * polynomial[i]);
            }
            polynomial[0] *= -scale * node;
        }
    }
    polynomials
}

/// Of the whole line: the square root of 2 pi times the moments 1, 0, 1, 0, 3, 0, 15, 0, 105, 0, 945.
pub fn everything<const N: usize>() -> Moments<N> {
    const ROOT: f64 = 2.506_628_274_631_000_7;
    const MOMENTS: [f64; 11] = [
        ROOT,
        0.0,
        ROOT,
        0.0,
        3.0 * ROOT,
        0.0,
        15.0 * ROOT,
        0.0,
        105.0 * ROOT,
        0.0,
        945.0 * ROOT,
    ];
    std::array::from_fn(|i| [MOMENTS[i]; LANES])
}

/// Beyond this on either side a density is taken for nothing: it is 1e-14 there.
pub const TABLE_END: f64 = 8.0;

/// Entries of the table for a unit of z.
const TABLE_STEPS: f64 = 128.0;

/// Entries in all: from -[`TABLE_END`] to one step below it.
const ENTRIES: usize = 2048;

/// At equidistant z the integral of the density up to z, and the density.
pub type Table = [[f64; 2]; ENTRIES];

/// The table.
pub static TABLE: LazyLock<Table> = LazyLock::new(|| {
    std::array::from_fn(|index| {
        let z = index as f64 / TABLE_STEPS - TABLE_END;
        let mass = (0.5 * PI).sqrt() * libm::erfc(-FRAC_1_SQRT_2 * z);
        [mass, libm::exp(-0.5 * z * z)]
    })
});

/// The moments up to z, within 1e-11 for the first, by Taylor's series about the nearest entries of
/// the table.
#[inline(always)]
pub fn up_to<const N: usize>(table: &Table, z: &[f64; LANES]) -> Moments<N> {
    const LAST: f64 = (ENTRIES - 1) as f64;
    let (mut nearest, mut off, mut index) = ([0.0; LANES], [0.0; LANES], [0; LANES]);
    for i in 0..LANES {
        let position = (z[i] + TABLE_END) * TABLE_STEPS;
        let position = if position > 0.0 { position } else { 0.0 };
        let position = if position < LAST { position } else { LAST };
        let shifted = position + ROUND;
        let rounded = shifted - ROUND;
        index[i] = shifted.to_bits();
        nearest[i] = rounded * (1.0 / TABLE_STEPS) - TABLE_END;
        off[i] = (position - rounded) * (1.0 / TABLE_STEPS);
    }
    let (mut mass, mut density) = ([0.0; LANES], [0.0; LANES]);
    for i in 0..LANES {
        [mass[i], density[i]] = table[index[i] as usize % ENTRIES];
    }
    let mut moments = [[0.0; LANES]; N];
    for i in 0..LANES {
        // The derivatives of the density are Hermite's polynomials times it.
        let (y, d) = (nearest[i], off[i]);
        let y2 = y * y;
        let (second, third) = (y2 - 1.0, y * (3.0 - y2));
        let fourth = y2 * (y2 - 6.0) + 3.0;
        let rise = 1.0 + d * (1.0 / 2.0) * (-y + d * (1.0 / 3.0) * (second + d * 0.25 * third));
        let fall = -y + d * (1.0 / 2.0) * (second + d * (1.0 / 3.0) * (third + d * 0.25 * fourth));
        let at_end = density[i] * (1.0 + d * fall);
        moments[0][i] = mass[i] + density[i] * d * rise;
        if N > 1 {
            moments[1][i] = -at_end;
        }
        let end = nearest[i] + d;
        let mut boundary = at_end;
        for k in 2..N {
            boundary *= end;
            moments[k][i] = (k - 1) as f64 * moments[k - 2][i] - boundary;
        }
    }
    moments
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numerics::gauss::GaussRule;

    fn pieces_integrate<const N: usize>(order: &Nodes<N>) {
        for (low, high) in [(-2.0, -1.9), (-0.3, 4.0), (1.0, 1.5)] {
            let [below, above] = [low, high].map(|z| up_to::<N>(&TABLE, &[z; LANES]));
            let moments: [f64; N] = std::array::from_fn(|i| above[i][0] - below[i][0]);
            for degree in 0..N as i32 {
                let function = |z: f64| (0..degree).fold(1.0, |product, _| product * (z - 0.4));
                let mut found = 0.0;
                for (polynomial, &z) in order.polynomials.iter().zip(&order.nodes) {
                    let weight: f64 = polynomial.iter().zip(&moments).map(|(a, m)| a * m).sum();
                    found += weight * function(z);
                }
                let expected: f64 = GaussRule::of(40)
                    .on(low, high)
                    .map(|(z, weight)| weight * libm::exp(-0.5 * z * z) * function(z))
                    .sum();
                assert!(
                    (found - expected).abs() < 1e-8,
                    "{N} points, {degree}: {found} against {expected}"
                );
            }
        }
    }

    #[test]
    fn pieces_integrate_every_polynomial_of_the_nodes() {
        pieces_integrate(&ONE);
        pieces_integrate(&THREE);
        pieces_integrate(&FIVE);
        pieces_integrate(&SEVEN);
        pieces_integrate(&NINE);
        pieces_integrate(&ELEVEN);
    }

    #[test]
    fn far_out_there_is_nothing_or_everything() {
        for z in [TABLE_END, 40.0] {
            let below = up_to::<7>(&TABLE, &[-z; LANES]);
            let above = up_to::<7>(&TABLE, &[z; LANES]);
            for ((below, above), everything) in below.iter().zip(&above).zip(everything::<7>()) {
                assert!(below[0].abs() < 1e-8, "{z}: {}", below[0]);
                assert!((above[0] - everything[0]).abs() < 1e-8, "{z}: {}", above[0]);
            }
        }
    }

    #[test]
    fn moments_are_the_mass_and_the_density_in_every_lane() {
        for step in 0..20_000 {
            let z: [f64; LANES] =
                std::array::from_fn(|i| f64::from(step) * 8e-4 - 8.0 + 1e-4 * i as f64);
            let [mass, density] = up_to::<2>(&TABLE, &z);
            for i in 0..LANES {
                let z = z[i];
                assert!((-density[i] - libm::exp(-0.5 * z * z)).abs() < 1e-11, "{z}");
                let expected = (0.5 * PI).sqrt() * libm::erfc(-FRAC_1_SQRT_2 * z);
                assert!((mass[i] - expected).abs() < 1e-11, "{z}");
            }
        }
    }
}
