//! Which values a specification may have, each by itself and together.

use super::{
    Checker, Light, Pixel, Shape, Specification,
    canonical::number_text,
    fault::Fault,
    keys::{Key, Rule, float_rule, keys, name_rule, power_of_two_rule, range_rule},
    limits,
};
use crate::view::{camera_position, light_position, sin_cos_deg};
use std::ops::RangeInclusive;

/// Checks everything. Each value is in range by itself before any are checked together.
pub(super) fn check(specification: &Specification) -> Result<(), Fault> {
    check_values(specification)?;
    check_views(specification)?;
    check_ranges(specification)?;
    check_chart(specification)?;
    check_half(specification)?;
    check_mesh(specification)?;
    check_scene(specification)
}

/// The rules for values together, in the order in which they are checked: a sentence each.
pub fn rules_together() -> [String; 8] {
    let half_max = limits::HALF_RADIANCE_MAX;
    let half_rule = format!(
        "With `image.pixel = \"half\"` the bulb's own radiance, `(light.distance_m / \
         light.radius_m)^2` times white, is at most {half_max}."
    );
    [
        "The lower end of each range in `[parameters]` is not above its upper end.".to_owned(),
        "`checker.patches_srgb8` has `checker.columns * checker.rows` colours.".to_owned(),
        half_rule,
        "`sample.mesh` is there if `sample.shape` is `\"mesh\"`, and only then.".to_owned(),
        "In every view the bulb is clear of the plane of the sample.".to_owned(),
        "In no view is the camera inside the bulb.".to_owned(),
        "With the colour chart in a view, `checker.lower_edge_y_m` is at least half of \
         `sample.side_m`, so the chart does not cut the sample."
            .to_owned(),
        "With the colour chart in a view, the whole bulb is in front of the plane of the chart, so \
         the chart does not shade the sample."
            .to_owned(),
    ]
}

fn float(key: &str, value: f64, range: &RangeInclusive<f64>) -> Result<(), Fault> {
    // Neither infinities nor NaN are contained.
    if range.contains(&value) {
        return Ok(());
    }
    Err(Fault::of_value(key, value, float_rule(range)))
}

fn integer(key: &str, value: u64, range: &RangeInclusive<u64>) -> Result<(), Fault> {
    if range.contains(&value) {
        return Ok(());
    }
    Err(Fault::of_value(key, value, range_rule(range)))
}

fn power_of_two(key: &str, value: u32, range: &RangeInclusive<u32>) -> Result<(), Fault> {
    if value.is_power_of_two() && range.contains(&value) {
        return Ok(());
    }
    Err(Fault::of_value(key, value, power_of_two_rule(range)))
}

/// A key as an error names it.
fn full_name(key: &Key) -> String {
    match key.table {
        "" => key.name.to_owned(),
        table => format!("{table}.{}", key.name),
    }
}

/// Everything but the views and the ranges of the parameters.
fn check_values(specification: &Specification) -> Result<(), Fault> {
    for key in keys() {
        let name = full_name(key);
        match &key.rule {
            Rule::Name(value) => check_name(&name, value(specification))?,
            Rule::Integer(value, range) => integer(&name, value(specification), range)?,
            Rule::PowerOfTwo(value, range) => power_of_two(&name, value(specification), range)?,
            Rule::Float(value, range) => float(&name, value(specification), range)?,
            // Others check these, or the type allows nothing else.
            Rule::Ends(..) | Rule::OfView(..) => {}
            Rule::Choice(_) | Rule::TruthOfView | Rule::Colours | Rule::Mesh => {}
        }
    }
    Ok(())
}

/// A name stands in file names, so it is plain.
fn check_name(key: &str, name: &str) -> Result<(), Fault> {
    let plain = |c: char| c.is_ascii_alphanumeric() || "-_.".contains(c);
    let starts_well = name.starts_with(|c: char| c.is_ascii_alphanumeric());
    if starts_well && limits::NAME_CHARACTERS.contains(&name.len()) && name.chars().all(plain) {
        return Ok(());
    }
    Err(Fault::of_value(key, format!("{name:?}"), name_rule()))
}

fn check_views(specification: &Specification) -> Result<(), Fault> {
    let count = specification.views.len();
    if !limits::VIEWS.contains(&count) {
        let (low, high) = limits::VIEWS.into_inner();
        let rule = format!("has {count} entries, but must have {low} to {high}");
        return Err(Fault::of_keys(["views".to_owned()], rule));
    }
    for (place, view) in specification.views.iter().enumerate() {
        for key in keys() {
            if let Rule::OfView(value, range) = &key.rule {
                let name = format!("views[{place}].{}", key.name);
                float(&name, value(view), range)?;
            }
        }
    }
    Ok(())
}

fn check_ranges(specification: &Specification) -> Result<(), Fault> {
    for key in keys() {
        let Rule::Ends(ends, range) = &key.rule else {
            continue;
        };
        let name = full_name(key);
        let [low, high] = ends(specification);
        float(&format!("{name}[0]"), low, range)?;
        float(&format!("{name}[1]"), high, range)?;
        if low > high {
            let rule = format!(
                "runs from {} down to {}, but the lower end must come first",
                number_text(low),
                number_text(high)
            );
            return Err(Fault::of_keys([name], rule));
        }
    }
    Ok(())
}

/// The chart has a colour for every patch.
fn check_chart(specification: &Specification) -> Result<(), Fault> {
    let Checker {
        columns,
        rows,
        patches_srgb8,
        ..
    } = &specification.checker;
    let count = patches_srgb8.len();
    if count == (columns * rows) as usize {
        return Ok(());
    }
    Err(Fault::of_keys(
        ["patches_srgb8", "columns", "rows"].map(|field| format!("checker.{field}")),
        format!(
            "must have {} colours, for {columns} columns of {rows} rows, but has {count}",
            columns * rows
        ),
    ))
}

/// No pixel is brighter than the bulb itself, whose radiance is (D / r)^2 of white.
fn check_half(specification: &Specification) -> Result<(), Fault> {
    let Light {
        distance_m,
        radius_m,
        ..
    } = specification.light;
    let ratio = distance_m / radius_m;
    let max = limits::HALF_RADIANCE_MAX;
    if specification.image.pixel == Pixel::Float || ratio * ratio <= max {
        return Ok(());
    }
    let rule = format!(
        "is so small that the bulb, (distance_m / radius_m)^2 = {} times white, is brighter than \
         a half float holds ({max}); make it larger or set image.pixel to \"float\"",
        number_text((ratio * ratio).round()),
    );
    let keys = ["light.radius_m", "light.distance_m", "image.pixel"];
    Err(Fault::of_keys(keys.map(str::to_owned), rule))
}

/// A mesh is there if the sample is one.
fn check_mesh(specification: &Specification) -> Result<(), Fault> {
    let sample = &specification.sample;
    let keys = ["mesh", "shape"].map(|field| format!("sample.{field}"));
    match (&sample.mesh, sample.shape) {
        (Some(_), Shape::Mesh) => Ok(()),
        (None, Shape::Mesh) => {
            let rule = "is missing: name the mesh's file, an OBJ or PLY file in the folder of the \
                        specification";
            Err(Fault::of_keys(keys, rule.to_owned()))
        }
        (None, _) => Ok(()),
        (Some(_), shape) => {
            let rule = format!(
                "names a mesh, but sample.shape is \"{shape}\": set it to \"mesh\" or leave the mesh out"
            );
            Err(Fault::of_keys(keys, rule))
        }
    }
}

/// What stands in the scene of each view does not touch, and the chart shades nothing.
fn check_scene(specification: &Specification) -> Result<(), Fault> {
    let (camera, light) = (&specification.camera, &specification.light);
    for (place, view) in specification.views.iter().enumerate() {
        let view_key = |field: &str| format!("views[{place}].{field}");
        let bulb = light_position(light.distance_m, view.light_elevation_deg);
        let light_keys = [
            view_key("light_elevation_deg"),
            "light.radius_m".to_owned(),
            "light.distance_m".to_owned(),
        ];
        if bulb[2] <= light.radius_m {
            let rule = format!(
                "puts the bulb's centre {} m above the sample's plane, but its radius is {} m; the \
                 bulb must be clear of the plane",
                number_text(bulb[2]),
                number_text(light.radius_m),
            );
            return Err(Fault::of_keys(light_keys, rule));
        }
        let eye = camera_position(camera.distance_m, view.camera_elevation_deg);
        if distance(eye, bulb) <= light.radius_m {
            let [light_elevation, radius, light_distance] = light_keys;
            let keys = [
                view_key("camera_elevation_deg"),
                light_elevation,
                "camera.distance_m".to_owned(),
                radius,
                light_distance,
            ];
            let rule = "puts the camera inside the bulb; move one of them".to_owned();
            return Err(Fault::of_keys(keys, rule));
        }
        if view.checker {
            let checker_key = view_key("checker");
            check_chart_stands_clear(specification, checker_key.clone())?;
            check_chart_faces_bulb(specification, bulb, checker_key, light_keys)?;
        }
    }
    Ok(())
}

fn distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    let [x, y, z]: [f64; 3] = std::array::from_fn(|axis| a[axis] - b[axis]);
    (x * x + y * y + z * z).sqrt()
}

fn check_chart_stands_clear(
    specification: &Specification,
    checker_key: String,
) -> Result<(), Fault> {
    let half_side_m = specification.sample.side_m / 2.0;
    let edge_y_m = specification.checker.lower_edge_y_m;
    if edge_y_m >= half_side_m {
        return Ok(());
    }
    let keys = [
        "checker.lower_edge_y_m".to_owned(),
        "sample.side_m".to_owned(),
        checker_key,
    ];
    let rule = format!(
        "is {}, but must be at least half the sample's side, {}, or the chart cuts the sample",
        number_text(edge_y_m),
        number_text(half_side_m),
    );
    Err(Fault::of_keys(keys, rule))
}

/// The whole bulb stands in front of the chart's plane. The sample does too, so nothing between
/// them crosses it: the chart never shades the sample, and the bulb lights all of the chart.
fn check_chart_faces_bulb(
    specification: &Specification,
    bulb: [f64; 3],
    checker_key: String,
    [light_elevation, radius, distance]: [String; 3],
) -> Result<(), Fault> {
    let checker = &specification.checker;
    let (sine, cosine) = sin_cos_deg(checker.tilt_deg);
    let in_front_m = sine * (checker.lower_edge_y_m - bulb[1]) + cosine * bulb[2];
    if in_front_m > specification.light.radius_m {
        return Ok(());
    }
    let keys = [
        checker_key,
        light_elevation,
        "checker.tilt_deg".to_owned(),
        radius,
        distance,
    ];
    let rule = "puts the bulb on or behind the plane of the chart, which would shade the sample; \
                raise the light, lower checker.tilt_deg or leave the chart out"
        .to_owned();
    Err(Fault::of_keys(keys, rule))
}
