//! Fresnel's reflectance of a dielectric.

/// Unpolarised reflectance at the boundary from air to a dielectric of index `ior`, light arriving
/// at `cos_i`: Vidaurre et al. 2019, equation 3, with the extinction coefficient k = 0.
///
/// `cos_i` in 0 to 1, `ior` at least 1; the result lies in 0 to 1, exactly 0 at `ior = 1` and
/// `cos_i = 1`.
#[inline(always)]
pub fn reflectance(cos_i: f64, ior: f64) -> f64 {
    let (a, b) = (ior - cos_i, ior + cos_i);
    let (c, d) = (ior * cos_i - 1.0, ior * cos_i + 1.0);
    // ((a/b)^2 + (c/d)^2)/2 with one division.
    let (ad, bc, bd) = (a * d, b * c, b * d);
    (ad * ad + bc * bc) / (2.0 * bd * bd)
}

/// The cosines, at most two, at which [`reflectance`] is `value`; 2 for each that there is not.
///
/// With y = c + 1/c it is (n^2 (y^2 - 4) + (n^2 - 1)^2) / (n y + n^2 + 1)^2: a quadratic equation.
pub fn cosines(value: f64, ior: f64) -> [f64; 2] {
    const NONE: f64 = 2.0;
    let n2 = ior * ior;
    let a = (1.0 - value) * n2;
    let half_b = value * ior * (n2 + 1.0);
    let c = (n2 - 1.0) * (n2 - 1.0) - 4.0 * n2 - value * (n2 + 1.0) * (n2 + 1.0);
    let discriminant = half_b * half_b - a * c;
    if a <= 0.0 || discriminant < 0.0 {
        return [NONE; 2];
    }
    let root = discriminant.sqrt();
    [half_b + root, half_b - root].map(|scaled| {
        let y = scaled / a;
        if y >= 2.0 {
            2.0 / (y + (y * y - 4.0).sqrt())
        } else {
            NONE
        }
    })
}

#[cfg(test)]
mod tests {
    use super::{cosines, reflectance};
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn cosines_are_all_places_of_a_reflectance(
            cos_i in 0.01..0.99f64,
            ior in 1.01..10.0f64,
        ) {
            let value = reflectance(cos_i, ior);
            let found = cosines(value, ior);
            // Where reflectance hardly changes, as about its minimum, its position is ill-conditioned.
            let slope = (reflectance(cos_i + 1e-6, ior) - reflectance(cos_i - 1e-6, ior)) / 2e-6;
            prop_assume!(slope.abs() > 1e-3);
            prop_assert!(found.iter().any(|c| (c - cos_i).abs() < 1e-9), "{:?}", found);
            for c in found {
                prop_assert!(c == 2.0 || (reflectance(c, ior) - value).abs() < 1e-9);
            }
        }
    }

    #[test]
    fn no_place_where_there_is_none() {
        assert_eq!(cosines(2.0, 1.5), [2.0; 2]);
        assert_eq!(cosines(1e-3, 1.5), [2.0; 2]);
    }

    #[test]
    fn nothing_reflects_where_nothing_changes() {
        assert_eq!(reflectance(1.0, 1.0), 0.0);
    }

    #[test]
    fn glass_reflects_four_percent_at_normal_incidence_and_all_at_grazing() {
        assert!((reflectance(1.0, 1.5) - 0.04).abs() < 1e-15);
        assert_eq!(reflectance(0.0, 1.5), 1.0);
    }
}
