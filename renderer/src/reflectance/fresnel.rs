//! Fresnel's reflectance of a dielectric.

/// Unpolarised reflectance at the boundary from air to a dielectric of index `ior`, light arriving
/// at `cos_i`: Vidaurre et al. 2019, equation 3, with the extinction coefficient k = 0.
///
/// `cos_i` in 0 to 1, `ior` at least 1; the result lies in 0 to 1, exactly 0 at `ior = 1` and
/// `cos_i = 1`.
pub fn reflectance(cos_i: f64, ior: f64) -> f64 {
    let perpendicular = (ior - cos_i) / (ior + cos_i);
    let parallel = (ior * cos_i - 1.0) / (ior * cos_i + 1.0);
    0.5 * (parallel * parallel + perpendicular * perpendicular)
}

#[cfg(test)]
mod tests {
    use super::reflectance;

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
