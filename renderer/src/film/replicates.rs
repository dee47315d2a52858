//! Estimates from independent replicates: the mean, and how far it may be off.

use super::FilmPixel;

/// Independent scrambles of the sampling points; their spread measures the error.
pub const REPLICATES: u32 = 8;

/// The 0.975 quantile of Student's t with `REPLICATES - 1` degrees of freedom.
const T_QUANTILE: f64 = 2.364_624_251_592_784_5;

/// A pixel from the means of its replicates, with the 95 percent t-interval of the worst channel.
pub fn estimate(means: &[[f64; 3]; REPLICATES as usize]) -> FilmPixel {
    let count = f64::from(REPLICATES);
    let mut pixel = FilmPixel::default();
    for channel in 0..3 {
        let mean = means.iter().map(|mean| mean[channel]).sum::<f64>() / count;
        let squares: f64 = means
            .iter()
            .map(|replicate| (replicate[channel] - mean) * (replicate[channel] - mean))
            .sum();
        pixel.value[channel] = mean;
        let standard_error = (squares / (count - 1.0) / count).sqrt();
        pixel.error = pixel.error.max(T_QUANTILE * standard_error);
    }
    pixel
}
