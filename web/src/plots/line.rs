//! A value over another, as a line.

use super::{axis::Axis, tenth};
use maud::{Markup, html};
use std::fmt::Write;

const WIDTH: f64 = 480.0;
const HEIGHT: f64 = 200.0;
const LEFT: f64 = 52.0;
const RIGHT: f64 = 14.0;
const TOP: f64 = 12.0;
const BOTTOM: f64 = 42.0;

/// What a plot shows, with its units.
pub struct Line<'a> {
    pub description: &'a str,
    pub x_axis: &'a str,
    pub y_axis: &'a str,
}

/// A point of the line.
pub struct Point {
    pub x: f64,
    pub y: f64,
}

impl Line<'_> {
    /// Draws it; the upright axis begins at 0.
    pub fn draw(&self, points: &[Point]) -> Markup {
        let across = Axis::holding(points.iter().map(|point| point.x), false);
        let highest = points.iter().map(|point| point.y).fold(0.0, f64::max);
        let up = Axis::linear(0.0, if highest > 0.0 { 1.05 * highest } else { 1.0 });
        let (wide, high) = (WIDTH - LEFT - RIGHT, HEIGHT - TOP - BOTTOM);
        let x = |value: f64| tenth(LEFT + wide * across.share(value));
        let y = |value: f64| tenth(TOP + high * (1.0 - up.share(value)));
        let mut path = String::new();
        for point in points {
            let command = if path.is_empty() { 'M' } else { 'L' };
            if write!(path, "{command}{} {}", x(point.x), y(point.y)).is_err() {
                unreachable!("writing to a string does not fail");
            }
        }
        html! {
            figure.plot {
                svg viewBox=(format!("0 0 {WIDTH} {HEIGHT}")) role="img" aria-label=(self.description) {
                    @for (value, label) in up.labels() {
                        line.grid x1=(LEFT) x2=(WIDTH - RIGHT) y1=(y(value)) y2=(y(value)) {}
                        text x=(LEFT - 6.0) y=(y(value) + 4.0) text-anchor="end" { (label) }
                    }
                    @for (value, label) in across.labels() {
                        line.axis x1=(x(value)) x2=(x(value)) y1=(TOP + high) y2=(TOP + high + 4.0) {}
                        text x=(x(value)) y=(TOP + high + 16.0) text-anchor="middle" {
                            (label.trim_start_matches('−'))
                        }
                    }
                    line.axis x1=(LEFT) x2=(WIDTH - RIGHT) y1=(TOP + high) y2=(TOP + high) {}
                    path.along d=(path) {}
                    text x=(LEFT + wide / 2.0) y=(HEIGHT - 8.0) text-anchor="middle" { (self.x_axis) }
                    text transform=(format!("translate(12 {}) rotate(-90)", TOP + high / 2.0))
                        text-anchor="middle" { (self.y_axis) }
                }
            }
        }
    }
}
