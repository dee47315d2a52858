//! What the catalogue knows of one material.

use dataset::{Specification, Split};
use jobqueue::Completion;

/// How many numbers a material's labels are.
const LABELS: usize = 10;

/// What the catalogue knows of one completed material.
#[derive(Clone, Debug, PartialEq)]
pub struct Entry {
    /// The material's index.
    pub material: u32,
    /// Which split it is in.
    pub split: Split,
    /// Roughness, anisotropy, angle, index of refraction, colours at 0 and 90 degrees.
    pub labels: [f64; LABELS],
    /// Wall-clock time of rendering all views, seconds.
    pub seconds: f64,
    /// Of the views' mean stated errors the largest, in units of white.
    pub error: f64,
    /// Of the views' shares of pixels that miss the tolerance the largest.
    pub missed: f64,
    /// Mean over the views of the sample's mean brightness, in units of white; none where an earlier
    /// version recorded an image.
    pub brightness: Option<f64>,
    /// Bytes of all images.
    pub bytes: u64,
}

/// A number that materials are filtered and sorted by.
#[derive(Clone, Copy)]
pub struct Field {
    /// Its name in addresses.
    pub name: &'static str,
    /// What people read.
    pub label: &'static str,
    /// Its unit, where it has one.
    pub unit: &'static str,
    /// Whether it is a label of the material, and not measured.
    pub is_label: bool,
    /// What it is of a material.
    pub of: fn(&Entry) -> Option<f64>,
}

/// Every number that materials are filtered and sorted by.
pub const FIELDS: [Field; 15] = [
    label("material", "Material", "", |entry| {
        Some(f64::from(entry.material))
    }),
    label("roughness", "Roughness", "%", |entry| Some(entry.labels[0])),
    label("anisotropy", "Anisotropy", "", |entry| {
        Some(entry.labels[1])
    }),
    label("angle_deg", "Angle", "degrees", |entry| {
        Some(entry.labels[2])
    }),
    label("ior", "Index of refraction", "", |entry| {
        Some(entry.labels[3])
    }),
    label("r0", "Red at 0°", "linear", |entry| Some(entry.labels[4])),
    label("g0", "Green at 0°", "linear", |entry| {
        Some(entry.labels[5])
    }),
    label("b0", "Blue at 0°", "linear", |entry| Some(entry.labels[6])),
    label("r90", "Red at 90°", "linear", |entry| {
        Some(entry.labels[7])
    }),
    label("g90", "Green at 90°", "linear", |entry| {
        Some(entry.labels[8])
    }),
    label("b90", "Blue at 90°", "linear", |entry| {
        Some(entry.labels[9])
    }),
    measured("error", "Stated error", "of white", |entry| {
        Some(entry.error)
    }),
    measured("missed", "Pixels off tolerance", "share", |entry| {
        Some(entry.missed)
    }),
    measured("brightness", "Brightness", "of white", |entry| {
        entry.brightness
    }),
    measured("seconds", "Render time", "s", |entry| Some(entry.seconds)),
];

const fn label(
    name: &'static str,
    label: &'static str,
    unit: &'static str,
    of: fn(&Entry) -> Option<f64>,
) -> Field {
    Field {
        name,
        label,
        unit,
        is_label: true,
        of,
    }
}

const fn measured(
    name: &'static str,
    title: &'static str,
    unit: &'static str,
    of: fn(&Entry) -> Option<f64>,
) -> Field {
    Field {
        is_label: false,
        ..label(name, title, unit, of)
    }
}

impl Field {
    /// The label with its unit.
    pub fn title(&self) -> String {
        match self.unit {
            "" => self.label.to_owned(),
            unit => format!("{}, {unit}", self.label),
        }
    }
}

impl Entry {
    /// The labels that the specification gives a material.
    pub fn labels(specification: &Specification, material: u32) -> [f64; LABELS] {
        let material = specification.material(material).material;
        let [r0, g0, b0] = material.rgb0;
        let [r90, g90, b90] = material.rgb90;
        [
            material.roughness,
            material.anisotropy,
            material.angle_deg,
            material.ior,
            r0,
            g0,
            b0,
            r90,
            g90,
            b90,
        ]
    }

    /// Of a completion, with the labels that the specification gives the material.
    pub fn new(specification: &Specification, completion: &Completion) -> Self {
        let views = completion.views.iter();
        let largest = |of: fn(&dataset::ErrorStatistics) -> f64| {
            let views = completion.views.iter();
            views.map(|view| of(&view.statistics)).fold(0.0, f64::max)
        };
        let brightness: Option<f64> = views
            .map(|view| Some(view.pixels?.brightness_mean))
            .sum::<Option<f64>>();
        Self {
            material: completion.material,
            split: specification.split(completion.material),
            labels: Self::labels(specification, completion.material),
            seconds: completion.seconds,
            error: largest(|statistics| statistics.mean),
            missed: largest(|statistics| 1.0 - statistics.within_target),
            brightness: brightness.map(|sum| sum / completion.views.len().max(1) as f64),
            bytes: completion.bytes(),
        }
    }
}
