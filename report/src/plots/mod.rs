//! The plots, as SVG.

mod axes;
mod calibration;
mod convergence;
mod stages;
mod time_error;

use crate::{Report, ReportError};
use dataset::specification::IntegratorKind;
use plotters::style::RGBColor;

/// A plot.
#[derive(Clone, Debug)]
pub struct Plot {
    /// Its file.
    pub file: &'static str,
    /// What it shows, for the page.
    pub caption: String,
    /// The picture.
    pub svg: String,
}

/// The colours of the integrators, which readers of any colour vision tell apart.
fn colour(kind: IntegratorKind) -> RGBColor {
    match kind {
        IntegratorKind::Hybrid => RGBColor(0x1b, 0x5e, 0xa6),
        IntegratorKind::Path => RGBColor(0xc8, 0x55, 0x1b),
    }
}

/// A colour between pale and full, for rung `place` of `count`.
fn shade(kind: IntegratorKind, place: usize, count: usize) -> RGBColor {
    let RGBColor(r, g, b) = colour(kind);
    let part = 0.35 + 0.65 * (place + 1) as f64 / count as f64;
    let mix = |channel: u8| (255.0 - part * (255.0 - f64::from(channel))) as u8;
    RGBColor(mix(r), mix(g), mix(b))
}

/// Draws those plots for which there is something to be drawn.
pub fn draw(report: &Report) -> Result<Vec<Plot>, ReportError> {
    let mut plots = time_error::draw(report)?;
    plots.extend(convergence::draw(report)?);
    plots.extend(calibration::draw(report)?);
    plots.extend(stages::draw(report)?);
    Ok(plots)
}
