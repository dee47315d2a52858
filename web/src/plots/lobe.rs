//! How a material reflects light that comes from 45 degrees, along its two axes.

use super::{axis::Axis, tenth};
use dataset::{Material, specification::Tint};
use maud::{Markup, html};
use renderer::{reflectance::Reflectance, vector::Vec3};
use std::fmt::Write;

const WIDTH: f64 = 480.0;
const HEIGHT: f64 = 280.0;
const LEFT: f64 = 58.0;
const RIGHT: f64 = 14.0;
const TOP: f64 = 30.0;
const BOTTOM: f64 = 44.0;

/// Where the light stands, degrees from the normal.
const LIGHT_DEG: f64 = 45.0;

/// Decades that are drawn below the largest value.
const DECADES: f64 = 6.0;

/// The curve's points: degrees from the normal, and the mean of the channels of f, a steradian.
type Curve = Vec<(f64, f64)>;

/// The plot: f over the direction of the camera, in the planes of the lobe's u and v axes.
pub fn plot(material: &Material, tint: Tint) -> Markup {
    let reflectance = Reflectance::new(material, 0.0, tint);
    let curves = [
        ("along", "along u", curve(&reflectance, [1.0, 0.0])),
        ("across", "along v", curve(&reflectance, [0.0, 1.0])),
    ];
    let values = curves.iter().flat_map(|(_, _, curve)| curve);
    let most = values
        .map(|(_, value)| *value)
        .fold(0.0, f64::max)
        .max(1e-12);
    let least = most * libm::exp10(-DECADES);
    let across = Axis::linear(-90.0, 90.0);
    let up = Axis::holding([least, most], true);
    let (wide, high) = (WIDTH - LEFT - RIGHT, HEIGHT - TOP - BOTTOM);
    let x = |degrees: f64| tenth(LEFT + wide * across.share(degrees));
    let y = |value: f64| tenth(TOP + high * (1.0 - up.share(value)));
    html! {
        figure.plot.lobe {
            svg viewBox=(format!("0 0 {WIDTH} {HEIGHT}")) role="img"
                aria-label="Reflectance over the direction of the camera, along both axes of the lobe" {
                text.title x=(LEFT) y="15" { "Light from 45°" }
                @for (index, (class, name, _)) in curves.iter().enumerate() {
                    @let at = WIDTH - RIGHT - 170.0 + 90.0 * index as f64;
                    line class=(class) x1=(at) x2=(at + 18.0) y1="11" y2="11" {}
                    text x=(at + 23.0) y="15" { (name) }
                }
                @for (value, label) in up.labels() {
                    line.grid x1=(LEFT) x2=(WIDTH - RIGHT) y1=(y(value)) y2=(y(value)) {}
                    text x=(LEFT - 6.0) y=(y(value) + 4.0) text-anchor="end" { (label) }
                }
                @for degrees in [-90.0, -45.0, 0.0, 45.0, 90.0] {
                    line.axis x1=(x(degrees)) x2=(x(degrees)) y1=(TOP + high) y2=(TOP + high + 4.0) {}
                    text x=(x(degrees)) y=(TOP + high + 16.0) text-anchor="middle" {
                        (crate::pages::numbers::significant(degrees)) "°"
                    }
                }
                line.axis x1=(LEFT) x2=(WIDTH - RIGHT) y1=(TOP + high) y2=(TOP + high) {}
                @for (class, _, curve) in &curves {
                    path class=(class) d=(path(curve, &x, &y)) {}
                }
                text x=(LEFT + wide / 2.0) y=(HEIGHT - 8.0) text-anchor="middle" {
                    "camera, degrees from the normal"
                }
                text transform=(format!("translate(13 {}) rotate(-90)", TOP + high / 2.0))
                    text-anchor="middle" { "f, 1/sr" }
            }
        }
    }
}

/// f in the plane of the normal and this direction of the lobe's frame. A narrow lobe gets points
/// close together about the mirrored direction, where it is.
fn curve(reflectance: &Reflectance, [u, v]: [f64; 2]) -> Curve {
    let direction = |degrees: f64| {
        let (sin, cos) = dataset::sin_cos_deg(degrees);
        let along = reflectance
            .lobe
            .to_surface(Vec3::new(u * sin, v * sin, 0.0));
        Vec3::new(along.x, along.y, cos)
    };
    let wi = direction(-LIGHT_DEG);
    let even = (-178..=178).map(|half| 0.5 * f64::from(half));
    // From a ten-thousandth of a degree to some degrees on either side.
    let close = (0..60).map(|step| libm::exp10(-4.0 + 5.0 * f64::from(step) / 59.0));
    let close = close.flat_map(|off| [LIGHT_DEG - off, LIGHT_DEG + off]);
    let mut degrees: Vec<f64> = even.chain(close).filter(|at| at.abs() < 90.0).collect();
    degrees.sort_by(f64::total_cmp);
    degrees
        .into_iter()
        .map(|degrees| {
            let f = reflectance.evaluate(wi, direction(degrees));
            (degrees, (f[0] + f[1] + f[2]) / 3.0)
        })
        .collect()
}

fn path(curve: &Curve, x: &impl Fn(f64) -> f64, y: &impl Fn(f64) -> f64) -> String {
    let mut path = String::new();
    for (degrees, value) in curve {
        let command = if path.is_empty() { 'M' } else { 'L' };
        if write!(path, "{command}{} {}", x(*degrees), y(*value)).is_err() {
            unreachable!("writing to a string does not fail");
        }
    }
    path
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_lobe_stands_at_the_mirrored_direction_and_is_wider_along_v() {
        let material = Material {
            roughness: 10.0,
            anisotropy: 0.8,
            angle_deg: 30.0,
            ior: 1.5,
            rgb0: [0.5; 3],
            rgb90: [1.0; 3],
        };
        let reflectance = Reflectance::new(&material, 0.0, Tint::Hue);
        let width = |axis: [f64; 2]| {
            let curve = curve(&reflectance, axis);
            let most = curve.iter().map(|(_, value)| *value).fold(0.0, f64::max);
            let peak = curve.iter().find(|(_, value)| *value == most).unwrap().0;
            let lit = curve.iter().filter(|(_, value)| *value > 0.5 * most);
            let lit: Vec<f64> = lit.map(|(degrees, _)| *degrees).collect();
            (peak, lit[lit.len() - 1] - lit[0])
        };
        let (peak, along_u) = width([1.0, 0.0]);
        assert!((peak - LIGHT_DEG).abs() < 1.0, "{peak}");
        let (_, along_v) = width([0.0, 1.0]);
        assert!(along_v > 3.0 * along_u, "{along_u} {along_v}");
    }
}
