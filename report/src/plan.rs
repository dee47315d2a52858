//! What is rendered: materials, views and a ladder of settings for each integrator.

use crate::comparison::RELATIVE_FLOOR;
use dataset::{
    HARD_CASES, Material, Specification,
    specification::{Accuracy, IntegratorKind},
};

/// Relative accuracies asked of the hybrid integrator; the absolute one is [`RELATIVE_FLOOR`] of it.
pub const HYBRID_LADDER: [f64; 5] = [1e-1, 1e-2, 1e-3, 1e-4, 1e-5];

/// Relative accuracies at which square, sphere and mesh are compared.
pub const SHAPE_LADDER: [f64; 4] = [1e-1, 3e-2, 1e-2, 3e-3];

/// The views in which they are compared: one with the chart, one without.
pub const SHAPE_VIEWS: [u32; 2] = [5, 9];

/// Samples a pixel of the path tracer.
pub const PATH_LADDER: [u32; 5] = [16, 64, 256, 1024, 4096];

/// The relative accuracy asked of the reference.
pub const REFERENCE_RELATIVE: f64 = 1e-6;

/// Materials of the preset's sequence beside the hard cases.
pub const SET_MATERIALS: u32 = 4;

/// The film's side in pixels.
pub const SIZE_PIXELS: u32 = 64;

/// A material with a name for tables.
#[derive(Clone, Debug, PartialEq)]
pub struct NamedMaterial {
    /// A hard case's, or the set's name and the material's index.
    pub name: String,
    /// What makes it hard; empty for a material of the set.
    pub reason: &'static str,
    /// Its ten numbers.
    pub material: Material,
}

impl NamedMaterial {
    /// Every hard case.
    pub fn hard() -> impl Iterator<Item = Self> {
        HARD_CASES.iter().map(|case| Self {
            name: case.name.to_owned(),
            reason: case.reason,
            material: case.material,
        })
    }

    /// Material `index` of the preset's sequence.
    pub fn of_the_set(index: u32) -> Self {
        let preset = Specification::preset();
        Self {
            name: format!("{}-{index}", preset.name),
            reason: "",
            material: preset.material(index).material,
        }
    }

    /// Whether it is a hard case.
    pub fn is_hard(&self) -> bool {
        !self.reason.is_empty()
    }
}

/// How much a rendering is to spend.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Setting {
    /// Of the hybrid integrator: the relative accuracy.
    Accuracy(f64),
    /// Of the path tracer: samples a pixel.
    Samples(u32),
}

impl Setting {
    /// Whose setting it is.
    pub fn integrator(self) -> IntegratorKind {
        match self {
            Self::Accuracy(_) => IntegratorKind::Hybrid,
            Self::Samples(_) => IntegratorKind::Path,
        }
    }

    /// The number on the ladder.
    pub fn value(self) -> f64 {
        match self {
            Self::Accuracy(relative) => relative,
            Self::Samples(samples) => f64::from(samples),
        }
    }

    /// The preset on a film of `size_pixels` squared, with this setting.
    pub fn specification(self, size_pixels: u32) -> Specification {
        let mut specification = Specification::preset();
        specification.image.width = size_pixels;
        specification.image.height = size_pixels;
        specification.integrator.kind = self.integrator();
        match self {
            Self::Accuracy(relative) => {
                specification.accuracy = Accuracy {
                    relative,
                    absolute: RELATIVE_FLOOR * relative,
                }
            }
            Self::Samples(samples) => specification.integrator.samples_per_pixel = samples,
        }
        specification
    }
}

/// The integrator's name in tables.
pub fn integrator_name(kind: IntegratorKind) -> &'static str {
    match kind {
        IntegratorKind::Hybrid => "hybrid",
        IntegratorKind::Path => "path",
    }
}

/// What a report is made of.
#[derive(Clone, Debug, PartialEq)]
pub struct Plan {
    /// The materials, in the order of the tables.
    pub materials: Vec<NamedMaterial>,
    /// Views of the preset.
    pub views: Vec<u32>,
    /// The film's side in pixels.
    pub size_pixels: u32,
    /// The settings, each integrator's from cheap to dear.
    pub settings: Vec<Setting>,
    /// The relative accuracy asked of the reference.
    pub reference_relative: f64,
    /// Relative accuracies at which square, sphere and mesh are compared.
    pub shape_accuracies: Vec<f64>,
    /// Views rendered at a time, each on a thread of its own.
    pub threads: usize,
}

impl Plan {
    /// Every hard case and the first materials of the set, in all views, at every setting.
    pub fn full(threads: usize) -> Self {
        Self {
            materials: NamedMaterial::hard()
                .chain((0..SET_MATERIALS).map(NamedMaterial::of_the_set))
                .collect(),
            views: (0..Specification::preset().views.len() as u32).collect(),
            size_pixels: SIZE_PIXELS,
            settings: HYBRID_LADDER
                .map(Setting::Accuracy)
                .into_iter()
                .chain(PATH_LADDER.map(Setting::Samples))
                .collect(),
            reference_relative: REFERENCE_RELATIVE,
            shape_accuracies: SHAPE_LADDER.to_vec(),
            threads,
        }
    }

    /// How many renderings the comparison of shapes takes: three shapes, each with its reference.
    pub(crate) fn shape_renderings(&self) -> usize {
        match self.shape_accuracies.len() {
            0 => 0,
            accuracies => 3 * SHAPE_VIEWS.len() * (accuracies + 1),
        }
    }

    /// How many renderings it takes, references included.
    pub fn renderings(&self) -> u64 {
        let cells = self.materials.len() * self.views.len();
        (cells * (self.settings.len() + 1) + self.shape_renderings()) as u64
    }
}
