//! Statistical tests of the reflectance model: its sampling against its density, its energy.
//! Seeds are fixed; each test states the chance that a right program would fail it.

use dataset::{HARD_CASES, HardCase, Material, specification::Tint};
use proptest::prelude::*;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use renderer::{reflectance::Reflectance, sampler::Dimension, sampler::Sampler, vector::Vec3};

/// Half vectors on the unit square: slopes p and q along the lobe's axes in units of its widths,
/// squashed so that the whole hemisphere is covered and no lobe is narrow.
struct SlopeChart {
    sin_psi: f64,
    cos_psi: f64,
    widths: [f64; 2],
}

impl SlopeChart {
    fn new(reflectance: &Reflectance, angle_deg: f64) -> Self {
        let (sin_psi, cos_psi) = dataset::sin_cos_deg(angle_deg);
        Self {
            sin_psi,
            cos_psi,
            widths: [reflectance.lobe.n_u, reflectance.lobe.n_v].map(|n| 2.0 / (n + 1.0).sqrt()),
        }
    }

    fn cell(&self, half: Vec3, cells: usize) -> usize {
        let slopes = [
            (self.cos_psi * half.x + self.sin_psi * half.y) / half.z,
            (self.cos_psi * half.y - self.sin_psi * half.x) / half.z,
        ];
        let cell: [usize; 2] = std::array::from_fn(|axis| {
            let scaled = slopes[axis] / self.widths[axis];
            let squashed = 0.5 + 0.5 * scaled / (1.0 + scaled * scaled).sqrt();
            ((squashed * cells as f64) as usize).min(cells - 1)
        });
        cell[0] * cells + cell[1]
    }

    /// The direction to the light at the point (s, t) of the square, and the steradians it stands
    /// for per unit of the square's area: wi -> h (4 h.wo), h -> slopes (h_z^3), slopes -> square.
    /// None where the half vector turns away from the viewer.
    fn light(&self, square: [f64; 2], wo: Vec3) -> Option<(Vec3, f64)> {
        let mut jacobian = 1.0;
        let slopes: [f64; 2] = std::array::from_fn(|axis| {
            let centred = 2.0 * square[axis] - 1.0;
            let root = (1.0 - centred * centred).sqrt();
            jacobian *= 2.0 * self.widths[axis] / (root * root * root);
            self.widths[axis] * centred / root
        });
        let half = Vec3::new(
            self.cos_psi * slopes[0] - self.sin_psi * slopes[1],
            self.sin_psi * slopes[0] + self.cos_psi * slopes[1],
            1.0,
        )
        .normalized();
        let projection = half.dot(wo);
        let h_z3 = half.z * half.z * half.z;
        (projection > 0.0).then(|| {
            (
                half * (2.0 * projection) - wo,
                4.0 * projection * h_z3 * jacobian,
            )
        })
    }
}

/// The z of Wilson and Hilferty's normal approximation of a chi-square value.
fn chi_square_z(value: f64, degrees: f64) -> f64 {
    let spread = 2.0 / (9.0 * degrees);
    (libm::cbrt(value / degrees) - (1.0 - spread)) / spread.sqrt()
}

fn viewer(elevation_deg: f64, azimuth_deg: f64) -> Vec3 {
    let (sin, cos) = dataset::sin_cos_deg(elevation_deg);
    let (sin_turn, cos_turn) = dataset::sin_cos_deg(azimuth_deg);
    Vec3::new(cos * cos_turn, cos * sin_turn, sin)
}

fn uniform(rng: &mut ChaCha8Rng) -> f64 {
    ((rng.next_u64() >> 12) as f64 + 0.5) * (1.0 / (1u64 << 52) as f64)
}

/// 48 histograms of 100,000 directions each against the density integrated over 20 by 20 cells.
/// A z above 5 has a chance of 3e-7; all 48 together fail a right sampler once in 70,000 seeds.
#[test]
fn sampled_directions_follow_the_density() {
    const CELLS: usize = 20;
    const POINTS_PER_CELL: usize = 48;
    const SAMPLES: u32 = 100_000;
    let mut rng = ChaCha8Rng::seed_from_u64(20_260);
    for HardCase { name, material, .. } in HARD_CASES {
        let reflectance = Reflectance::new(&material, 0.0, Tint::Hue);
        let chart = SlopeChart::new(&reflectance, material.angle_deg);
        for (elevation, azimuth) in [(90.0, 0.0), (45.0, 20.0), (15.0, 140.0), (2.0, 250.0)] {
            let wo = viewer(elevation, azimuth);
            let mut expected = [0.0; CELLS * CELLS];
            let fine = CELLS * POINTS_PER_CELL;
            for s in 0..fine {
                for t in 0..fine {
                    let square = [s, t].map(|i| (i as f64 + 0.5) / fine as f64);
                    if let Some((wi, steradians)) = chart.light(square, wo) {
                        expected[s / POINTS_PER_CELL * CELLS + t / POINTS_PER_CELL] +=
                            reflectance.density(wi, wo) * steradians / (fine * fine) as f64;
                    }
                }
            }
            let mut counts = [0.0; CELLS * CELLS];
            let mut lost = 0.0;
            for _ in 0..SAMPLES {
                match reflectance.sample(wo, [uniform(&mut rng), uniform(&mut rng)]) {
                    Some(sample) => counts[chart.cell(sample.wi + wo, CELLS)] += 1.0,
                    None => lost += 1.0,
                }
            }
            let total = f64::from(SAMPLES);
            let kept: f64 = expected.iter().sum();
            assert!(
                kept < 1.0 + 2e-3,
                "{name} at {elevation}: density sums to {kept}"
            );
            // What is expected less than ten times goes into one cell with the lost directions.
            let mut rest = (lost, total * (1.0 - kept).max(0.0));
            let (mut chi_square, mut degrees) = (0.0, 0.0);
            for (count, probability) in counts.into_iter().zip(expected) {
                let expectation = total * probability;
                if expectation < 10.0 {
                    rest = (rest.0 + count, rest.1 + expectation);
                } else {
                    chi_square += (count - expectation) * (count - expectation) / expectation;
                    degrees += 1.0;
                }
            }
            if rest.1 >= 10.0 {
                chi_square += (rest.0 - rest.1) * (rest.0 - rest.1) / rest.1;
                degrees += 1.0;
            }
            let z = chi_square_z(chi_square, degrees - 1.0);
            assert!(
                z < 5.0,
                "{name} seen at {elevation} degrees: z = {z} over {degrees} cells"
            );
        }
    }
}

/// Mean weight of sampling is the albedo: the share of light from everywhere that `wo` sees.
fn albedo(reflectance: &Reflectance, wo: Vec3, count: u32) -> [f64; 3] {
    let sampler = Sampler::new(99, 0, 0);
    let mut sum = [0.0; 3];
    for index in 0..count {
        if let Some(sample) = reflectance.sample(wo, sampler.point(Dimension::Film, index)) {
            for (sum, weight) in sum.iter_mut().zip(sample.weight) {
                *sum += weight / f64::from(count);
            }
        }
    }
    sum
}

/// An index of refraction so high that Fresnel's reflectance rounds to 1.
const TOTAL: f64 = 1e60;

#[test]
fn a_white_furnace_returns_no_more_than_it_gives() {
    for HardCase { name, material, .. } in HARD_CASES {
        for tint in [Tint::Hue, Tint::Product] {
            let material = Material {
                ior: TOTAL,
                ..material
            };
            let reflectance = Reflectance::new(&material, 0.0, tint);
            for elevation in [90.0, 45.0, 15.0, 1.0, 0.01] {
                let albedo = albedo(&reflectance, viewer(elevation, 33.0), 1 << 14);
                assert!(
                    albedo.iter().all(|&share| (0.0..=1.0).contains(&share)),
                    "{name} at {elevation} degrees: {albedo:?}"
                );
            }
        }
    }
}

#[test]
fn a_smooth_white_material_returns_all_but_a_thousandth() {
    let material = Material {
        roughness: 5.0,
        anisotropy: 0.0,
        angle_deg: 0.0,
        ior: TOTAL,
        rgb0: [1.0; 3],
        rgb90: [1.0; 3],
    };
    let reflectance = Reflectance::new(&material, 0.0, Tint::Hue);
    for share in albedo(&reflectance, viewer(90.0, 0.0), 1 << 16) {
        assert!((share - 0.999).abs() < 5e-4, "{share}");
    }
}

/// The furnace once more without the sampler: the model integrated over the lights of the
/// hemisphere by the midpoint rule in the lobe's own chart.
#[test]
fn the_albedo_of_sampling_is_the_integral_of_the_model() {
    for HardCase { name, material, .. } in HARD_CASES {
        let reflectance = Reflectance::new(&material, 0.0, Tint::Hue);
        let chart = SlopeChart::new(&reflectance, material.angle_deg);
        let wo = viewer(50.0, 75.0);
        let fine = 1500;
        let mut integral = [0.0; 3];
        for s in 0..fine {
            for t in 0..fine {
                let square = [s, t].map(|i| (f64::from(i) + 0.5) / f64::from(fine));
                let Some((wi, steradians)) = chart.light(square, wo) else {
                    continue;
                };
                let weight = wi.z * steradians / f64::from(fine * fine);
                for (sum, value) in integral.iter_mut().zip(reflectance.evaluate(wi, wo)) {
                    *sum += value * weight;
                }
            }
        }
        let sampled = albedo(&reflectance, wo, 1 << 17);
        for channel in 0..3 {
            let difference = (integral[channel] - sampled[channel]).abs();
            assert!(
                difference < 1e-3 * integral[channel].max(0.01),
                "{name}: {integral:?} against {sampled:?}"
            );
        }
    }
}

/// Any material, drawn toward the extremes of its parameters.
fn any_material() -> impl Strategy<Value = Material> {
    let extreme = |high: f64| {
        prop_oneof![
            Just(0.0),
            Just(high),
            0.0..=high,
            (-12.0..0.0f64).prop_map(move |x| high * libm::pow(10.0, x)),
            (-12.0..0.0f64).prop_map(move |x| high * (1.0 - libm::pow(10.0, x))),
        ]
    };
    let colour = move || [extreme(1.0), extreme(1.0), extreme(1.0)];
    (
        prop_oneof![extreme(100.0), 89.999..90.001f64],
        extreme(1.0),
        extreme(180.0),
        extreme(9.0),
        colour(),
        colour(),
    )
        .prop_map(
            |(roughness, anisotropy, angle_deg, ior, rgb0, rgb90)| Material {
                roughness,
                anisotropy,
                angle_deg,
                ior: 1.0 + ior,
                rgb0,
                rgb90,
            },
        )
}

/// Any direction above the surface, drawn toward the horizon and the normal.
fn any_direction() -> impl Strategy<Value = Vec3> {
    let cosine = prop_oneof![
        0.0..=1.0f64,
        (-9.0..0.0f64).prop_map(|x| libm::pow(10.0, x)),
        (-16.0..0.0f64).prop_map(|x| 1.0 - libm::pow(10.0, x)),
        Just(1.0),
    ];
    (cosine, 0.0..360.0f64).prop_map(|(z, azimuth)| {
        let (sin, cos) = dataset::sin_cos_deg(azimuth);
        let radius = (1.0 - z * z).sqrt();
        Vec3::new(radius * cos, radius * sin, z)
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(20_000))]

    #[test]
    fn values_are_finite_and_weights_at_most_one(
        material in any_material(),
        wi in any_direction(),
        wo in any_direction(),
        product in any::<bool>(),
        u in 1e-16..1.0f64,
        v in 1e-16..1.0f64,
    ) {
        let tint = if product { Tint::Product } else { Tint::Hue };
        let reflectance = Reflectance::new(&material, 0.0, tint);
        for value in reflectance.evaluate(wi, wo) {
            prop_assert!(value.is_finite() && value >= 0.0, "f = {value}");
        }
        prop_assert!(reflectance.density(wi, wo).is_finite());
        if let Some(sample) = reflectance.sample(wo, [u, v]) {
            prop_assert!((sample.wi.length() - 1.0).abs() < 1e-9);
            prop_assert!(sample.density.is_finite() && sample.density >= 0.0);
            for weight in sample.weight {
                prop_assert!((0.0..=1.0 + 1e-12).contains(&weight), "weight {weight}");
            }
        }
    }

    #[test]
    fn a_half_turn_of_the_lobe_changes_nothing(
        material in any_material(),
        wi in any_direction(),
        wo in any_direction(),
    ) {
        let at = |angle_deg| {
            Reflectance::new(&Material { angle_deg, ..material }, 0.0, Tint::Hue).evaluate(wi, wo)
        };
        prop_assert_eq!(at(0.0), at(180.0));
    }
}
