//! The specification: everything that decides a dataset, as TOML.
//!
//! Fields, defaults and units stand in `maxbrdf.toml`, the built-in preset; a file names only what
//! differs from it. Lengths are in metres, angles in degrees, powers in watts.

mod canonical;
mod check;
mod differences;
mod error;
mod fault;
mod fields;
mod keys;
pub mod limits;
mod read;
mod reader;
mod sample_mesh;
mod suggest;

pub use check::rules_together;
pub use differences::Differences;
pub use error::{Place, SpecificationError};
pub use keys::{Key, keys};
pub use sample_mesh::{LoadedMesh, SampleMesh};

use serde::{Deserialize, Serialize};
use std::{path::Path, sync::Arc};

/// A complete, checked dataset specification: [`Specification::preset`],
/// [`Specification::from_toml`], [`Specification::load`] and [`Specification::from_json`] give only
/// values that are in range. Plain deserialisation and changes of fields check nothing.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Specification {
    /// What the set is called: 1 to 64 of `a-z A-Z 0-9 - _ .`, starting with a letter or digit.
    pub name: String,
    /// Seeds parameters, splits and light-path sampling. At most 2^63 - 1, TOML's largest integer.
    pub seed: u64,
    /// How many materials the set has; the first n do not depend on it.
    pub materials: u32,
    /// How Fresnel's luminance and the reflectance's colour combine.
    pub tint: Tint,
    /// The film.
    pub image: Image,
    /// The error allowed in a pixel.
    pub accuracy: Accuracy,
    /// How light paths are summed.
    pub integrator: Integrator,
    /// The box that materials are sampled from.
    pub parameters: Parameters,
    /// Where the cameras stand.
    pub camera: Camera,
    /// The bulb.
    pub light: Light,
    /// The sample of the material.
    pub sample: Sample,
    /// The colour chart.
    pub checker: Checker,
    /// The views of every material, in order.
    pub views: Vec<View>,
}

impl Specification {
    /// The luminance in cd/m^2 of a pixel of value 1: that of a white diffuser at the origin which
    /// faces the bulb.
    pub fn white_luminance(&self) -> f64 {
        let light = &self.light;
        let flux_lm = light.power_w * light.efficacy_lm_per_w;
        let sphere_m2 = 4.0 * std::f64::consts::PI * light.distance_m * light.distance_m;
        flux_lm / sphere_m2 / std::f64::consts::PI
    }

    /// The same with the mesh that it names loaded from the bytes of the mesh's file.
    ///
    /// # Errors
    /// Where it names none, or another, or the bytes are no mesh.
    pub fn with_mesh(mut self, bytes: Vec<u8>) -> Result<Self, SpecificationError> {
        self.sample.mesh = Some(sample_mesh::with_bytes(self.sample.mesh.as_ref(), bytes)?);
        Ok(self)
    }

    /// The same with the mesh that it names loaded as in another specification, where that has the same one.
    pub fn with_mesh_of(mut self, other: &Self) -> Self {
        if self.sample.mesh == other.sample.mesh {
            self.sample.mesh.clone_from(&other.sample.mesh);
        }
        self
    }

    /// The same with the mesh that it names loaded from the file DIGEST.mesh of a folder. A specification
    /// without a mesh stays as it is.
    ///
    /// # Errors
    /// Where the file is not there, cannot be read, is too large, or holds another mesh or none.
    pub fn with_mesh_in(mut self, folder: &Path) -> Result<Self, SpecificationError> {
        if let Some(named) = &self.sample.mesh {
            self.sample.mesh = Some(sample_mesh::load_in(folder, named)?);
        }
        Ok(self)
    }
}

/// How the tint of a reflection is formed from Fresnel's reflectance and the two colours.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Tint {
    /// Fresnel's luminance with the chromaticity of the reflectance colour (Maxwell's Force Fresnel).
    Hue,
    /// The product of both, equation 2 of the paper as printed.
    Product,
}

/// The film's size in pixels and the type of its pixels.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Image {
    /// Pixels a row, 1 to 4,096.
    pub width: u32,
    /// Rows, 1 to 4,096.
    pub height: u32,
    /// The type that pixels are stored in.
    pub pixel: Pixel,
}

/// The type that pixels are stored in.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Pixel {
    /// 16-bit floats.
    Half,
    /// 32-bit floats.
    Float,
}

impl Pixel {
    /// Bytes of one channel of one pixel.
    pub fn bytes(self) -> u64 {
        match self {
            Self::Half => 2,
            Self::Float => 4,
        }
    }
}

/// The error allowed in a pixel: the larger of both bounds.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Accuracy {
    /// In units of white.
    pub absolute: f64,
    /// As a fraction of the pixel's largest channel.
    pub relative: f64,
}

/// How light paths are summed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Integrator {
    /// Which method.
    pub kind: IntegratorKind,
    /// Camera rays a pixel of the path tracer: a power of two, 16 to 1,048,576.
    pub samples_per_pixel: u32,
    /// The most surface hits along a path, 1 to 16.
    pub max_bounces: u32,
}

/// The methods of summing light paths.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum IntegratorKind {
    /// Cubature of everything that can be worked out, to the specification's accuracy; views that
    /// cannot go to the path tracer.
    Hybrid,
    /// Path tracing with next-event estimation and multiple importance sampling.
    Path,
}

/// Ranges of the sampled parameters, each `[low, high)`; `low == high` fixes one. The six colour
/// channels are always sampled over sRGB-encoded 0 to 1.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Parameters {
    /// Roughness in percent, within 0 to 100.
    pub roughness: [f64; 2],
    /// Anisotropy, within 0 to 1.
    pub anisotropy: [f64; 2],
    /// Anisotropy angle in degrees, within 0 to 180.
    pub angle_deg: [f64; 2],
    /// Index of refraction, within 1 to 10.
    pub ior: [f64; 2],
}

/// A pinhole camera on the -y side that looks at the origin; up is +z, or +y from straight above.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Camera {
    /// From the origin.
    pub distance_m: f64,
    /// Half the film's width at unit distance: the tangent of half the horizontal field of view.
    pub film_half_width: f64,
}

/// A spherical bulb on the +y side, uniform and white.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Light {
    /// From the origin to the bulb's centre.
    pub distance_m: f64,
    /// The bulb's radius.
    pub radius_m: f64,
    /// Electrical power.
    pub power_w: f64,
    /// Luminous flux for each watt.
    pub efficacy_lm_per_w: f64,
}

/// The sample: a square in z = 0, centred at the origin, or another surface below z = 0 that touches it.
/// Where sphere and cylinder touch the origin their normal is +z.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Sample {
    /// Square, sphere, cylinder or mesh. A square is not written, so that specifications from before there
    /// were others keep their hashes.
    #[serde(default, skip_serializing_if = "Shape::is_square")]
    pub shape: Shape,
    /// The square's side, the diameter of sphere and cylinder, the cylinder's length, and the longest side
    /// of a mesh's box.
    pub side_m: f64,
    /// The mesh, of a sample that is one. It is written as its digest.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mesh: Option<SampleMesh>,
}

impl Sample {
    /// The mesh, of a sample that is one and where it is loaded.
    pub fn loaded_mesh(&self) -> Option<&Arc<LoadedMesh>> {
        self.mesh.as_ref()?.loaded()
    }
}

/// The shape of a sample.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Shape {
    /// A flat square. The frame of the material is the world's.
    #[default]
    Square,
    /// A sphere, its highest point at the origin. The frame of the material is the world's there, and
    /// is carried along the meridians from it: at normal n it is turned by the smallest rotation that
    /// takes +z to n.
    Sphere,
    /// The mantle of a cylinder that lies along x, its highest line on the x axis. The frame of the
    /// material has its x along the cylinder.
    Cylinder,
    /// The triangles of a file, scaled and moved as [`LoadedMesh::placed`] says. The frame of the material has
    /// its x along the file's tangents, or else the way in which its texture coordinate u grows; without
    /// either it is as on a sphere.
    Mesh,
}

/// As a specification names it.
impl std::fmt::Display for Shape {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Square => "square",
            Self::Sphere => "sphere",
            Self::Cylinder => "cylinder",
            Self::Mesh => "mesh",
        })
    }
}

impl Shape {
    /// Whether the sample is flat: films of it can be warped to a square, and the hybrid integrator
    /// renders it.
    pub fn is_square(&self) -> bool {
        *self == Self::Square
    }
}

/// The colour chart: Lambertian patches on a plane beyond the sample that rises away from it,
/// centred at x = 0, its lower edge at z = 0; its back is black.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Checker {
    /// Patches along x.
    pub columns: u32,
    /// Patches up the plane.
    pub rows: u32,
    /// The side of a patch.
    pub pitch_m: f64,
    /// Where the lower edge stands; it has to clear the sample.
    pub lower_edge_y_m: f64,
    /// The plane's angle above the horizontal, 0 to 90.
    pub tilt_deg: f64,
    /// `rows * columns` colours, 8-bit sRGB: far row first, each row from -x to +x.
    pub patches_srgb8: Vec<[u8; 3]>,
}

/// One view of a material.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct View {
    /// The camera's elevation above the sample's plane, above 0 to 90.
    pub camera_elevation_deg: f64,
    /// The bulb's elevation, above 0 to 90.
    pub light_elevation_deg: f64,
    /// How far the material's frame is turned, counter-clockwise about the normal; the square
    /// stays put.
    pub rotation_deg: f64,
    /// Whether the chart is in the scene.
    pub checker: bool,
}
