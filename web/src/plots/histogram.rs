//! How often values occur, by split.

use super::{axis::Axis, tenth};
use maud::{Markup, html};

const BINS: usize = 24;
const WIDTH: f64 = 320.0;
const HEIGHT: f64 = 190.0;
const LEFT: f64 = 46.0;
const RIGHT: f64 = 12.0;
const TOP: f64 = 24.0;
const BOTTOM: f64 = 42.0;

/// A histogram's title and axis.
pub struct Histogram<'a> {
    pub title: &'a str,
    /// The axis' title, with its unit.
    pub axis: &'a str,
    pub is_logarithmic: bool,
    /// Where the axis begins and ends; with the values if none.
    pub range: Option<[f64; 2]>,
}

/// Values that are counted in one colour.
pub struct Series {
    /// The colour's class in the style sheet.
    pub class: &'static str,
    pub values: Vec<f64>,
}

impl Histogram<'_> {
    /// Draws it; the series stand on each other.
    pub fn draw(&self, series: &[Series]) -> Markup {
        let values = series.iter().flat_map(|series| &series.values).copied();
        let values = values.chain(self.range.into_iter().flatten());
        let axis = Axis::holding(values, self.is_logarithmic);
        let counts: Vec<[usize; BINS]> = series
            .iter()
            .map(|series| counted(&axis, &series.values))
            .collect();
        let heights = (0..BINS).map(|bin| counts.iter().map(|counts| counts[bin]).sum::<usize>());
        let most = heights.max().unwrap_or(0).max(1) as f64;
        let count_axis = Axis::linear(0.0, most);
        let (wide, high) = (WIDTH - LEFT - RIGHT, HEIGHT - TOP - BOTTOM);
        let x = |share: f64| tenth(LEFT + share * wide);
        let y = |count: f64| tenth(TOP + high * (1.0 - count / most));
        html! {
            figure.plot {
                svg viewBox=(format!("0 0 {WIDTH} {HEIGHT}")) role="img"
                    aria-label=(self.description(series)) {
                    text.title x=(LEFT) y="15" { (self.title) }
                    @for (value, label) in count_axis.labels() {
                        @if value.fract() == 0.0 {
                            line.grid x1=(LEFT) x2=(WIDTH - RIGHT) y1=(y(value)) y2=(y(value)) {}
                            text x=(LEFT - 5.0) y=(y(value) + 3.5) text-anchor="end" { (label) }
                        }
                    }
                    @for (series, bars) in series.iter().zip(bars(&counts, &x, &y)) {
                        path class=(series.class) d=(bars) {}
                    }
                    line.axis x1=(LEFT) x2=(WIDTH - RIGHT) y1=(y(0.0)) y2=(y(0.0)) {}
                    @for (value, label) in axis.labels() {
                        @let at = x(axis.share(value));
                        line.axis x1=(at) x2=(at) y1=(y(0.0)) y2=(y(0.0) + 4.0) {}
                        text x=(at) y=(y(0.0) + 15.0) text-anchor="middle" { (label) }
                    }
                    text x=(x(0.5)) y=(HEIGHT - 6.0) text-anchor="middle" { (self.axis) }
                    text transform=(format!("translate(11 {}) rotate(-90)", TOP + high / 2.0))
                        text-anchor="middle" { "materials" }
                }
            }
        }
    }

    fn description(&self, series: &[Series]) -> String {
        let counts = series
            .iter()
            .map(|series| format!("{} {}", series.values.len(), series.class));
        let counts: Vec<String> = counts.collect();
        format!(
            "Histogram of {}: {} materials",
            self.axis,
            counts.join(", ")
        )
    }
}

/// Of each series its bars as one path: a rectangle for each bin, on those of the series before.
fn bars(counts: &[[usize; BINS]], x: &impl Fn(f64) -> f64, y: &impl Fn(f64) -> f64) -> Vec<String> {
    let mut below = [0; BINS];
    let draw = |counts: &[usize; BINS]| {
        let mut path = String::new();
        for (bin, (count, below)) in counts.iter().zip(&mut below).enumerate() {
            let upper = *below + count;
            if upper > *below {
                let [left, right] = [bin, bin + 1].map(|edge| x(edge as f64 / BINS as f64));
                let [top, bottom] = [upper, *below].map(|count| y(count as f64));
                let wide = tenth(right - left - 1.0);
                let bar = format!("M{left} {bottom}V{top}h{wide}V{bottom}z");
                path.push_str(&bar);
            }
            *below = upper;
        }
        path
    };
    counts.iter().map(draw).collect()
}

fn counted(axis: &Axis, values: &[f64]) -> [usize; BINS] {
    let mut counts = [0; BINS];
    for value in values {
        let bin = (axis.share(*value) * BINS as f64) as usize;
        counts[bin.min(BINS - 1)] += 1;
    }
    counts
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bars_stand_on_each_other() {
        let mut counts = [[0; BINS]; 2];
        (counts[0][0], counts[1][0], counts[1][23]) = (2, 1, 4);
        let paths = bars(&counts, &|share| tenth(24.0 * share), &|count| 10.0 - count);
        assert_eq!(paths[0], "M0 10V8h0V10z");
        assert_eq!(paths[1], "M0 8V7h0V8zM23 10V6h0V10z");
    }

    #[test]
    fn every_value_is_in_a_bar() {
        let axis = Axis::holding([0.0, 24.0], false);
        let values: Vec<f64> = (0..=24).map(f64::from).collect();
        let counts = counted(&axis, &values);
        assert_eq!(counts.iter().sum::<usize>(), 25);
        assert_eq!((counts[0], counts[23]), (1, 2));
    }
}
