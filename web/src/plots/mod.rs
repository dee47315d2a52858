//! Plots as SVG inside pages: axes with units, colours from the style sheet, no style attributes.

mod axis;
pub mod histogram;
pub mod line;
pub mod lobe;

/// A place in a plot to a tenth of a unit: more is not seen, and would be most of the page.
fn tenth(place: f64) -> f64 {
    (10.0 * place).round() / 10.0
}
