//! How evenly materials fill the parameter space, and how randomly seeds scramble them.
//!
//! Two kinds of test. Points of one seed must be *more* even than independent ones: a test against
//! uniformity is one-sided there, and a stronger one asks for a statistic that independent points
//! would hardly ever reach. One point over many seeds must be uniform and independent between
//! dimensions: that is what exact scrambling promises, and an ordinary test applies.
//!
//! Seeds are fixed, so a test either passes always or never; the false-alarm rates say how likely a
//! right program was to fail with the seeds chosen. Each test's rate is [`FALSE_ALARM_RATE`] over
//! all its comparisons together.

mod statistics;

use dataset::{
    SampledMaterial, Specification, Split,
    sobol::{self, DIMENSIONS},
};
use statistics::{
    chi_square, chi_square_tail, kolmogorov_smirnov, kolmogorov_smirnov_tail, level_of_each,
};

const FALSE_ALARM_RATE: f64 = 1e-6;

const SET: u32 = 9000;

/// The seeds of whole sets: the preset's first.
const SEEDS: [u64; 8] = [2019, 0, 1, 2, 42, 1 << 32, i64::MAX as u64, 0x5eed];

fn points(seed: u64, count: u32) -> Vec<[f64; DIMENSIONS]> {
    (0..count).map(|index| sobol::point(seed, index)).collect()
}

fn counts(values: impl Iterator<Item = f64>, bins: usize) -> Vec<u32> {
    let mut counts = vec![0; bins];
    values.for_each(|value| counts[(value * bins as f64) as usize] += 1);
    counts
}

fn pairs() -> impl Iterator<Item = (usize, usize)> {
    (0..DIMENSIONS).flat_map(|a| (0..a).map(move |b| (b, a)))
}

/// The sampled coordinates of a material, each as a fraction of its range.
fn coordinates(sampled: &SampledMaterial) -> [f64; DIMENSIONS] {
    let material = &sampled.material;
    let [r0, g0, b0] = sampled.srgb0;
    let [r90, g90, b90] = sampled.srgb90;
    [
        material.roughness / 100.0,
        material.anisotropy,
        material.angle_deg / 180.0,
        (material.ior - 1.0) / 9.0,
        r0,
        g0,
        b0,
        r90,
        g90,
        b90,
    ]
}

#[test]
fn the_first_hundred_of_nine_thousand_are_the_set_of_hundred() {
    let set = Specification::preset();
    let hundred = Specification {
        materials: 100,
        ..set.clone()
    };
    for index in 0..100 {
        assert_eq!(hundred.material(index), set.material(index));
        assert_eq!(hundred.split(index), set.split(index));
    }
    assert_eq!(hundred.hash(), set.hash());
}

#[test]
fn materials_depend_on_the_seed_and_the_ranges_alone() {
    let set = Specification::preset();
    let mut other = set.clone();
    other.name = "other".to_owned();
    other.image.width = 7;
    other.views.truncate(1);
    other.camera.distance_m = 0.7;
    other.parameters.ior = [1.5, 1.5];
    let reseeded = Specification {
        seed: set.seed + 1,
        ..set.clone()
    };
    for index in (0..500).chain([u32::MAX]) {
        let expected = set.material(index);
        let mut found = other.material(index);
        assert_eq!(found.material.ior, 1.5);
        found.material.ior = expected.material.ior;
        assert_eq!(found, expected);
        let pairs = coordinates(&reseeded.material(index)).into_iter();
        assert!(
            pairs
                .zip(coordinates(&expected))
                .all(|(new, old)| new != old)
        );
    }
}

#[test]
fn a_hundred_bins_of_every_coordinate_hold_90_give_or_take_5() {
    for seed in SEEDS {
        let set = Specification {
            seed,
            ..Specification::preset()
        };
        let materials: Vec<_> = (0..SET)
            .map(|index| coordinates(&set.material(index)))
            .collect();
        for dimension in 0..DIMENSIONS {
            let values = materials.iter().map(|material| material[dimension]);
            for (bin, count) in counts(values, 100).into_iter().enumerate() {
                assert!(
                    (85..=95).contains(&count),
                    "seed {seed}, dimension {dimension}, bin {bin}: {count}"
                );
            }
        }
    }
}

#[test]
fn labelled_bins_of_the_four_plain_parameters_are_those_of_the_coordinates() {
    let set = Specification::preset();
    for index in 0..SET {
        let sampled = set.material(index);
        let bins = sampled.bins();
        assert!(bins.iter().all(|bin| *bin < 100));
        let point = coordinates(&sampled);
        for parameter in 0..4 {
            let expected = point[parameter] * 100.0;
            // Where the coordinate is on a boundary to rounding, either bin is right.
            assert!((expected - f64::from(bins[parameter]) - 0.5).abs() < 0.5 + 1e-9);
        }
    }
}

#[test]
fn splits_of_nine_thousand_are_6000_1500_1500() {
    for seed in SEEDS {
        let set = Specification {
            seed,
            ..Specification::preset()
        };
        let of = |split| (0..SET).filter(|index| set.split(*index) == split).count();
        assert_eq!(
            [of(Split::Train), of(Split::Validation), of(Split::Test)],
            [6000, 1500, 1500]
        );
    }
}

#[test]
fn arrangements_of_a_block_are_equally_likely_and_blocks_independent() {
    // 30 arrangements of validation and test among six; and pairs of neighbouring blocks.
    let set = Specification::preset();
    let blocks = 90_000;
    let place = |block: u32, split| (0..6).find(|place| set.split(block * 6 + place) == split);
    let arrangements: Vec<usize> = (0..blocks)
        .map(|block| {
            let validation = place(block, Split::Validation).unwrap() as usize;
            let test = place(block, Split::Test).unwrap() as usize;
            validation * 5 + test - usize::from(test > validation)
        })
        .collect();
    let (mut single, mut paired) = (vec![0; 30], vec![0; 900]);
    for pair in arrangements.chunks_exact(2) {
        single[pair[0]] += 1;
        single[pair[1]] += 1;
        paired[pair[0] * 30 + pair[1]] += 1;
    }
    let level = level_of_each(FALSE_ALARM_RATE, 2);
    assert!(chi_square_tail(chi_square(&single), 29) > level);
    assert!(chi_square_tail(chi_square(&paired), 899) > level);
}

#[test]
fn marginals_of_a_set_pass_chi_square_and_are_more_even_than_chance() {
    let tests = SEEDS.len() * DIMENSIONS;
    let level = level_of_each(FALSE_ALARM_RATE, tests);
    let mut most_uneven: f64 = 0.0;
    for seed in SEEDS {
        let set = points(seed, SET);
        for dimension in 0..DIMENSIONS {
            let values = set.iter().map(|point| point[dimension]);
            let statistic = chi_square(&counts(values, 100));
            assert!(chi_square_tail(statistic, 99) > level);
            most_uneven = most_uneven.max(statistic);
        }
    }
    // Independent points would be as even as the least even of these once in more than 10^12 sets.
    assert!(
        1.0 - chi_square_tail(most_uneven, 99) < 1e-12,
        "{most_uneven}"
    );
}

#[test]
fn marginals_of_a_set_pass_kolmogorov_smirnov_and_are_more_even_than_chance() {
    let tests = SEEDS.len() * DIMENSIONS;
    let level = level_of_each(FALSE_ALARM_RATE, tests);
    for seed in SEEDS {
        let set = points(seed, SET);
        for dimension in 0..DIMENSIONS {
            let mut values: Vec<f64> = set.iter().map(|point| point[dimension]).collect();
            let statistic = kolmogorov_smirnov(&mut values);
            assert!(kolmogorov_smirnov_tail(statistic, values.len()) > level);
            // Independent points stray from uniform by 0.87 / sqrt(9000) = 0.009 on average.
            assert!(
                statistic < 0.001,
                "seed {seed}, dimension {dimension}: {statistic}"
            );
        }
    }
}

#[test]
fn aligned_powers_of_two_put_one_point_into_each_interval() {
    // Every dimension is a (0, 1)-sequence in base 2, scrambled or not.
    for seed in SEEDS {
        for (start, bits) in [(0, 10), (8192, 10), (3 << 12, 12)] {
            let count = 1_u32 << bits;
            for dimension in 0..DIMENSIONS {
                let values =
                    (start..start + count).map(|index| sobol::point(seed, index)[dimension]);
                assert!(
                    counts(values, count as usize)
                        .into_iter()
                        .all(|held| held == 1)
                );
            }
        }
    }
}

#[test]
fn every_pair_of_dimensions_is_more_even_than_chance() {
    // 16 x 16 cells of a set, and half of it: independent points give 255, give or take 23.
    for seed in SEEDS {
        for count in [SET / 2, SET] {
            let set = points(seed, count);
            for (a, b) in pairs() {
                let cells = set
                    .iter()
                    .map(|point| ((point[a] * 16.0).floor() + point[b]) / 16.0);
                let statistic = chi_square(&counts(cells, 256));
                let as_even_by_chance = 1.0 - chi_square_tail(statistic, 255);
                assert!(
                    as_even_by_chance < 1e-9,
                    "{seed} {count} {a} {b}: {statistic}"
                );
            }
        }
    }
}

/// Warnock's formula for the squared L2 star discrepancy of points in the unit square.
fn star_discrepancy_squared(points: &[[f64; 2]]) -> f64 {
    let count = points.len() as f64;
    let corners: f64 = points
        .iter()
        .map(|[x, y]| (1.0 - x * x) * (1.0 - y * y) / 4.0)
        .sum();
    let overlaps: f64 = points
        .iter()
        .map(|[x, y]| {
            let row: f64 = points
                .iter()
                .map(|[u, v]| (1.0 - x.max(*u)) * (1.0 - y.max(*v)))
                .sum();
            row
        })
        .sum();
    1.0 / 9.0 - 2.0 * corners / count + overlaps / (count * count)
}

#[test]
fn every_prefix_covers_every_pair_of_dimensions_better_than_chance() {
    // Prefixes with the largest ratio to chance that is allowed: on average over the pairs, and
    // for the worst of them, which short prefixes leave as uneven as chance.
    let allowed = [
        (12, 0.5, 2.0),
        (100, 0.15, 0.5),
        (500, 0.05, 0.2),
        (1000, 0.025, 0.1),
        (2000, 0.015, 0.05),
    ];
    for seed in [2019, 1] {
        let set = points(seed, 2000);
        for (count, mean_max, worst_max) in allowed {
            // What independent points have on average.
            let by_chance = (1.0 / 4.0 - 1.0 / 9.0) / count as f64;
            let ratios: Vec<f64> = pairs()
                .map(|(a, b)| {
                    let plane: Vec<_> = set[..count]
                        .iter()
                        .map(|point| [point[a], point[b]])
                        .collect();
                    star_discrepancy_squared(&plane) / by_chance
                })
                .collect();
            let mean = ratios.iter().sum::<f64>() / ratios.len() as f64;
            let worst = ratios.iter().copied().fold(0.0, f64::max);
            assert!(
                mean < mean_max,
                "seed {seed}, first {count}: {mean} of chance on average"
            );
            assert!(
                worst < worst_max,
                "seed {seed}, first {count}: {worst} of chance"
            );
        }
    }
}

/// The points that are looked at over many seeds: early, late, and one past every set.
const WATCHED: [u32; 8] = [0, 1, 2, 3, 100, 8191, 8999, u32::MAX];

const SEEDS_WATCHED: u64 = 4000;

#[test]
fn over_seeds_every_point_is_uniform() {
    let level = level_of_each(FALSE_ALARM_RATE, 2 * WATCHED.len() * DIMENSIONS);
    for index in WATCHED {
        let over_seeds: Vec<_> = (0..SEEDS_WATCHED)
            .map(|seed| sobol::point(seed, index))
            .collect();
        for dimension in 0..DIMENSIONS {
            let mut values: Vec<f64> = over_seeds.iter().map(|point| point[dimension]).collect();
            let tail = chi_square_tail(chi_square(&counts(values.iter().copied(), 64)), 63);
            assert!(tail > level, "point {index}, dimension {dimension}: {tail}");
            let statistic = kolmogorov_smirnov(&mut values);
            let tail = kolmogorov_smirnov_tail(statistic, values.len());
            assert!(tail > level, "point {index}, dimension {dimension}: {tail}");
        }
    }
}

#[test]
fn over_seeds_the_lowest_digits_are_fair_too() {
    // Digit by digit, all 53: the sum of 53 squared normals for each point and dimension.
    let level = level_of_each(FALSE_ALARM_RATE, WATCHED.len() * DIMENSIONS);
    for index in WATCHED {
        let mut ones = [[0_u32; 53]; DIMENSIONS];
        for seed in 0..SEEDS_WATCHED {
            for (dimension, value) in sobol::point(seed, index).into_iter().enumerate() {
                let digits = (value * (1_u64 << 53) as f64) as u64;
                for (digit, ones) in ones[dimension].iter_mut().enumerate() {
                    *ones += (digits >> digit & 1) as u32;
                }
            }
        }
        for of_dimension in ones {
            let statistic: f64 = of_dimension
                .iter()
                .map(|ones| chi_square(&[*ones, SEEDS_WATCHED as u32 - ones]))
                .sum();
            assert!(chi_square_tail(statistic, 53) > level, "point {index}");
        }
    }
}

#[test]
fn over_seeds_the_dimensions_of_a_point_are_independent() {
    let level = level_of_each(FALSE_ALARM_RATE, WATCHED.len() * 45);
    for index in WATCHED {
        let over_seeds: Vec<_> = (0..SEEDS_WATCHED)
            .map(|seed| sobol::point(seed, index))
            .collect();
        for (a, b) in pairs() {
            let cells = over_seeds
                .iter()
                .map(|point| ((point[a] * 8.0).floor() + point[b]) / 8.0);
            let tail = chi_square_tail(chi_square(&counts(cells, 64)), 63);
            assert!(
                tail > level,
                "point {index}, dimensions {a} and {b}: {tail}"
            );
        }
    }
}

#[test]
fn over_seeds_two_points_are_independent_below_their_first_difference() {
    // Points 2 and 3, and 100 and 101, differ in every dimension's first digit; what follows it,
    // three digits of each, must tell nothing of the other. Digits that a flip shared between
    // branches of the tree would repeat show as empty cells.
    let twins = [(0, 1), (2, 3), (100, 101)];
    let level = level_of_each(FALSE_ALARM_RATE, twins.len() * DIMENSIONS);
    for (first, second) in twins {
        let mut cells = [[0_u32; 64]; DIMENSIONS];
        for seed in 0..SEEDS_WATCHED {
            let [a, b] = [first, second].map(|index| sobol::point(seed, index));
            for dimension in 0..DIMENSIONS {
                let digits = |value: f64| (value * 16.0) as usize;
                let (x, y) = (digits(a[dimension]), digits(b[dimension]));
                assert_ne!(x >> 3, y >> 3, "the first digits differ");
                cells[dimension][(x & 7) << 3 | y & 7] += 1;
            }
        }
        for (dimension, cells) in cells.iter().enumerate() {
            let tail = chi_square_tail(chi_square(cells), 63);
            assert!(
                tail > level,
                "points {first} and {second}, {dimension}: {tail}"
            );
        }
    }
}
