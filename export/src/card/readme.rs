//! The dataset card: a README in Markdown with the front matter that Hugging Face reads.

use super::{
    CITATION, Described,
    pixels::{PERCENT, Pixels},
    summary,
};
use crate::layout::unit::{Layout, column_name};
use dataset::{
    RENDERER_VERSION, Specification, Split,
    specification::{Pixel, Shape},
};
use std::fmt::Write;

/// The whole card.
pub(super) fn text(described: &Described<'_>, pixels: &Pixels) -> String {
    let mut text = String::new();
    // Writing to a string cannot fail.
    let _ = write_front_matter(described, &mut text);
    let _ = write_body(described, pixels, &mut text);
    text
}

fn write_front_matter(described: &Described<'_>, text: &mut String) -> std::fmt::Result {
    let specification = described.store.specification();
    let images = described.chosen.images();
    writeln!(text, "---")?;
    write!(text, "{}", described.publication.licence.front_matter())?;
    writeln!(text, "pretty_name: {}", specification.name)?;
    writeln!(text, "task_categories: [image-to-image, other]")?;
    writeln!(
        text,
        "tags: [brdf, svbrdf, materials, rendering, inverse-rendering]"
    )?;
    writeln!(text, "size_categories: [{}]", size_category(images))?;
    if described.layout == Layout::HuggingFace {
        writeln!(text, "configs:\n- config_name: default\n  data_files:")?;
        for split in splits(described) {
            writeln!(text, "  - split: {split}\n    path: {split}/*.parquet")?;
        }
    }
    writeln!(text, "---\n")
}

fn write_body(described: &Described<'_>, pixels: &Pixels, text: &mut String) -> std::fmt::Result {
    let specification = described.store.specification();
    let publication = described.publication;
    writeln!(text, "# {}\n", specification.name)?;
    writeln!(text, "{}\n", summary(described))?;
    writeln!(
        text,
        "Rendered by brdfarm (renderer version {RENDERER_VERSION}) under the specification of \
         hash `{}` (`specification.toml`), seed {}. Any image can be rendered again from these \
         numbers, byte for byte.\n",
        described.store.specification_hash(),
        specification.seed
    )?;
    if let Some(creator) = &publication.creator {
        writeln!(text, "Published by {creator}.\n")?;
    }
    if let Some(url) = &publication.url {
        writeln!(text, "Home: {url}\n")?;
    }
    writeln!(
        text,
        "![Examples: a row a material, a column a view](examples.png)\n"
    )?;
    write_counts(described, text)?;
    write_layout(described, text)?;
    write_pixels(described, text)?;
    write_channels(pixels, text)?;
    write_geometry(described, text)?;
    write_labels(described, text)?;
    write_limits(described, text)?;
    writeln!(text, "## Licence\n\n{}\n", publication.licence)?;
    writeln!(
        text,
        "## Citation\n\nFor the model and the design of the dataset:\n\n```bibtex\n{CITATION}\n```"
    )
}

/// The splits that are in the export, in order.
fn splits(described: &Described<'_>) -> Vec<Split> {
    let all = [Split::Train, Split::Validation, Split::Test];
    all.into_iter()
        .filter(|split| described.shards.iter().any(|shard| shard.split == *split))
        .collect()
}

fn write_counts(described: &Described<'_>, text: &mut String) -> std::fmt::Result {
    writeln!(
        text,
        "## Counts\n\n| split | materials | images |\n| --- | --- | --- |"
    )?;
    let views = described.chosen.views.len();
    for split in splits(described) {
        let of_split = described.shards.iter().filter(|shard| shard.split == split);
        let materials: usize = of_split.map(|shard| shard.materials.len()).sum();
        writeln!(text, "| {split} | {materials} | {} |", materials * views)?;
    }
    if let Some(condition) = &described.chosen.condition {
        writeln!(text, "\nOf the set those materials with `{condition}`.")?;
    }
    let missing = described.chosen.materials_missing;
    if missing > 0 {
        writeln!(text, "\n**Incomplete: {missing} materials are missing.**")?;
    }
    writeln!(
        text,
        "\nA material is in one split with all its views: of every six consecutive materials four \
         train, one validates and one tests.\n"
    )
}

fn write_layout(described: &Described<'_>, text: &mut String) -> std::fmt::Result {
    writeln!(text, "## Files\n")?;
    writeln!(
        text,
        "`manifest.parquet` has one row an image with every label, the view's geometry, digest \
         (BLAKE3), size, path and measured error; each column's unit and meaning stand in its \
         metadata.\n"
    )?;
    match described.layout {
        Layout::Files { .. } => writeln!(
            text,
            "Images are in `SPLIT/MATERIAL/vVIEW.exr`, as in `train/000123/v05.exr`.\n"
        )?,
        Layout::WebDataset => writeln!(
            text,
            "Shards are `SPLIT/SPLIT-NUMBER.tar`. A sample is a material, its members \
             `000123.v05.exr` and `000123.v05.json`, the row of the manifest, for each view.\n"
        )?,
        Layout::HuggingFace => writeln!(
            text,
            "`datasets.load_dataset(FOLDER)` opens it: shards are `SPLIT/SPLIT-*.parquet`, a row \
             an image, its file in the column `exr` as bytes.\n"
        )?,
    }
    if let Some(mesh) = &described.store.specification().sample.mesh {
        writeln!(
            text,
            "`{}` is the mesh of the sample, an OBJ or a PLY file whose name is its BLAKE3 digest. \
             `specification.toml` names it by that digest and can only be read beside it.\n",
            mesh.file_name()
        )?;
    }
    write_products(described, text)
}

/// What is made of each image.
fn write_products(described: &Described<'_>, text: &mut String) -> std::fmt::Result {
    for kind in described.products.kinds().iter().skip(1) {
        let what = match kind.extension {
            "npy" => "the pixels as a NumPy array, height x width x 3",
            "png" => "a preview, 8-bit sRGB, clipped at white",
            "rectified.exr" => "the sample warped to a square",
            "rectified.npy" => "the same as a NumPy array",
            _ => "the same as a preview",
        };
        let place = match described.layout {
            Layout::HuggingFace => column_name(*kind),
            Layout::Files { .. } | Layout::WebDataset => kind.extension,
        };
        writeln!(text, "- `{place}`: {what}")?;
    }
    if let Some(stops) = described.products.png_exposure_stops {
        writeln!(text, "\nPreviews are brightened by {stops} stops.")?;
    }
    if let Some(side) = described.products.rectified_side {
        writeln!(
            text,
            "\nRectified images are {side} x {side}, row 0 at v = 1. The filter is exact: each \
             pixel is the mean of the film over its cell of the sample, film pixels weighted by \
             the area of the sample that they and the cell share (so by the homography's \
             Jacobian), divided by the share of each film pixel that the sample covers."
        )?;
    }
    writeln!(text)
}

fn write_pixels(described: &Described<'_>, text: &mut String) -> std::fmt::Result {
    let specification = described.store.specification();
    let light = &specification.light;
    let sphere_m2 = 4.0 * std::f64::consts::PI * light.distance_m * light.distance_m;
    let white = light.power_w * light.efficacy_lm_per_w / sphere_m2 / std::f64::consts::PI;
    let pixel = match specification.image.pixel {
        Pixel::Half => "16-bit",
        Pixel::Float => "32-bit",
    };
    let brightest = light.distance_m / light.radius_m;
    writeln!(
        text,
        "## Pixels\n\nOpenEXR, channels R, G and B of {pixel} floats, ZIP. Linear Rec.709 \
         primaries, white D65, no gamma, no exposure to guess: a value is radiance over that of a \
         perfect white diffuser at the origin which faces the bulb, so white is 1, or {white:.1} \
         cd/m^2 (the attribute `whiteLuminance`). Values run from 0 to {:.1}, the bulb in a \
         mirror. Film pixels are means over their squares (a box filter).\n\nThe manifest has the \
         error of each image as it was estimated while rendering: mean, 95th percentile, maximum, \
         and the share of pixels (`within_target`) off by no more than {:e} or {:e} of their \
         value. Over all these images {:.4} percent of the pixels are within it.\n\nRows run from the \
         top of the film. On the sample u runs to the right and v upwards; row 0 of a rectified image \
         is at v = 1.\n",
        brightest * brightest,
        specification.accuracy.absolute,
        specification.accuracy.relative,
        100.0 * described.within_target
    )
}

/// What a network's inputs are normalised by.
fn write_channels(pixels: &Pixels, text: &mut String) -> std::fmt::Result {
    let Pixels {
        images, images_all, ..
    } = pixels;
    let which = if images == images_all {
        "all images".to_owned()
    } else {
        format!("{images} of the {images_all} images, of materials at equal distances")
    };
    writeln!(
        text,
        "The pixels of the sample in {which}, in units of white:\n\n| channel | mean | standard \
         deviation | {} | largest | mean of log1p | its standard deviation |\n| --- |{}",
        PERCENT.map(|percent| format!("{percent} %")).join(" | "),
        " ---: |".repeat(5 + PERCENT.len())
    )?;
    for (name, channel) in ["R", "G", "B"].iter().zip(&pixels.channels) {
        let percentiles = channel.percentiles.map(|value| format!("{value:.6e}"));
        writeln!(
            text,
            "| {name} | {:.6e} | {:.6e} | {} | {:.6e} | {:.6e} | {:.6e} |",
            channel.mean,
            channel.deviation,
            percentiles.join(" | "),
            channel.max,
            channel.log1p_mean,
            channel.log1p_deviation
        )?;
    }
    writeln!(
        text,
        "\nA few pixels, of highlights, are hundreds of times brighter than the median. Give networks \
         log1p(value), normalised by the last two columns, rather than the values themselves. \
         `brightness_mean`, `brightness_p99`, `dark_share` and `above_white_share` in the manifest find \
         images that show little.\n"
    )
}

/// Where the sample is.
fn sample(specification: &Specification) -> String {
    let side = specification.sample.side_m;
    match specification.sample.shape {
        Shape::Square => {
            format!("a square of side {side} in z = 0 with normal +z, centred at the origin")
        }
        Shape::Sphere => format!(
            "a sphere of diameter {side}, whose highest point is the origin; the frame of the material \
             is the world's there and is carried along the meridians from it"
        ),
        Shape::Cylinder => format!(
            "a cylinder of diameter and length {side} along x, whose highest line is in z = 0 with its \
             middle at the origin; the frame of the material has its x along it"
        ),
        Shape::Mesh => {
            let mesh = specification.sample.mesh.as_ref();
            let file = mesh.map_or_else(String::new, |mesh| {
                format!(" of the file `{}`", mesh.file_name())
            });
            format!(
                "the mesh{file}, scaled until the longest side of its box is {side}, with the middle of \
                 the box's top at the origin; the frame of the material has its x along the mesh's \
                 tangents, or else along its texture coordinate u, or else is carried from the world's as \
                 on a sphere"
            )
        }
    }
}

fn write_geometry(described: &Described<'_>, text: &mut String) -> std::fmt::Result {
    let specification = described.store.specification();
    writeln!(
        text,
        "## Geometry\n\nMetres, right-handed; the sample is {}. The camera, a pinhole, stands {} away on the -y side \
         and looks at the origin, half its film's width at unit distance is {}; the bulb, a \
         sphere of radius {}, stands {} away on the +y side. Matrices are row-major and act on \
         columns. `sample_from_film` takes film points (column, row, 1), continuous from the top \
         left corner, to (u w, v w, w) on {}.\n\n| view | camera (deg) | light (deg) | \
         turn (deg) | chart |\n| --- | --- | --- | --- | --- |",
        sample(specification),
        specification.camera.distance_m,
        specification.camera.film_half_width,
        specification.light.radius_m,
        specification.light.distance_m,
        if specification.sample.shape.is_square() {
            "the sample"
        } else {
            "the square in z = 0 that the sample touches"
        },
    )?;
    for &number in &described.chosen.views {
        let Some(view) = specification.views.get(number as usize) else {
            continue;
        };
        let chart = if view.checker { "yes" } else { "no" };
        writeln!(
            text,
            "| {number} | {} | {} | {} | {chart} |",
            view.camera_elevation_deg, view.light_elevation_deg, view.rotation_deg
        )?;
    }
    writeln!(
        text,
        "\nElevations are above the sample's plane; the turn is the material's.\n"
    )
}

fn write_labels(described: &Described<'_>, text: &mut String) -> std::fmt::Result {
    let ranges = &described.store.specification().parameters;
    writeln!(
        text,
        "## Labels\n\n| parameter | range |\n| --- | --- |\n| roughness R | {} to {} % |\n| \
         anisotropy A | {} to {} |\n| anisotropy angle | {} to {} degrees |\n| index of \
         refraction | {} to {} |\n| reflectance at 0 and at 90 degrees | all of sRGB |\n",
        ranges.roughness[0],
        ranges.roughness[1],
        ranges.anisotropy[0],
        ranges.anisotropy[1],
        ranges.angle_deg[0],
        ranges.angle_deg[1],
        ranges.ior[0],
        ranges.ior[1],
    )?;
    writeln!(
        text,
        "Materials are points of an Owen-scrambled Sobol sequence, evenly spread over the box. \
         Colours are labelled in linear Rec.709, sRGB and CIELAB (D65); `bin_*` are the classes, \
         100 to a parameter, that the paper's networks are trained on. `angle_twice_sin` and \
         `angle_twice_cos` are the angle without its jump from 180 to 0 degrees. `rgb0_scaled` and \
         `rgb90_scaled` are the colours without the factor that no image shows (see the limits \
         below).\n\n![Histograms of the ten \
         parameters](parameters.svg)\n"
    )
}

fn write_limits(described: &Described<'_>, text: &mut String) -> std::fmt::Result {
    let specification = described.store.specification();
    writeln!(
        text,
        "## Known limits\n\n- Smooth materials are black outside the reflections of bulb and \
         chart. That is the set-up, not a fault.\n- At anisotropy 0 the angle means nothing; near \
         it, little.\n- Up to a roughness of 90 and with the tint `hue`, a common factor of both \
         reflectance colours changes no image: it cannot be estimated. Learn `rgb0_scaled` and \
         `rgb90_scaled` there. (This set's tint is `{}`.)\n\
         - Other parameters cannot be estimated in some materials and views either. `brdfarm \
         dataset observability` (feature `training`) says which, with Cramer-Rao bounds.\n\
         - The paper gives no distances, turns, resolution or place of the chart: they are ours, \
         and stand in `specification.toml`.\n- The samples are flat and homogeneous, and the \
         surroundings black.\n",
        match specification.tint {
            dataset::specification::Tint::Hue => "hue",
            dataset::specification::Tint::Product => "product",
        }
    )
}

/// Hugging Face's names for sizes.
fn size_category(images: u64) -> &'static str {
    match images {
        0..1_000 => "n<1K",
        1_000..10_000 => "1K<n<10K",
        10_000..100_000 => "10K<n<100K",
        100_000..1_000_000 => "100K<n<1M",
        _ => "1M<n<10M",
    }
}
