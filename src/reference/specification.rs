//! The page of the specification.

use super::markdown::{head, table};
use dataset::Specification;
use dataset::specification::{Key, keys, limits, rules_together};

const INTRODUCTION: &str = "\
A specification is a TOML file that decides a dataset. A file names only what differs from the preset; \
a key that is absent keeps the default. Unknown keys, values of another type and values out of range are \
refused, with the line and the column. An integer is accepted where a number is meant. Both ends of a \
range are allowed.

`brdfarm dataset specification --spec FILE` prints the complete specification and its hash. Everything \
but `name` and `materials` is in the hash, because everything else changes an image or a label.

";

/// A table of the file: its heading, and what it is about.
const TABLES: [(&str, &str); 10] = [
    ("", ""),
    ("image", "The film."),
    (
        "accuracy",
        "The error allowed in a pixel: the larger of the two. [How accuracy is measured](../accuracy.md) \
         explains it.",
    ),
    ("integrator", "How light is computed."),
    (
        "parameters",
        "The ranges from which materials are sampled, half open at the upper end. Two equal ends fix a \
         parameter. The six colour channels are always sampled from 0 to 1, sRGB-encoded.",
    ),
    (
        "camera",
        "A pinhole camera on the side of -y. It looks at the origin.",
    ),
    (
        "light",
        "A spherical bulb on the side of +y, uniform and white.",
    ),
    ("sample", "The flat sample of the material."),
    (
        "checker",
        "The colour chart beyond the sample. It rises away from the sample, its centre line is x = 0, and \
         its back is black.",
    ),
    ("views", ""),
];

/// The page.
pub fn page() -> String {
    let mut page = head("The specification") + INTRODUCTION;
    page += &format!("A file has at most {} bytes.\n\n", limits::TEXT_BYTES_MAX);
    for (name, about) in TABLES {
        page += &section(name, about);
    }
    page += "## Values together\n\nThese rules hold between values:\n\n";
    for rule in rules_together() {
        page += &format!("- {rule}\n");
    }
    let preset = Specification::PRESET_TOML;
    page += "\n## The preset\n\nThis is the built-in specification, `dataset/src/maxbrdf.toml`, with the \
             reason for each choice.\n\n";
    page += &format!("```toml\n{preset}```\n");
    page
}

fn section(name: &str, about: &str) -> String {
    let title = match name {
        "" => "Top of the file".to_owned(),
        "views" => "`[[views]]`".to_owned(),
        name => format!("`[{name}]`"),
    };
    let about = match name {
        "" => String::new(),
        "views" => views(),
        _ => format!("{about}\n\n"),
    };
    let keys = keys().iter().filter(|key| key.table == name);
    let head = ["key", "type", "unit", "default", "allowed", "meaning"];
    format!("## {title}\n\n{about}{}\n", table(head, keys.map(row)))
}

fn views() -> String {
    let (low, high) = limits::VIEWS.into_inner();
    format!(
        "A table for each view of a material, {low} to {high} of them. If a file has any, they replace all \
         views of the preset. The defaults below are those of a key that such a table leaves out.\n\n"
    )
}

fn row(key: &Key) -> [String; 6] {
    let default = key.default().map(|default| format!("`{default}`"));
    [
        format!("`{}`", key.name),
        key.form().to_owned(),
        key.unit.to_owned(),
        default.unwrap_or_else(|| match key.name {
            "mesh" => "none".to_owned(),
            _ => "[the preset's](#the-preset)".to_owned(),
        }),
        key.allowed(),
        key.meaning.to_owned(),
    ]
}
