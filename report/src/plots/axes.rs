//! Axes, and the frame that plots are drawn in.
//!
//! Logarithmic axes are linear ones over decimal logarithms, so that every line of the grid and
//! every label is ours.

use crate::ReportError;
use plotters::coord::Shift;
use plotters::coord::ranged1d::{DefaultFormatting, KeyPointHint};
use plotters::coord::types::RangedCoordf64;
use plotters::prelude::*;
use plotters::style::RGBColor;
use std::ops::Range;

/// Where plots are drawn.
pub type Chart<'a> = ChartContext<'a, SVGBackend<'a>, Cartesian2d<Scale, Scale>>;

/// A part of the picture, in pixels.
type Canvas<'a> = DrawingArea<SVGBackend<'a>, Shift>;

/// Why a mark could not be drawn.
pub type DrawError = DrawingAreaErrorKind<std::io::Error>;

/// Text, in the library's pixels: it writes four fifths of them.
const TEXT_PIXELS: u32 = 17;

/// Height of the legend.
const LEGEND_PIXELS: u32 = 34;

/// Decades of an axis beyond which the lines between them would be a grey wash.
const LIGHT_DECADES_MAX: i32 = 7;

const INK: RGBColor = RGBColor(0x22, 0x22, 0x22);
const GRID: RGBColor = RGBColor(0xd4, 0xd4, 0xd4);
const GRID_LIGHT: RGBColor = RGBColor(0xef, 0xef, 0xef);

/// One axis.
pub struct Axis {
    /// What it shows, with its unit.
    pub label: String,
    low: f64,
    high: f64,
    /// Places of labels.
    bold: Vec<f64>,
    /// Places of thin lines.
    light: Vec<f64>,
    format: Box<dyn Fn(f64) -> String>,
}

impl Axis {
    /// A logarithmic axis that holds `values`, in whole decades; those below `floor` stand at it.
    pub fn logarithmic(
        label: &str,
        floor: f64,
        values: impl IntoIterator<Item = f64>,
        format: fn(i32) -> String,
    ) -> Self {
        let logs = values
            .into_iter()
            .filter(|value| value.is_finite())
            .map(|value| decades_of(value.max(floor)));
        let [least, most] = logs.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], log| {
            [low.min(log), high.max(log)]
        });
        let [low, high] = if least <= most {
            let high = most.ceil().max(least.floor() + 1.0);
            [least.floor(), high]
        } else {
            [0.0, 1.0]
        };
        Self::decades(label, [low as i32, high as i32], format)
    }

    /// A logarithmic axis over these decades.
    pub fn decades(label: &str, [low, high]: [i32; 2], format: fn(i32) -> String) -> Self {
        let decades = if high - low <= LIGHT_DECADES_MAX {
            low..high
        } else {
            0..0
        };
        let light = decades
            .flat_map(|decade| {
                (2..10).map(move |step| f64::from(decade) + libm::log10(f64::from(step)))
            })
            .collect();
        Self {
            label: label.to_owned(),
            low: f64::from(low),
            high: f64::from(high),
            bold: (low..=high).map(f64::from).collect(),
            light,
            format: Box::new(move |log| format(log.round() as i32)),
        }
    }

    /// A linear axis from 0, with at most about six labels.
    pub fn linear(label: &str, high: f64, format: impl Fn(f64) -> String + 'static) -> Self {
        const LABELS: f64 = 6.0;
        let high = if high > 0.0 && high.is_finite() {
            high
        } else {
            1.0
        };
        let raw = high / LABELS;
        let decade = libm::pow(10.0, libm::log10(raw).floor());
        let step = [1.0, 2.0, 5.0, 10.0]
            .map(|factor| factor * decade)
            .into_iter()
            .find(|step| *step >= raw)
            .unwrap_or(10.0 * decade);
        let count = (high / step).ceil() as u32;
        Self {
            label: label.to_owned(),
            low: 0.0,
            high: step * f64::from(count),
            bold: (0..=count).map(|place| step * f64::from(place)).collect(),
            light: Vec::new(),
            format: Box::new(format),
        }
    }

    /// An axis with a name at each of the places 0, 1, ..., the first on top where it is vertical.
    pub fn names(label: &str, names: Vec<String>) -> Self {
        let count = names.len();
        Self {
            label: label.to_owned(),
            low: 0.4 - count as f64,
            high: 0.6,
            bold: (0..count).map(|place| -(place as f64)).collect(),
            light: Vec::new(),
            format: Box::new(move |place| {
                let name = names.get((-place).round() as usize);
                name.cloned().unwrap_or_default()
            }),
        }
    }

    /// The logarithm of a value, kept on the axis.
    pub fn log(&self, value: f64) -> f64 {
        if value > 0.0 {
            libm::log10(value).clamp(self.low, self.high)
        } else {
            self.low
        }
    }

    /// Both ends.
    pub fn ends(&self) -> [f64; 2] {
        [self.low, self.high]
    }

    fn scale(&self) -> Scale {
        Scale {
            range: RangedCoordf64::from(self.low..self.high),
            bold: self.bold.clone(),
            light: self.light.clone(),
        }
    }
}

/// The decimal logarithm, whole for powers of ten, whose rounding must not cost a decade.
fn decades_of(value: f64) -> f64 {
    const ROUNDING: f64 = 1e-9;
    let log = libm::log10(value);
    if (log - log.round()).abs() < ROUNDING {
        log.round()
    } else {
        log
    }
}

/// A linear coordinate with lines and labels at given places.
pub struct Scale {
    range: RangedCoordf64,
    bold: Vec<f64>,
    light: Vec<f64>,
}

impl Ranged for Scale {
    type FormatOption = DefaultFormatting;
    type ValueType = f64;

    fn map(&self, value: &f64, limit: (i32, i32)) -> i32 {
        self.range.map(value, limit)
    }

    fn key_points<Hint: KeyPointHint>(&self, hint: Hint) -> Vec<f64> {
        if hint.weight().allow_light_points() {
            self.light.clone()
        } else {
            self.bold.clone()
        }
    }

    fn range(&self) -> Range<f64> {
        self.range.range()
    }
}

/// 10 to a power, as people write it.
pub fn power_of_ten(decade: i32) -> String {
    const DIGITS: [char; 10] = ['⁰', '¹', '²', '³', '⁴', '⁵', '⁶', '⁷', '⁸', '⁹'];
    match decade {
        0 => "1".to_owned(),
        1 => "10".to_owned(),
        _ => {
            let sign = if decade < 0 { "⁻" } else { "" };
            let digits: String = decade
                .unsigned_abs()
                .to_string()
                .bytes()
                .map(|digit| DIGITS[usize::from(digit - b'0')])
                .collect();
            format!("10{sign}{digits}")
        }
    }
}

/// 10 to a power of seconds.
pub fn seconds(decade: i32) -> String {
    let (unit, rest) = match decade {
        0.. => ("s", decade),
        -3..0 => ("ms", decade + 3),
        _ => ("µs", decade + 6),
    };
    match rest {
        0..=3 => format!("{} {unit}", [1, 10, 100, 1000][rest as usize]),
        _ => format!("{} {unit}", power_of_ten(rest)),
    }
}

/// A legend's entry.
pub struct Entry {
    pub text: String,
    pub colour: RGBColor,
    pub mark: Mark,
}

/// How a series is marked, for those who see no colours too.
#[derive(Clone, Copy)]
pub enum Mark {
    Disc,
    Triangle,
    Line,
    Bar,
}

/// What a plot looks like around its data.
pub struct Frame<'a> {
    pub name: &'static str,
    pub size: (u32, u32),
    pub x: &'a Axis,
    pub y: &'a Axis,
    /// Pixels that the labels of y take.
    pub y_label_pixels: u32,
    /// The legend, in one line above the data.
    pub legend: Vec<Entry>,
}

/// Draws a plot, and returns it as SVG.
pub fn draw(
    frame: &Frame<'_>,
    marks: impl FnOnce(&mut Chart<'_>) -> Result<(), DrawError>,
) -> Result<String, ReportError> {
    let mut svg = String::new();
    paint(frame, &mut svg, marks).map_err(|error| ReportError::Plot {
        name: frame.name,
        reason: error.to_string(),
    })?;
    Ok(svg)
}

fn paint(
    frame: &Frame<'_>,
    svg: &mut String,
    marks: impl FnOnce(&mut Chart<'_>) -> Result<(), DrawError>,
) -> Result<(), DrawError> {
    let root = SVGBackend::with_string(svg, frame.size).into_drawing_area();
    root.fill(&WHITE)?;
    let mut chart = ChartBuilder::on(&root)
        .margin(8)
        .margin_right(22)
        .margin_top(LEGEND_PIXELS)
        .x_label_area_size(48)
        .y_label_area_size(frame.y_label_pixels)
        .build_cartesian_2d(frame.x.scale(), frame.y.scale())?;
    let text = ("sans-serif", TEXT_PIXELS).into_font().color(&INK);
    chart
        .configure_mesh()
        .bold_line_style(GRID)
        .light_line_style(GRID_LIGHT)
        .axis_style(INK)
        .label_style(text.clone())
        .axis_desc_style(text)
        .x_desc(&frame.x.label)
        .y_desc(&frame.y.label)
        .x_label_formatter(&|place| (frame.x.format)(*place))
        .y_label_formatter(&|place| (frame.y.format)(*place))
        .draw()?;
    marks(&mut chart)?;
    legend(&root, frame)?;
    root.present()
}

/// Draws the legend above the data, which it can never hide.
fn legend(root: &Canvas<'_>, frame: &Frame<'_>) -> Result<(), DrawError> {
    // How wide a text comes out only the reader's machine knows: letters of this size are about 8
    // pixels wide in any common face.
    const LETTER_PIXELS: i32 = 8;
    let mut left = frame.y_label_pixels as i32;
    for one in &frame.legend {
        entry(root, one, (left, LEGEND_PIXELS as i32 / 2))?;
        left += 46 + LETTER_PIXELS * one.text.chars().count() as i32;
    }
    Ok(())
}

/// Draws an entry whose left end and middle are at (left, y).
fn entry(area: &Canvas<'_>, entry: &Entry, (left, y): (i32, i32)) -> Result<(), DrawError> {
    let (x, colour) = (left + 16, entry.colour);
    match entry.mark {
        Mark::Disc => area.draw(&Circle::new((x, y), 5, colour.filled()))?,
        Mark::Triangle => area.draw(&TriangleMarker::new((x, y), 6, colour.filled()))?,
        Mark::Line => area.draw(&PathElement::new(
            [(x - 10, y), (x + 10, y)],
            colour.stroke_width(3),
        ))?,
        Mark::Bar => area.draw(&Rectangle::new(
            [(x - 8, y - 6), (x + 8, y + 6)],
            colour.filled(),
        ))?,
    }
    area.draw(&Text::new(
        entry.text.clone(),
        (left + 32, y - TEXT_PIXELS as i32 * 2 / 5),
        ("sans-serif", TEXT_PIXELS).into_font().color(&INK),
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn decades_and_times_read_as_people_write_them() {
        let powers = [-12, -3, 0, 1, 2].map(power_of_ten);
        assert_eq!(powers, ["10⁻¹²", "10⁻³", "1", "10", "10²"]);
        let times = [-7, -6, -4, -3, -1, 0, 2, 4].map(seconds);
        let expected = [
            "10⁻¹ µs",
            "1 µs",
            "100 µs",
            "1 ms",
            "100 ms",
            "1 s",
            "100 s",
            "10⁴ s",
        ];
        assert_eq!(times, expected);
    }

    #[test]
    fn axes_hold_their_values_and_nothing_holds_none() {
        let axis = Axis::logarithmic("", 1e-5, [3e-4, 0.0, f64::INFINITY, 20.0], power_of_ten);
        assert_eq!(axis.ends(), [-5.0, 2.0]);
        assert_eq!(axis.log(0.0), -5.0);
        assert_eq!(axis.log(1e9), 2.0);
        let axis = Axis::logarithmic("", 1e-5, [1.0], power_of_ten);
        assert_eq!(axis.ends(), [0.0, 1.0]);
        assert_eq!(
            Axis::logarithmic("", 1e-5, [], power_of_ten).ends(),
            [0.0, 1.0]
        );
        assert_eq!(Axis::linear("", 0.37, |_| String::new()).bold.len(), 5);
        assert_eq!(Axis::linear("", 0.0, |_| String::new()).ends()[0], 0.0);
    }
}
