//! Numbers of 64 bits as bounds of 32.

/// The smallest 32-bit float that is not below `value`.
pub fn rounded_up(value: f64) -> f32 {
    let nearest = value as f32;
    if f64::from(nearest) < value {
        nearest.next_up()
    } else {
        nearest
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bound_is_rounded_to_the_next_float_and_no_further() {
        for exact in [0.0, f32::MIN_POSITIVE, 0.1, 1.0, f32::MAX] {
            let value = f64::from(exact);
            assert_eq!(rounded_up(value), exact);
            assert_eq!(rounded_up(value.next_up()), exact.next_up());
            assert_eq!(rounded_up(value.next_down()), exact);
        }
        assert_eq!(rounded_up(f64::INFINITY), f32::INFINITY);
        assert!(rounded_up(f64::NAN).is_nan());
    }
}
