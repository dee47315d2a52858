//! The reflectance model against values worked out with 50 digits.

use dataset::{Material, specification::Tint};
use renderer::{reflectance::Reflectance, vector::Vec3};
use serde::Deserialize;

#[derive(Deserialize)]
struct Case {
    material: Material,
    wi: [f64; 3],
    wo: [f64; 3],
    f_hue: [f64; 3],
    f_product: [f64; 3],
}

/// Every channel within 1e-7 of the largest where both cosines are at least 1e-4, within 1e-4
/// below that: what 64-bit directions can carry.
#[test]
fn the_model_agrees_with_fifty_digits() {
    let cases: Vec<Case> =
        serde_json::from_str(include_str!("reference/brdf.json")).expect("reference values");
    assert_eq!(cases.len(), 120);
    for (number, case) in cases.iter().enumerate() {
        let wi = Vec3::from(case.wi).normalized();
        let wo = Vec3::from(case.wo).normalized();
        let tolerance = if wi.z.min(wo.z) >= 1e-4 { 1e-7 } else { 1e-4 };
        for (tint, expected) in [(Tint::Hue, case.f_hue), (Tint::Product, case.f_product)] {
            let value = Reflectance::new(&case.material, 0.0, tint).evaluate(wi, wo);
            let largest = expected.iter().fold(0.0f64, |a, &b| a.max(b));
            for channel in 0..3 {
                assert!(
                    (value[channel] - expected[channel]).abs() <= tolerance * largest,
                    "case {number}, {tint:?}, channel {channel}: {value:?} against {expected:?}"
                );
            }
        }
    }
}
