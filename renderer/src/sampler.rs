//! Owen-scrambled Sobol points for light paths.
//!
//! Each pair of decisions along a path takes its own scramble of the two-dimensional Sobol
//! sequence, a (0, 2)-sequence, with its order shuffled so that pairs are independent of each
//! other: Burley, "Practical Hash-based Owen Scrambling", JCGT 2020. The first n points of every
//! pair, n a power of two, are a (0, m, 2)-net.

/// The decisions along a path; each takes two dimensions, and none shares another's.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Dimension {
    /// Where in the pixel.
    Film,
    /// Which point of the bulb, at a surface hit (0 the first).
    Light(u32),
    /// Which direction to go on in, at a surface hit.
    Scatter(u32),
}

impl Dimension {
    fn index(self) -> u64 {
        match self {
            Self::Film => 0,
            Self::Light(bounce) => 1 + 2 * u64::from(bounce),
            Self::Scatter(bounce) => 2 + 2 * u64::from(bounce),
        }
    }
}

/// The points of one independent scramble: a pure function of (key, pixel, replicate).
#[derive(Clone, Copy, Debug)]
pub struct Sampler {
    scramble: u64,
}

impl Sampler {
    /// The sampler of a pixel's replicate. `key` names the image.
    pub fn new(key: u64, pixel: u32, replicate: u32) -> Self {
        Self {
            scramble: mix(key ^ mix(u64::from(pixel) << 32 | u64::from(replicate))),
        }
    }

    /// The sampler of a part of the pixel, counted from 0, independent of the others'.
    pub fn part(&self, part: u32) -> Self {
        Self {
            scramble: mix(self.scramble ^ mix(u64::from(part))),
        }
    }

    /// Point `index` of the pair `dimension`, inside the open unit square.
    pub fn point(&self, dimension: Dimension, index: u32) -> [f64; 2] {
        let seed = mix(self.scramble.wrapping_add(
            dimension
                .index()
                .wrapping_add(1)
                .wrapping_mul(0x9e37_79b9_7f4a_7c15),
        ));
        let keys = [
            mix(seed ^ 0x5851_f42d_4c95_7f2d),
            mix(seed ^ 0x1405_7b7e_f767_814f),
        ];
        // Laine and Karras hash bits upward: the order is shuffled from its high bits down.
        let shuffled = owen_upward(index.reverse_bits(), seed as u32).reverse_bits();
        [
            unit(
                owen_upward(shuffled, keys[0] as u32).reverse_bits(),
                keys[0],
                shuffled,
            ),
            unit(
                owen_upward(sobol_second_reversed(shuffled), keys[1] as u32).reverse_bits(),
                keys[1],
                shuffled,
            ),
        ]
    }
}

/// The 64-bit finaliser of MurmurHash3 in Stafford's thirteenth variant.
fn mix(mut x: u64) -> u64 {
    x = (x ^ x >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    x = (x ^ x >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ x >> 31
}

/// An Owen scramble of a bit-reversed 32-bit fraction: each bit is flipped by a hash of those
/// below it (Laine and Karras 2011, with Vegdahl's constants).
fn owen_upward(mut x: u32, seed: u32) -> u32 {
    x ^= x.wrapping_mul(0x3d20_adea);
    x = x.wrapping_add(seed);
    x = x.wrapping_mul(seed >> 16 | 1);
    x ^= x.wrapping_mul(0x0552_6c56);
    x ^ x.wrapping_mul(0x53a2_2864)
}

/// The second Sobol coordinate of `index`, bit-reversed. Its generator matrix is Pascal's triangle
/// modulo 2; reversed, column k holds the binomials of k in its low bits.
fn sobol_second_reversed(index: u32) -> u32 {
    const COLUMNS: [u32; 32] = {
        let mut columns = [1; 32];
        let mut k = 1;
        while k < 32 {
            columns[k] = columns[k - 1] ^ columns[k - 1] << 1;
            k += 1;
        }
        columns
    };
    let mut sum = 0;
    let mut rest = index;
    while rest != 0 {
        sum ^= COLUMNS[rest.trailing_zeros() as usize];
        rest &= rest - 1;
    }
    sum
}

/// A 32-bit fraction carried to the middle of one of 2^52 cells by bits hashed from the key.
fn unit(high: u32, key: u64, index: u32) -> f64 {
    let low = mix(key ^ u64::from(index)) >> 44;
    let cell = u64::from(high) << 20 | low;
    (cell as f64 + 0.5) * (1.0 / (1u64 << 52) as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_power_of_two_is_a_net() {
        for log_count in 0..=10u32 {
            let count = 1u32 << log_count;
            for replicate in 0..8 {
                let sampler = Sampler::new(7, 11, replicate);
                let points: Vec<_> = (0..count)
                    .map(|i| sampler.point(Dimension::Scatter(1), i))
                    .collect();
                for log_columns in 0..=log_count {
                    let columns = 1usize << log_columns;
                    let rows = count as usize / columns;
                    let mut seen = vec![false; count as usize];
                    for point in &points {
                        let column = (point[0] * columns as f64) as usize;
                        let row = (point[1] * rows as f64) as usize;
                        let cell = column * rows + row;
                        assert!(
                            !seen[cell],
                            "two of {count} points in one elementary interval"
                        );
                        seen[cell] = true;
                    }
                }
            }
        }
    }

    #[test]
    fn points_stay_inside_the_open_square() {
        assert!(unit(0, 1, 1) > 0.0 && unit(u32::MAX, 1, 1) < 1.0);
    }

    /// Means over independent scrambles of a product of two coordinates of different pairs: the
    /// padding must not correlate them. 20,000 scrambles; |z| above 4.5 has a chance of 7e-6.
    #[test]
    fn pairs_of_decisions_are_independent() {
        let count = 20_000;
        let centred = |u: f64| (u - 0.5) * 12f64.sqrt();
        for index in [0, 1, 5] {
            let sum: f64 = (0..count)
                .map(|replicate| {
                    let sampler = Sampler::new(3, 5, replicate);
                    centred(sampler.point(Dimension::Film, index)[0])
                        * centred(sampler.point(Dimension::Light(0), index)[0])
                })
                .sum();
            assert!((sum / f64::from(count).sqrt()).abs() < 4.5);
        }
    }
}
