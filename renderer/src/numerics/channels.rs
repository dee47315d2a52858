//! Values of three channels: red, green and blue.

/// Adds `value * factor` to `sum`.
pub fn add_scaled<const N: usize>(sum: &mut [f64; N], value: [f64; N], factor: f64) {
    for (sum, value) in sum.iter_mut().zip(value) {
        *sum += value * factor;
    }
}

/// The largest channel.
pub fn largest(value: [f64; 3]) -> f64 {
    value[0].max(value[1]).max(value[2])
}

/// The largest difference of two values in a channel.
pub fn largest_difference(a: [f64; 3], b: [f64; 3]) -> f64 {
    (0..3).map(|i| (a[i] - b[i]).abs()).fold(0.0, f64::max)
}
