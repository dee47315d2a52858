//! Bounds of what a narrow lobe can send to the chart, from the geometry alone.
//!
//! Sample and chart are cut into boxes. For two boxes and a light, interval arithmetic gives
//! intervals for the half vector's components, and these a bound of the lobe over all pairs of
//! points in the boxes.

use super::frame::Frame;
use crate::hybrid::budget::interreflection::{BULB_BOXES, CHART_BOXES};
use crate::reflectance::Reflectance;
use crate::scene::ChartPlane;
use crate::vector::Vec3;
use std::f64::consts::{FRAC_1_PI, PI};

/// Below every sum of squares that does not vanish; keeps quotients defined.
const TINY: f64 = 1e-300;

/// What the sample can send to the chart, and what of the chart's light comes back to it.
#[derive(Clone, Copy, Debug)]
pub struct Bounds {
    /// Irradiance over pi by light that came from the bulb.
    pub order_1: f64,
    /// The largest factor from the chart's radiance to the irradiance over pi that it causes.
    pub transfer: f64,
}

/// Least and largest values.
type Interval = [f64; 2];

fn widest(a: Interval, b: Interval) -> Interval {
    [a[0].min(b[0]), a[1].max(b[1])]
}

fn sum(a: Interval, b: Interval) -> Interval {
    [a[0] + b[0], a[1] + b[1]]
}

fn difference(a: Interval, b: Interval) -> Interval {
    [a[0] - b[1], a[1] - b[0]]
}

fn square(a: Interval) -> Interval {
    let (first, second) = (a[0] * a[0], a[1] * a[1]);
    let least = if a[0] <= 0.0 && a[1] >= 0.0 {
        0.0
    } else {
        first.min(second)
    };
    [least, first.max(second)]
}

/// An axis-parallel box.
#[derive(Clone, Copy, Debug)]
struct Bound3([Interval; 3]);

impl Bound3 {
    fn of(points: impl Iterator<Item = Vec3>) -> Self {
        let empty = [f64::INFINITY, f64::NEG_INFINITY];
        Self(points.fold([empty; 3], |bound, Vec3 { x, y, z }| {
            let point = [x, y, z];
            std::array::from_fn(|axis| widest(bound[axis], [point[axis]; 2]))
        }))
    }

    /// The unit vectors from points of `from` to points of it, known to point up.
    fn direction_from(&self, from: &Self) -> [Interval; 3] {
        let offset: [Interval; 3] =
            std::array::from_fn(|axis| difference(self.0[axis], from.0[axis]));
        let squares = offset.map(square);
        let length = [0, 1].map(|end| squares.iter().map(|square| square[end]).sum::<f64>());
        let length = length.map(|length2| length2.max(TINY).sqrt());
        let unit = offset.map(|[low, high]| {
            let over = |value: f64, outward: bool| value / length[usize::from(!outward)];
            [
                over(low, low < 0.0).max(-1.0),
                over(high, high > 0.0).min(1.0),
            ]
        });
        let [x, y, [low, high]] = unit;
        [x, y, [low.max(0.0), high.max(0.0)]]
    }
}

/// The largest specular f cos_i for directions in these intervals and half vectors of at least this slope: tints
/// and cos_i / max(cos_i, cos_o) are at most 1.
fn specular_max(reflectance: &Reflectance, [wi, wo]: [[Interval; 3]; 2], least_slope: f64) -> f64 {
    let lobe = &reflectance.lobe;
    let [x, y, z]: [Interval; 3] = std::array::from_fn(|axis| sum(wi[axis], wo[axis]));
    let axis = lobe.to_surface(Vec3::new(1.0, 0.0, 0.0));
    let scaled = |factor: f64, [low, high]: Interval| widest([factor * low; 2], [factor * high; 2]);
    let u2 = square(sum(scaled(axis.x, x), scaled(axis.y, y)));
    let v2 = square(difference(scaled(axis.x, y), scaled(axis.y, x)));
    let z2 = square(z);
    let length2 = [x, y, z].map(|side| square(side)[0]).iter().sum::<f64>();
    // Squared slopes. The exponent rises with the one along u and falls with the one along v.
    let p2 = u2[0] / z2[1].max(TINY);
    let [q2_low, q2_high] = [v2[0] / z2[1].max(TINY), v2[1] / z2[0].max(TINY)];
    let exponent = if p2 + q2_high > 0.0 {
        (lobe.n_u * (p2 / q2_high) + lobe.n_v) / (p2 / q2_high + 1.0)
    } else {
        lobe.n_v
    };
    let exponent = if exponent.is_finite() {
        exponent
    } else {
        lobe.n_v
    };
    // The frame's axes may give the better bound of the squared slope, as x and y are known apart.
    let straight = (square(x)[0] + square(y)[0]) / z2[1].max(TINY);
    let slope2 = straight.max(p2 + q2_low).max(least_slope * least_slope);
    let power = libm::exp(-0.5 * exponent * libm::log1p(slope2));
    let scale = reflectance.specular_share * 0.25 * FRAC_1_PI * lobe.normalization;
    scale * power / length2.max(TINY).sqrt()
}

impl Bounds {
    /// The bounds for a material. The one of order 1 is worked out as far as it is not above `enough`.
    ///
    /// A sample that is Lambertian in part always sends light: its bounds are those of energy.
    pub fn new(frame: &Frame<'_>, reflectance: &Reflectance, enough: f64) -> Self {
        if reflectance.specular_share < 1.0 {
            return Self {
                order_1: f64::INFINITY,
                transfer: form_factor_max(&frame.chart.plane),
            };
        }
        Self {
            order_1: order_1(frame, reflectance, enough),
            transfer: transfer(frame, reflectance),
        }
    }
}

/// No point of the chart sees more of the sample than what lies below the horizon: as a share of
/// its hemisphere, weighted by the cosine.
pub fn form_factor_max(plane: &ChartPlane) -> f64 {
    0.5 * (1.0 - plane.z.z)
}

/// The least slope of a half vector between two directions to the chart, from wherever on the sample: 0 for a chart
/// that leans over the sample or begins over it.
///
/// Both directions go toward +y, each by at least this for a unit of height, and so does their sum. From the
/// sample's edge the chart stands steepest, at its lower or its upper end.
pub fn least_slope(plane: &ChartPlane, half: f64) -> f64 {
    let [_, height] = plane.size();
    let (beside, above) = (plane.corner.y - half, plane.corner.z);
    if beside < 0.0 || above < 0.0 {
        return 0.0;
    }
    let at_low = match (beside > 0.0, above > 0.0) {
        (_, true) => beside / above,
        (true, false) => f64::INFINITY,
        (false, false) => plane.y.y / plane.y.z,
    };
    let at_high = (beside + height * plane.y.y) / (above + height * plane.y.z);
    at_low.min(at_high).max(0.0)
}

/// Boxes of the sample, those next to the chart first: they send it most.
fn sample_boxes(half: f64, count: usize) -> Vec<Bound3> {
    let at = |step: usize| half * (2.0 * step as f64 / count as f64 - 1.0);
    let corner = |x: usize, y: usize| Vec3::new(at(x), at(y), 0.0);
    (0..count * count)
        .rev()
        .map(|index| {
            let (x, y) = (index % count, index / count);
            Bound3::of([corner(x, y), corner(x + 1, y + 1)].into_iter())
        })
        .collect()
}

/// Boxes of the chart, the lower ones flatter and last: they stand at the smallest angles.
fn chart_boxes(frame: &Frame<'_>, [across, up]: [usize; 2]) -> Vec<Bound3> {
    let bounds = frame.bounds();
    let at = |axis: usize, step: usize, count: usize| {
        let share = step as f64 / count as f64;
        bounds.low[axis] + share * (bounds.high[axis] - bounds.low[axis])
    };
    let corner = |x: usize, y: usize| frame.point([at(0, x, across), at(1, y, up)]);
    (0..across * up)
        .rev()
        .map(|index| {
            let (x, y) = (index % across, index / across);
            Bound3::of([corner(x, y), corner(x + 1, y + 1)].into_iter())
        })
        .collect()
}

fn order_1(frame: &Frame<'_>, reflectance: &Reflectance, enough: f64) -> f64 {
    let view = frame.view;
    let [along, across, up] = BULB_BOXES;
    let Vec3 { x, y, z } = view.bulb.centre;
    let radius = view.bulb.radius;
    let bulb = Bound3([x, y, z].map(|at| [at - radius, at + radius]));
    let charts = chart_boxes(frame, [across, up]);
    let from_sample = view.bulb.radiance * form_factor_max(&frame.chart.plane);
    let mut most = 0.0f64;
    for from in sample_boxes(view.sample_half, along) {
        let nearest = Bound3([x, y, z].map(|at| [at; 2]));
        let offset2: f64 = (0..3)
            .map(|axis| square(difference(nearest.0[axis], from.0[axis]))[0])
            .sum();
        let sin2 = (radius * radius / offset2.max(TINY)).min(1.0);
        let solid_angle = 2.0 * PI * sin2 / (1.0 + (1.0 - sin2).sqrt());
        let wi = bulb.direction_from(&from);
        for chart in &charts {
            let wo = chart.direction_from(&from);
            let specular = specular_max(reflectance, [wi, wo], 0.0);
            most = most.max(specular * solid_angle);
            if most * from_sample > enough {
                return f64::INFINITY;
            }
        }
    }
    most * from_sample
}

fn transfer(frame: &Frame<'_>, reflectance: &Reflectance) -> f64 {
    let [along, across, up] = CHART_BOXES;
    let charts = chart_boxes(frame, [across, up]);
    let least = least_slope(&frame.chart.plane, frame.view.sample_half);
    let mut most = 0.0f64;
    for from in sample_boxes(frame.view.sample_half, along) {
        let directions: Vec<_> = charts.iter().map(|to| to.direction_from(&from)).collect();
        for (index, wi) in directions.iter().enumerate() {
            // Either way round the half vector is the same.
            for wo in &directions[index..] {
                most = most.max(specular_max(reflectance, [*wi, *wo], least));
                // From the sample the chart fills at most a quarter of the sphere; and no more light leaves the sample
                // than arrives.
                if most * PI >= 1.0 {
                    return form_factor_max(&frame.chart.plane);
                }
            }
        }
    }
    most * PI * form_factor_max(&frame.chart.plane)
}
