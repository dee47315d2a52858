//! The ten coordinates of a material: an Owen-scrambled Sobol sequence.
//!
//! Any prefix of the sequence fills the ten-dimensional unit cube evenly (Sobol 1967; direction
//! numbers of Joe and Kuo, "Constructing Sobol sequences with better two-dimensional projections",
//! 2008, table `new-joe-kuo-6.21201`). Nested uniform scrambling (Owen, "Randomly permuted
//! (t,m,s)-nets and (t,s)-sequences", 1995) keeps that evenness and makes every point, taken by
//! itself, uniform over the choice of seeds.
//!
//! The scrambling is exact, not a hash that resembles it. Digit k of a coordinate is flipped by a
//! bit of its own for each of the 2^k values of the digits before it, and those bits are ChaCha20
//! keystream read at a place computed from the digits. Point i is found without its predecessors.

use crate::keystream::{Purpose, keystream};
use rand_chacha::{ChaCha20Rng, rand_core::Rng};

/// Coordinates of a point.
pub const DIMENSIONS: usize = 10;

/// Binary digits of a coordinate that the sequence decides; an index has as many.
const DIGITS: usize = 32;

const SCRAMBLE: Purpose = Purpose(*b"brdfarm dataset scramble");
const TAIL: Purpose = Purpose(*b"brdfarm dataset tail    ");

/// A primitive polynomial over the field of two elements and the first direction numbers.
struct Polynomial {
    degree: usize,
    /// The inner coefficients, highest power first.
    coefficients: usize,
    initial: [u32; 5],
}

/// Rows 2 to 10 of the table; the first dimension is van der Corput's sequence and has none.
const POLYNOMIALS: [Polynomial; DIMENSIONS - 1] = [
    polynomial(1, 0, [1, 0, 0, 0, 0]),
    polynomial(2, 1, [1, 3, 0, 0, 0]),
    polynomial(3, 1, [1, 3, 1, 0, 0]),
    polynomial(3, 2, [1, 1, 1, 0, 0]),
    polynomial(4, 1, [1, 1, 3, 3, 0]),
    polynomial(4, 4, [1, 3, 5, 13, 0]),
    polynomial(5, 2, [1, 1, 5, 5, 17]),
    polynomial(5, 4, [1, 1, 5, 5, 5]),
    polynomial(5, 7, [1, 1, 7, 11, 19]),
];

const fn polynomial(degree: usize, coefficients: usize, initial: [u32; 5]) -> Polynomial {
    Polynomial {
        degree,
        coefficients,
        initial,
    }
}

/// `DIRECTIONS[d][b]`: what bit b of an index adds to coordinate d, as a fraction of 2^32.
const DIRECTIONS: [[u32; DIGITS]; DIMENSIONS] = directions();

const fn directions() -> [[u32; DIGITS]; DIMENSIONS] {
    let mut all = [[0; DIGITS]; DIMENSIONS];
    let mut bit = 0;
    while bit < DIGITS {
        all[0][bit] = 1 << (DIGITS - 1 - bit);
        bit += 1;
    }
    let mut dimension = 1;
    while dimension < DIMENSIONS {
        let row = &POLYNOMIALS[dimension - 1];
        let mut bit = 0;
        while bit < DIGITS {
            all[dimension][bit] = if bit < row.degree {
                row.initial[bit] << (DIGITS - 1 - bit)
            } else {
                let oldest = all[dimension][bit - row.degree];
                let mut sum = oldest ^ oldest >> row.degree;
                let mut back = 1;
                while back < row.degree {
                    if row.coefficients >> (row.degree - 1 - back) & 1 == 1 {
                        sum ^= all[dimension][bit - back];
                    }
                    back += 1;
                }
                sum
            };
            bit += 1;
        }
        dimension += 1;
    }
    all
}

/// Coordinate `dimension` of unscrambled point `index`, as a fraction of 2^32.
///
/// Points come in the order of their index, not of its Gray code.
fn coordinate(index: u32, dimension: usize) -> u32 {
    DIRECTIONS[dimension]
        .iter()
        .enumerate()
        .filter(|(bit, _)| index >> bit & 1 == 1)
        .fold(0, |sum, (_, direction)| sum ^ direction)
}

/// Scrambles all 32 digits.
///
/// The tree of digits is cut into subtrees eight levels high: one at the root, 256 below it, 65,536
/// below those, 2^24 at the bottom, numbered in this order. A subtree has 255 nodes and owns eight
/// words of the keystream. Its node at level k with local prefix p is bit 2^k - 1 + p of them, so a
/// whole coordinate takes four reads instead of 32.
fn scramble(digits: u32, rng: &mut ChaCha20Rng) -> u32 {
    const LEVELS: usize = 8;
    const WORDS: usize = 8;
    let mut flips = 0;
    let mut first_subtree = 0;
    for top in (0..DIGITS).step_by(LEVELS) {
        // In 64 bits, a shift by all 32 leaves nothing.
        let subtree = first_subtree + (u64::from(digits) >> (DIGITS - top));
        first_subtree += 1_u64 << top;
        rng.set_word_pos(u128::from(subtree) * WORDS as u128);
        let nodes: [u32; WORDS] = std::array::from_fn(|_| rng.next_u32());
        let local = digits >> (DIGITS - LEVELS - top) & 0xff;
        for level in 0..LEVELS {
            let node = (1 << level) - 1 + (local >> (LEVELS - level)) as usize;
            flips = flips << 1 | (nodes[node / 32] >> (node % 32) & 1);
        }
    }
    digits ^ flips
}

/// Point `index` of the sequence that a seed scrambles: multiples of 2^-53 in `[0, 1)`.
///
/// No two indices agree in the first 32 digits of any coordinate, so the scrambling of the 21 below
/// them is independent from point to point, and is simply drawn.
pub fn point(seed: u64, index: u32) -> [f64; DIMENSIONS] {
    const TAIL_DIGITS: u32 = 21;
    const ULP: f64 = 1.0 / (1_u64 << 53) as f64;
    // A block of the keystream is 16 words: every index has its own.
    const BLOCK_WORDS: u128 = 16;
    let mut tails = keystream(seed, TAIL, 0);
    tails.set_word_pos(u128::from(index) * BLOCK_WORDS);
    std::array::from_fn(|dimension| {
        let mut rng = keystream(seed, SCRAMBLE, dimension as u64);
        let head = scramble(coordinate(index, dimension), &mut rng);
        let tail = tails.next_u32() >> (u32::BITS - TAIL_DIGITS);
        (u64::from(head) << TAIL_DIGITS | u64::from(tail)) as f64 * ULP
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Of SciPy 1.17.1, `scipy.stats.qmc.Sobol(10, scramble=False)`, whose point i is ours at i's
    /// Gray code, and for the last two rows of the recurrence written out in Python.
    const REFERENCE: [(u32, [u32; DIMENSIONS]); 7] = [
        (1, [0x80000000; DIMENSIONS]),
        (
            2,
            [
                0x40000000, 0xc0000000, 0xc0000000, 0xc0000000, 0x40000000, 0x40000000, 0xc0000000,
                0x40000000, 0x40000000, 0x40000000,
            ],
        ),
        (
            3,
            [
                0xc0000000, 0x40000000, 0x40000000, 0x40000000, 0xc0000000, 0xc0000000, 0x40000000,
                0xc0000000, 0xc0000000, 0xc0000000,
            ],
        ),
        (
            1000,
            [
                0x17c00000, 0x29400000, 0x73400000, 0xe8c00000, 0xfe400000, 0x29c00000, 0x04400000,
                0xa3c00000, 0xffc00000, 0x1f400000,
            ],
        ),
        (
            8191,
            [
                0xfff80000, 0x99980000, 0x80d80000, 0xb7f80000, 0x6d180000, 0x63580000, 0x17080000,
                0x95d80000, 0xf4580000, 0x2bc80000,
            ],
        ),
        (
            123_456_789,
            [
                0xa8b3dae0, 0x5f6572e0, 0xfc9d8c20, 0xc5e4e660, 0x7653eee0, 0xb7c756a0, 0x52ee4760,
                0x972959e0, 0x67ea3b60, 0xcd829e60,
            ],
        ),
        (
            u32::MAX,
            [
                0xffffffff, 0x00000001, 0x4f00ffff, 0x300cff8d, 0x50050093, 0xc0111111, 0x4070ccdd,
                0x84f0027f, 0x87f305cf, 0x812ad7a7,
            ],
        ),
    ];

    #[test]
    fn unscrambled_points_are_the_published_sequence() {
        for (index, expected) in REFERENCE {
            let point: [u32; DIMENSIONS] =
                std::array::from_fn(|dimension| coordinate(index, dimension));
            assert_eq!(point, expected, "point {index}");
        }
    }

    /// Of a program of its own in Python, ChaCha20 included, that shares nothing with this one:
    /// coordinates in units of 2^-53.
    #[test]
    fn scrambled_points_are_those_of_an_independent_program() {
        let reference: [(u32, [u64; DIMENSIONS]); 4] = [
            (
                0,
                [
                    169714309720488,
                    2966748267533311,
                    1594619108541968,
                    3148822949387800,
                    3215197887602800,
                    2652321534251793,
                    2633141798110385,
                    2144287492825243,
                    5121263708713796,
                    7328840520887542,
                ],
            ),
            (
                1,
                [
                    5718191945897050,
                    7129892998906804,
                    8205579465344726,
                    4626547284411350,
                    8516792010322321,
                    7675365218103442,
                    8129142324988627,
                    8529626510462637,
                    3300519113766285,
                    469230602356562,
                ],
            ),
            (
                8999,
                [
                    6865795493524268,
                    8512825234848618,
                    3861537830977335,
                    1215840625154982,
                    3574192408183328,
                    4552450410563829,
                    8314706305963591,
                    5792939660645037,
                    507205397205794,
                    2351213061069995,
                ],
            ),
            (
                u32::MAX,
                [
                    7636824643177867,
                    2966748268595023,
                    3680047987079551,
                    3453263028710861,
                    742519657186373,
                    4963944582793440,
                    422625531137000,
                    8633565932150811,
                    3156490725369081,
                    456177410758153,
                ],
            ),
        ];
        for (index, expected) in reference {
            let expected = expected.map(|coordinate| coordinate as f64 / (1_u64 << 53) as f64);
            assert_eq!(point(2019, index), expected, "point {index}");
        }
    }

    #[test]
    fn scrambling_keeps_how_far_two_numbers_agree_and_nothing_after() {
        // Nested scrambling: outputs share exactly the leading digits that inputs share.
        let mut rng = keystream(7, SCRAMBLE, 3);
        let pairs: Vec<(u32, u32)> = (0..2000_u32)
            .map(|i| {
                let a = i.wrapping_mul(0x9e37_79b9);
                let b = a ^ (i.wrapping_mul(0x85eb_ca6b) >> (i % 32));
                (a, b)
            })
            .collect();
        for (a, b) in pairs {
            let (x, y) = (scramble(a, &mut rng), scramble(b, &mut rng));
            assert_eq!((a ^ b).leading_zeros(), (x ^ y).leading_zeros());
        }
    }
}
