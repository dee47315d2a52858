//! The table of columns.

use super::column::{Column, Image, Kind, Value, blob_path};
use crate::{
    PixelStatistics, RENDERER_VERSION, sin_cos_deg,
    specification::{Pixel, Tint},
};

const fn column(
    name: &'static str,
    kind: Kind,
    unit: &'static str,
    description: &'static str,
    value: fn(&Image<'_>) -> Value,
) -> Column {
    Column {
        name,
        kind,
        unit,
        description,
        optional: false,
        value,
    }
}

/// A column that manifests of earlier versions lack.
const fn later(column: Column) -> Column {
    Column {
        optional: true,
        ..column
    }
}

/// A column of what the pixels say, where it is known.
fn of_pixels(image: &Image<'_>, number: fn(&PixelStatistics) -> f64) -> Value {
    let pixels = image.done.pixels.as_ref();
    pixels.map_or(Value::Missing, |pixels| Value::F64(number(pixels)))
}

/// Sine and cosine of twice the angle: equal at 0 and 180 degrees, as the materials are.
fn twice_the_angle(image: &Image<'_>) -> (f64, f64) {
    sin_cos_deg(2.0 * image.sampled.material.angle_deg)
}

fn text(value: impl ToString) -> Value {
    Value::Text(value.to_string())
}

fn flat<const M: usize, const N: usize>(matrix: &[[f64; N]; M]) -> Value {
    Value::F64List(matrix.as_flattened().to_vec())
}

/// How many triangles the sample has: as many as its file has once quadrangles are divided. Nothing is known
/// of a mesh that is not loaded.
fn triangles(image: &Image<'_>) -> Value {
    let Some(mesh) = &image.specification.sample.mesh else {
        return Value::U32(0);
    };
    let loaded = mesh.loaded();
    let count = loaded.and_then(|loaded| loaded.mesh().triangles().len().try_into().ok());
    count.map_or(Value::Missing, Value::U32)
}

/// A word where there is no mesh: readers of CSV take an empty field for a value that is missing, and
/// every row of a manifest has every value.
fn mesh(image: &Image<'_>) -> Value {
    let mesh = image.specification.sample.mesh.as_ref();
    mesh.map_or_else(|| text("none"), |mesh| text(mesh.digest()))
}

fn bin(image: &Image<'_>, parameter: usize) -> Value {
    Value::U32(u32::from(image.bins[parameter]))
}

/// Every column with the function that gives its value, in the manifest's order.
pub(super) static COLUMNS: [Column; 61] = [
    column("dataset", Kind::Text, "", "The dataset's name.", |i| {
        text(&i.specification.name)
    }),
    column(
        "specification",
        Kind::Text,
        "",
        "BLAKE3 hash of the specification's canonical form.",
        |i| text(i.specification_hash),
    ),
    column(
        "renderer_version",
        Kind::Text,
        "",
        "Version of the renderer that made the image.",
        |_| text(RENDERER_VERSION),
    ),
    column(
        "material",
        Kind::U32,
        "",
        "The material's index in the dataset.",
        |i| Value::U32(i.sampled.index),
    ),
    column(
        "view",
        Kind::U32,
        "",
        "The view's index in the specification.",
        |i| Value::U32(i.view_index),
    ),
    column(
        "split",
        Kind::Text,
        "",
        "train, validation or test: a material's, with all its views.",
        |i| text(i.specification.split(i.sampled.index)),
    ),
    column(
        "digest",
        Kind::Text,
        "",
        "BLAKE3 hash of the image's file.",
        |i| text(i.done.digest),
    ),
    column("bytes", Kind::U64, "B", "Size of the image's file.", |i| {
        Value::U64(i.done.bytes)
    }),
    column(
        "path",
        Kind::Text,
        "",
        "The file that holds the image, relative to the store or the export; a shard's members and \
         rows are named by material and view.",
        |i| text(blob_path(&i.done.digest)),
    ),
    column(
        "seed",
        Kind::U64,
        "",
        "Seed of the parameters, splits and light paths.",
        |i| Value::U64(i.specification.seed),
    ),
    column("roughness", Kind::F64, "%", "Roughness R, 0 to 100.", |i| {
        Value::F64(i.sampled.material.roughness)
    }),
    column("anisotropy", Kind::F64, "1", "Anisotropy A, 0 to 1.", |i| {
        Value::F64(i.sampled.material.anisotropy)
    }),
    column(
        "angle_deg",
        Kind::F64,
        "deg",
        "Anisotropy angle psi before the view's turn, 0 to 180, counter-clockwise from +x.",
        |i| Value::F64(i.sampled.material.angle_deg),
    ),
    column(
        "ior",
        Kind::F64,
        "1",
        "Index of refraction, 1 to 10.",
        |i| Value::F64(i.sampled.material.ior),
    ),
    column(
        "rgb0_linear",
        Kind::F64List(3),
        "1",
        "Reflectance at 0 degrees, linear Rec.709.",
        |i| Value::F64List(i.sampled.material.rgb0.to_vec()),
    ),
    column(
        "rgb90_linear",
        Kind::F64List(3),
        "1",
        "Reflectance at 90 degrees, linear Rec.709.",
        |i| Value::F64List(i.sampled.material.rgb90.to_vec()),
    ),
    column(
        "rgb0_srgb",
        Kind::F64List(3),
        "1",
        "Reflectance at 0 degrees, sRGB-encoded, as it was sampled.",
        |i| Value::F64List(i.sampled.srgb0.to_vec()),
    ),
    column(
        "rgb90_srgb",
        Kind::F64List(3),
        "1",
        "Reflectance at 90 degrees, sRGB-encoded, as it was sampled.",
        |i| Value::F64List(i.sampled.srgb90.to_vec()),
    ),
    column(
        "rgb0_lab",
        Kind::F64List(3),
        "1",
        "Reflectance at 0 degrees, CIELAB under D65.",
        |i| Value::F64List(i.sampled.lab0().to_vec()),
    ),
    column(
        "rgb90_lab",
        Kind::F64List(3),
        "1",
        "Reflectance at 90 degrees, CIELAB under D65.",
        |i| Value::F64List(i.sampled.lab90().to_vec()),
    ),
    column(
        "bin_roughness",
        Kind::U32,
        "",
        "Which of 100 uniform bins over 0 to 100 the roughness falls into.",
        |i| bin(i, 0),
    ),
    column(
        "bin_anisotropy",
        Kind::U32,
        "",
        "Which of 100 uniform bins over 0 to 1 the anisotropy falls into.",
        |i| bin(i, 1),
    ),
    column(
        "bin_angle",
        Kind::U32,
        "",
        "Which of 100 uniform bins over 0 to 180 degrees the anisotropy angle falls into.",
        |i| bin(i, 2),
    ),
    column(
        "bin_ior",
        Kind::U32,
        "",
        "Which of 100 uniform bins over 1 to 10 the index of refraction falls into.",
        |i| bin(i, 3),
    ),
    column(
        "bin_l0",
        Kind::U32,
        "",
        "Which of 100 uniform bins over 0 to 100 L* at 0 degrees falls into.",
        |i| bin(i, 4),
    ),
    column(
        "bin_a0",
        Kind::U32,
        "",
        "Which of 100 uniform bins over -87 to 99 a* at 0 degrees falls into.",
        |i| bin(i, 5),
    ),
    column(
        "bin_b0",
        Kind::U32,
        "",
        "Which of 100 uniform bins over -108 to 95 b* at 0 degrees falls into.",
        |i| bin(i, 6),
    ),
    column(
        "bin_l90",
        Kind::U32,
        "",
        "Which of 100 uniform bins over 0 to 100 L* at 90 degrees falls into.",
        |i| bin(i, 7),
    ),
    column(
        "bin_a90",
        Kind::U32,
        "",
        "Which of 100 uniform bins over -87 to 99 a* at 90 degrees falls into.",
        |i| bin(i, 8),
    ),
    column(
        "bin_b90",
        Kind::U32,
        "",
        "Which of 100 uniform bins over -108 to 95 b* at 90 degrees falls into.",
        |i| bin(i, 9),
    ),
    column("width", Kind::U32, "px", "Pixels a row.", |i| {
        Value::U32(i.specification.image.width)
    }),
    column("height", Kind::U32, "px", "Rows.", |i| {
        Value::U32(i.specification.image.height)
    }),
    column(
        "pixel",
        Kind::Text,
        "",
        "Type of the stored pixels: half or float.",
        |i| {
            text(match i.specification.image.pixel {
                Pixel::Half => "half",
                Pixel::Float => "float",
            })
        },
    ),
    column(
        "tint",
        Kind::Text,
        "",
        "How Fresnel's luminance and the colours combine: hue or product.",
        |i| {
            text(match i.specification.tint {
                Tint::Hue => "hue",
                Tint::Product => "product",
            })
        },
    ),
    column(
        "camera_elevation_deg",
        Kind::F64,
        "deg",
        "The camera's elevation above the sample's plane.",
        |i| Value::F64(i.view.camera_elevation_deg),
    ),
    column(
        "light_elevation_deg",
        Kind::F64,
        "deg",
        "The bulb's elevation above the sample's plane.",
        |i| Value::F64(i.view.light_elevation_deg),
    ),
    column(
        "rotation_deg",
        Kind::F64,
        "deg",
        "How far the material's frame is turned, counter-clockwise about the normal.",
        |i| Value::F64(i.view.rotation_deg),
    ),
    column(
        "checker",
        Kind::Bool,
        "",
        "Whether the colour chart is in the scene.",
        |i| Value::Bool(i.view.checker),
    ),
    column(
        "film_half_width",
        Kind::F64,
        "1",
        "Half the film's width at unit distance.",
        |i| Value::F64(i.specification.camera.film_half_width),
    ),
    column(
        "light_radius_m",
        Kind::F64,
        "m",
        "The bulb's radius.",
        |i| Value::F64(i.specification.light.radius_m),
    ),
    column(
        "world_from_camera",
        Kind::F64List(16),
        "m",
        "4 x 4 matrix from the camera's frame (x right, y up, looking along -z) to the world.",
        |i| flat(&i.geometry.world_from_camera),
    ),
    column(
        "world_from_light",
        Kind::F64List(16),
        "m",
        "4 x 4 matrix from the bulb's frame (-z towards the origin) to the world.",
        |i| flat(&i.geometry.world_from_light),
    ),
    column(
        "sample_from_film",
        Kind::F64List(9),
        "",
        "3 x 3 homography from film pixels (column, row; top left corner 0, 0) to the sample \
         (u, v in 0 to 1; v up): (u w, v w, w) = H (column, row, 1). Where the sample is curved, to \
         the square in z = 0 that it touches.",
        |i| flat(&i.geometry.sample_from_film),
    ),
    column(
        "error_mean",
        Kind::F64,
        "white",
        "Mean over pixels of the estimated error (95 percent half width, worst channel).",
        |i| Value::F64(i.done.statistics.mean),
    ),
    column(
        "error_p95",
        Kind::F64,
        "white",
        "95th percentile over pixels of the estimated error.",
        |i| Value::F64(i.done.statistics.p95),
    ),
    column(
        "error_max",
        Kind::F64,
        "white",
        "Largest over pixels of the estimated error.",
        |i| Value::F64(i.done.statistics.max),
    ),
    column(
        "within_target",
        Kind::F64,
        "1",
        "Fraction of pixels whose estimated error meets the specification's accuracy.",
        |i| Value::F64(i.done.statistics.within_target),
    ),
    column(
        "samples",
        Kind::U64,
        "1",
        "Light paths traced from the camera, by the path tracer.",
        |i| Value::U64(i.done.statistics.samples),
    ),
    column(
        "evaluations",
        Kind::U64,
        "1",
        "Evaluations of the reflectance model, by the hybrid integrator.",
        |i| Value::U64(i.done.statistics.evaluations),
    ),
    later(column(
        "sample_share",
        Kind::F64,
        "1",
        "Share of the film's pixels whose centre lies on the sample.",
        |i| of_pixels(i, |pixels| pixels.sample_share),
    )),
    later(column(
        "brightness_mean",
        Kind::F64,
        "white",
        "Mean over the sample's pixels of the luminance (0.2126 R + 0.7152 G + 0.0722 B).",
        |i| of_pixels(i, |pixels| pixels.brightness_mean),
    )),
    later(column(
        "brightness_p99",
        Kind::F64,
        "white",
        "99th percentile over the sample's pixels of the luminance, interpolated linearly.",
        |i| of_pixels(i, |pixels| pixels.brightness_p99),
    )),
    later(column(
        "dark_share",
        Kind::F64,
        "1",
        "Share of the sample's pixels whose luminance is below 1/255.",
        |i| of_pixels(i, |pixels| pixels.dark_share),
    )),
    later(column(
        "above_white_share",
        Kind::F64,
        "1",
        "Share of the sample's pixels whose luminance is above 1.",
        |i| of_pixels(i, |pixels| pixels.above_white_share),
    )),
    later(column(
        "angle_twice_sin",
        Kind::F64,
        "1",
        "Sine of twice the anisotropy angle, which has no jump where the angle goes from 180 to 0.",
        |i| Value::F64(twice_the_angle(i).0),
    )),
    later(column(
        "angle_twice_cos",
        Kind::F64,
        "1",
        "Cosine of twice the anisotropy angle.",
        |i| Value::F64(twice_the_angle(i).1),
    )),
    later(column(
        "rgb0_scaled",
        Kind::F64List(3),
        "1",
        "rgb0_linear over the largest of the six channels where a common factor of both colours changes \
         no image (tint hue, roughness up to 90); elsewhere rgb0_linear.",
        |i| flat(&[i.sampled.material.scaled(i.specification.tint).rgb0]),
    )),
    later(column(
        "rgb90_scaled",
        Kind::F64List(3),
        "1",
        "rgb90_linear over the same number.",
        |i| flat(&[i.sampled.material.scaled(i.specification.tint).rgb90]),
    )),
    later(column(
        "sample_shape",
        Kind::Text,
        "",
        "The shape of the sample: square, sphere, cylinder or mesh.",
        |i| text(i.specification.sample.shape),
    )),
    later(column(
        "sample_triangles",
        Kind::U32,
        "1",
        "Triangles of the sample's mesh; 0 where the sample is no mesh.",
        triangles,
    )),
    later(column(
        "sample_mesh",
        Kind::Text,
        "",
        "BLAKE3 hash of the mesh's file, which is beside the store's or the export's specification; `none` \
         where the sample is no mesh.",
        mesh,
    )),
];
