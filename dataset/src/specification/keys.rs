//! Every key of a specification: what it means, its unit, and which values it may have.
//!
//! The table drives the check of a specification and the printed reference, so both give the same
//! ranges.

use super::{
    IntegratorKind, Pixel, Shape, Specification, Tint, View, canonical::number_text,
    fields::PLAIN_VIEW, limits,
};
use serde_json::Value;
use std::ops::RangeInclusive;

/// A key of a specification.
#[derive(Debug)]
pub struct Key {
    /// The table that the key is in, such as `image`; empty for the top of the file, and `views` for
    /// the keys of every view.
    pub table: &'static str,
    /// The key's own name.
    pub name: &'static str,
    /// The unit, `"1"` for pure numbers, empty for what is no quantity.
    pub unit: &'static str,
    /// One or two sentences.
    pub meaning: &'static str,
    pub(super) rule: Rule,
}

/// The type of a key, the values that it may have, and where a specification has its value.
#[derive(Debug)]
pub(super) enum Rule {
    /// A plain text that can stand in the name of a file.
    Name(fn(&Specification) -> &str),
    Integer(fn(&Specification) -> u64, RangeInclusive<u64>),
    PowerOfTwo(fn(&Specification) -> u32, RangeInclusive<u32>),
    Float(fn(&Specification) -> f64, RangeInclusive<f64>),
    /// The two ends of what is sampled, `[low, high]`.
    Ends(fn(&Specification) -> [f64; 2], RangeInclusive<f64>),
    /// One of a few names, which the type of the field already ensures.
    Choice(&'static str),
    /// A number of each view.
    OfView(fn(&View) -> f64, RangeInclusive<f64>),
    /// True or false in each view.
    TruthOfView,
    /// The name of a mesh's file, or its digest.
    Mesh,
    /// A list of 8-bit colours, as many as the chart has patches.
    Colours,
}

/// Every key, in the order of the preset's file.
pub fn keys() -> &'static [Key] {
    &KEYS
}

impl Key {
    /// The type of its values.
    pub fn form(&self) -> &'static str {
        match self.rule {
            Rule::Name(_) | Rule::Choice(_) | Rule::Mesh => "text",
            Rule::Integer(..) | Rule::PowerOfTwo(..) => "integer",
            Rule::Float(..) | Rule::OfView(..) => "number",
            Rule::Ends(..) => "two numbers, `[low, high]`",
            Rule::TruthOfView => "boolean",
            Rule::Colours => "list of colours, `[red, green, blue]`",
        }
    }

    /// The values that it may have, in the words of the error that refuses all others.
    pub fn allowed(&self) -> String {
        match &self.rule {
            Rule::Name(_) => name_rule(),
            Rule::Integer(_, range) => range_rule(range),
            Rule::PowerOfTwo(_, range) => power_of_two_rule(range),
            Rule::Float(_, range) | Rule::Ends(_, range) | Rule::OfView(_, range) => {
                float_rule(range)
            }
            Rule::Choice(names) => (*names).to_owned(),
            Rule::TruthOfView => "true or false".to_owned(),
            Rule::Colours => "0 to 255 each".to_owned(),
            Rule::Mesh => {
                "an OBJ or PLY file in the folder of the specification, or a digest".to_owned()
            }
        }
    }

    /// The value where a file says nothing, as TOML: the preset's, and for a key of a view that of
    /// a view's table. `None` for lists too long to repeat, and for a mesh, of which there is none.
    pub fn default(&self) -> Option<String> {
        let tree = match self.table {
            "views" => serde_json::to_value(PLAIN_VIEW).ok()?,
            "" => Specification::preset().tree(),
            table => Specification::preset().tree()[table].clone(),
        };
        let text = |value: &Value| match value {
            Value::Number(number) if number.is_f64() => number.as_f64().map(number_text),
            Value::Number(_) | Value::String(_) | Value::Bool(_) => Some(value.to_string()),
            _ => None,
        };
        match &tree[self.name] {
            Value::Array(values) => {
                let numbers: Option<Vec<_>> = values.iter().map(text).collect();
                numbers.map(|numbers| format!("[{}]", numbers.join(", ")))
            }
            value => text(value),
        }
    }
}

/// What a name must be.
pub(super) fn name_rule() -> String {
    let (low, high) = limits::NAME_CHARACTERS.into_inner();
    format!("{low} to {high} of the characters a-z A-Z 0-9 - _ . and start with a letter or digit")
}

/// What an integer must be.
pub(super) fn range_rule(range: &RangeInclusive<u64>) -> String {
    format!("{} to {}", range.start(), range.end())
}

/// What a power of two must be.
pub(super) fn power_of_two_rule(range: &RangeInclusive<u32>) -> String {
    format!("a power of two, {} to {}", range.start(), range.end())
}

/// What a number must be.
pub(super) fn float_rule(range: &RangeInclusive<f64>) -> String {
    let (low, high) = (number_text(*range.start()), number_text(*range.end()));
    format!("{low} to {high}")
}

/// Both ends of a range of small integers, as large ones.
const fn wide(range: RangeInclusive<u32>) -> RangeInclusive<u64> {
    RangeInclusive::new(*range.start() as u64, *range.end() as u64)
}

const fn key(
    table: &'static str,
    name: &'static str,
    unit: &'static str,
    rule: Rule,
    meaning: &'static str,
) -> Key {
    Key {
        table,
        name,
        unit,
        meaning,
        rule,
    }
}

static KEYS: [Key; 35] = [
    key(
        "",
        "name",
        "",
        Rule::Name(|s| &s.name),
        "The name of the dataset. It changes no image, so the hash leaves it out.",
    ),
    key(
        "",
        "seed",
        "",
        Rule::Integer(|s| s.seed, limits::SEED),
        "The number from which all materials, splits and light paths are drawn.",
    ),
    key(
        "",
        "materials",
        "",
        Rule::Integer(|s| s.materials.into(), wide(limits::MATERIALS)),
        "The number of materials. It changes no image, so the hash leaves it out, and a set can grow.",
    ),
    key(
        "",
        "tint",
        "",
        Rule::Choice(Tint::EXPECTED),
        "How Fresnel's reflectance and the two colours combine. `hue` gives Fresnel's luminance the \
         chromaticity of the material's colour. `product` multiplies both, as equation 2 of the \
         paper is printed.",
    ),
    key(
        "image",
        "width",
        "px",
        Rule::Integer(|s| s.image.width.into(), wide(limits::IMAGE_SIDE_PIXELS)),
        "Pixels in a row of the film.",
    ),
    key(
        "image",
        "height",
        "px",
        Rule::Integer(|s| s.image.height.into(), wide(limits::IMAGE_SIDE_PIXELS)),
        "Rows of the film.",
    ),
    key(
        "image",
        "pixel",
        "",
        Rule::Choice(Pixel::EXPECTED),
        "The type of the stored pixels: 16-bit or 32-bit floats.",
    ),
    key(
        "accuracy",
        "absolute",
        "white",
        Rule::Float(|s| s.accuracy.absolute, limits::ACCURACY_ABSOLUTE),
        "The error allowed in every pixel. A pixel may be off by this or by the relative error, \
         whichever is larger.",
    ),
    key(
        "accuracy",
        "relative",
        "1",
        Rule::Float(|s| s.accuracy.relative, limits::ACCURACY_RELATIVE),
        "The error allowed in a pixel, as a fraction of its largest channel. 0 leaves only the \
         absolute error.",
    ),
    key(
        "integrator",
        "kind",
        "",
        Rule::Choice(IntegratorKind::EXPECTED),
        "The integrator. `hybrid` computes light by cubature until the accuracy is met. `path` traces \
         light paths.",
    ),
    key(
        "integrator",
        "samples_per_pixel",
        "1",
        Rule::PowerOfTwo(
            |s| s.integrator.samples_per_pixel,
            limits::SAMPLES_PER_PIXEL,
        ),
        "Camera rays for each pixel, in the integrator `path`.",
    ),
    key(
        "integrator",
        "max_bounces",
        "1",
        Rule::Integer(|s| s.integrator.max_bounces.into(), wide(limits::BOUNCES)),
        "The largest number of surface hits along a light path.",
    ),
    key(
        "parameters",
        "roughness",
        "%",
        Rule::Ends(|s| s.parameters.roughness, limits::ROUGHNESS_PERCENT),
        "The range from which the roughness R is sampled.",
    ),
    key(
        "parameters",
        "anisotropy",
        "1",
        Rule::Ends(|s| s.parameters.anisotropy, limits::ANISOTROPY),
        "The range from which the anisotropy A is sampled.",
    ),
    key(
        "parameters",
        "angle_deg",
        "deg",
        Rule::Ends(|s| s.parameters.angle_deg, limits::ANGLE_DEG),
        "The range from which the angle psi of the anisotropy is sampled.",
    ),
    key(
        "parameters",
        "ior",
        "1",
        Rule::Ends(|s| s.parameters.ior, limits::IOR),
        "The range from which the index of refraction N_d is sampled.",
    ),
    key(
        "camera",
        "distance_m",
        "m",
        Rule::Float(|s| s.camera.distance_m, limits::DISTANCE_M),
        "The distance of the camera from the origin.",
    ),
    key(
        "camera",
        "film_half_width",
        "1",
        Rule::Float(|s| s.camera.film_half_width, limits::FILM_HALF_WIDTH),
        "Half the width of the film at unit distance: the tangent of half the horizontal field of view.",
    ),
    key(
        "light",
        "distance_m",
        "m",
        Rule::Float(|s| s.light.distance_m, limits::DISTANCE_M),
        "The distance of the bulb's centre from the origin.",
    ),
    key(
        "light",
        "radius_m",
        "m",
        Rule::Float(|s| s.light.radius_m, limits::LIGHT_RADIUS_M),
        "The radius of the bulb.",
    ),
    key(
        "light",
        "power_w",
        "W",
        Rule::Float(|s| s.light.power_w, limits::LIGHT_POWER_W),
        "The electrical power of the bulb. Pixels are in units of white, so it changes no pixel. Every \
         image file states the luminance of white, which follows from it.",
    ),
    key(
        "light",
        "efficacy_lm_per_w",
        "lm/W",
        Rule::Float(
            |s| s.light.efficacy_lm_per_w,
            limits::LIGHT_EFFICACY_LM_PER_W,
        ),
        "The luminous flux of the bulb for each watt.",
    ),
    key(
        "sample",
        "shape",
        "",
        Rule::Choice(Shape::EXPECTED),
        "The shape of the sample. `square` is flat, in the plane z = 0 with its centre at the origin. \
         `sphere` and `cylinder` touch the origin from below, the cylinder along the x axis. `mesh` is what \
         `sample.mesh` names. The path tracer renders all but the square.",
    ),
    key(
        "sample",
        "side_m",
        "m",
        Rule::Float(|s| s.sample.side_m, limits::SAMPLE_SIDE_M),
        "The side of the square, the diameter of the sphere or of the cylinder, and the length of the \
         cylinder. A mesh is scaled until the longest side of its box along the axes is this long.",
    ),
    key(
        "sample",
        "mesh",
        "",
        Rule::Mesh,
        "The mesh of the sample, with z up. The middle of its box's top is moved to the origin. The digest \
         of the file, BLAKE3 of its bytes, is part of the hash. By a digest, the file `DIGEST.mesh` in the \
         folder is meant.",
    ),
    key(
        "checker",
        "columns",
        "1",
        Rule::Integer(
            |s| s.checker.columns.into(),
            wide(limits::CHECKER_PATCHES_A_SIDE),
        ),
        "Patches of the colour chart along x.",
    ),
    key(
        "checker",
        "rows",
        "1",
        Rule::Integer(
            |s| s.checker.rows.into(),
            wide(limits::CHECKER_PATCHES_A_SIDE),
        ),
        "Patches of the colour chart from its lower to its upper edge.",
    ),
    key(
        "checker",
        "pitch_m",
        "m",
        Rule::Float(|s| s.checker.pitch_m, limits::CHECKER_PITCH_M),
        "The side of a patch.",
    ),
    key(
        "checker",
        "lower_edge_y_m",
        "m",
        Rule::Float(|s| s.checker.lower_edge_y_m, limits::CHECKER_LOWER_EDGE_Y_M),
        "The y coordinate of the chart's lower edge. The edge is in the plane of the sample.",
    ),
    key(
        "checker",
        "tilt_deg",
        "deg",
        Rule::Float(|s| s.checker.tilt_deg, limits::CHECKER_TILT_DEG),
        "The angle of the chart above the horizontal.",
    ),
    key(
        "checker",
        "patches_srgb8",
        "",
        Rule::Colours,
        "The colours of the patches, 8-bit sRGB: the far row first, each row from -x to +x. A list in \
         a file replaces the preset's list.",
    ),
    key(
        "views",
        "camera_elevation_deg",
        "deg",
        Rule::OfView(|v| v.camera_elevation_deg, limits::ELEVATION_DEG),
        "The elevation of the camera above the plane of the sample.",
    ),
    key(
        "views",
        "light_elevation_deg",
        "deg",
        Rule::OfView(|v| v.light_elevation_deg, limits::ELEVATION_DEG),
        "The elevation of the bulb above the plane of the sample.",
    ),
    key(
        "views",
        "rotation_deg",
        "deg",
        Rule::OfView(|v| v.rotation_deg, limits::ROTATION_DEG),
        "The angle by which the material is rotated about the normal, counter-clockwise. The square \
         itself stays where it is.",
    ),
    key(
        "views",
        "checker",
        "",
        Rule::TruthOfView,
        "Whether the colour chart is in the scene.",
    ),
];

#[cfg(test)]
mod tests {
    use super::*;
    use crate::specification::suggest::all_keys;

    #[test]
    fn every_key_of_a_specification_is_in_the_table_once() {
        let tables = [
            "image",
            "accuracy",
            "integrator",
            "parameters",
            "camera",
            "light",
        ];
        let tables = [&tables[..], &["sample", "checker", "views"]].concat();
        let mut expected = all_keys();
        expected.retain(|key| !tables.contains(&key.as_str()));
        let full = |key: &Key| match key.table {
            "" => key.name.to_owned(),
            "views" => format!("views[0].{}", key.name),
            table => format!("{table}.{}", key.name),
        };
        let mut found: Vec<_> = keys().iter().map(full).collect();
        expected.sort();
        found.sort();
        assert_eq!(found, expected);
    }

    #[test]
    fn every_meaning_is_a_sentence_and_only_the_patches_have_no_short_default() {
        for key in keys() {
            assert!(key.meaning.ends_with('.'), "{}", key.name);
            let has_none = ["patches_srgb8", "mesh"].contains(&key.name);
            assert_eq!(key.default().is_none(), has_none);
        }
    }

    #[test]
    fn defaults_are_written_as_toml() {
        let default = |table: &str, name: &str| {
            let mut all = keys().iter();
            let key = all.find(|key| key.table == table && key.name == name);
            key.and_then(Key::default)
        };
        assert_eq!(default("", "tint").as_deref(), Some("\"hue\""));
        assert_eq!(default("image", "width").as_deref(), Some("128"));
        assert_eq!(default("parameters", "ior").as_deref(), Some("[1, 10]"));
        assert_eq!(default("views", "checker").as_deref(), Some("false"));
    }
}
