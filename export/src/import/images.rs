//! The files of the images that a manifest names: plain, in tar shards or in Parquet shards.
//!
//! Nothing is checked here but that they are there; shards are read once, from front to back, and
//! a material is handed over when its last image was found.

use super::{
    ImportError, WantedMaterials,
    source::{Shard, Source},
};
use arrow_array::{Array, BinaryArray, UInt32Array};
use parquet::arrow::{ProjectionMask, arrow_reader::ParquetRecordBatchReaderBuilder};
use std::{
    collections::{BTreeMap, BTreeSet},
    io::Read,
    path::Path,
};

/// Rows of a Parquet shard that are decoded together.
const SHARD_BATCH_ROWS: usize = 64;

/// Who takes a material's files, in the order of views.
pub type TakeMaterial<'a> = dyn FnMut(u32, Vec<Vec<u8>>) -> Result<(), ImportError> + 'a;

/// Hands over the files of every material; nothing is checked but that they are there.
pub(super) fn for_each_material(
    wanted: &WantedMaterials,
    source: &Source,
    take: &mut TakeMaterial<'_>,
) -> Result<(), ImportError> {
    let mut shards: BTreeSet<&Path> = BTreeSet::new();
    for (&material, images) in wanted {
        let is_shard = |path: &Path| {
            let ending = path.extension().and_then(|ending| ending.to_str());
            matches!(ending, Some("tar" | "parquet"))
        };
        let in_shards = images.iter().filter(|image| is_shard(&image.path));
        if in_shards.clone().count() > 0 {
            shards.extend(in_shards.map(|image| image.path.as_path()));
            continue;
        }
        let files = images.iter().map(|image| (&*image.path, image.done.bytes));
        let files = source.read_each(files.collect()).into_iter();
        let files = images
            .iter()
            .zip(0..)
            .zip(files)
            .map(|((image, view), read)| {
                read.map_err(|error| ImportError::Image {
                    path: source.path(&image.path),
                    material,
                    view,
                    what: error.to_string(),
                })
            });
        take(material, files.collect::<Result<_, _>>()?)?;
    }
    let mut gathering = Gathering {
        wanted,
        parts: BTreeMap::new(),
    };
    for shard in shards {
        let shard = source.open(shard)?;
        if shard
            .path()
            .extension()
            .is_some_and(|ending| ending == "tar")
        {
            read_tar(&shard, &mut gathering, take)?;
        } else {
            read_parquet(shard, &mut gathering, take)?;
        }
    }
    match gathering.parts.iter().next() {
        None => Ok(()),
        Some((&material, parts)) => {
            let missing = parts.iter().position(Option::is_none).unwrap_or_default();
            Err(ImportError::Image {
                path: source.path(&wanted[&material][missing].path),
                material,
                view: missing as u32,
                what: "the image is missing".to_owned(),
            })
        }
    }
}

/// Materials whose images come one by one.
struct Gathering<'a> {
    wanted: &'a WantedMaterials,
    parts: BTreeMap<u32, Vec<Option<Vec<u8>>>>,
}

impl Gathering<'_> {
    /// The size of an image, where it is wanted.
    fn bytes(&self, material: u32, view: u32) -> Option<u64> {
        let image = self.wanted.get(&material)?.get(view as usize)?;
        Some(image.done.bytes)
    }

    /// Adds an image that is wanted; hands its material over when that was the last.
    fn add(
        &mut self,
        material: u32,
        view: u32,
        bytes: Vec<u8>,
        take: &mut TakeMaterial<'_>,
    ) -> Result<(), ImportError> {
        let views = self.wanted[&material].len();
        let parts = self
            .parts
            .entry(material)
            .or_insert_with(|| vec![None; views]);
        parts[view as usize] = Some(bytes);
        if parts.iter().all(Option::is_some) {
            let parts = self.parts.remove(&material).unwrap_or_default();
            take(material, parts.into_iter().flatten().collect())?;
        }
        Ok(())
    }
}

fn read_tar(
    shard: &Shard,
    gathering: &mut Gathering<'_>,
    take: &mut TakeMaterial<'_>,
) -> Result<(), ImportError> {
    let failed = |error: std::io::Error| ImportError::Shard {
        path: shard.path(),
        what: error.to_string(),
    };
    let mut archive = tar::Archive::new(shard.read_from_start());
    for entry in archive.entries().map_err(failed)? {
        let entry = entry.map_err(failed)?;
        let name = String::from_utf8_lossy(&entry.path_bytes()).into_owned();
        let Some((material, view)) = image_of_member(&name) else {
            continue;
        };
        let Some(bytes) = gathering.bytes(material, view) else {
            continue;
        };
        let mut content = Vec::new();
        entry
            .take(bytes + 1)
            .read_to_end(&mut content)
            .map_err(failed)?;
        gathering.add(material, view, content, take)?;
    }
    Ok(())
}

/// The material and view of a member such as `000123.v05.exr`.
fn image_of_member(name: &str) -> Option<(u32, u32)> {
    let (material, rest) = name.split_once(".v")?;
    let view = rest.strip_suffix(".exr")?;
    Some((material.parse().ok()?, view.parse().ok()?))
}

fn read_parquet(
    shard: Shard,
    gathering: &mut Gathering<'_>,
    take: &mut TakeMaterial<'_>,
) -> Result<(), ImportError> {
    let path = shard.path();
    let failed = |what: String| ImportError::Shard {
        path: path.clone(),
        what,
    };
    let builder = ParquetRecordBatchReaderBuilder::try_new(shard)
        .map_err(|error| failed(error.to_string()))?;
    let columns = ["material", "view", "exr"];
    let mask = ProjectionMask::columns(builder.parquet_schema(), columns);
    let batches = builder
        .with_projection(mask)
        .with_batch_size(SHARD_BATCH_ROWS)
        .build()
        .map_err(|error| failed(error.to_string()))?;
    for batch in batches {
        let batch = batch.map_err(|error| failed(error.to_string()))?;
        let number = |name: &str| {
            let column = batch.column_by_name(name)?;
            column.as_any().downcast_ref::<UInt32Array>()
        };
        let files = batch.column_by_name("exr");
        let files = files.and_then(|column| column.as_any().downcast_ref::<BinaryArray>());
        let (Some(materials), Some(views), Some(files)) =
            (number("material"), number("view"), files)
        else {
            return Err(failed(format!("it has no columns {columns:?} of images")));
        };
        for place in 0..batch.num_rows() {
            let (material, view) = (materials.value(place), views.value(place));
            if gathering.bytes(material, view).is_some() && files.is_valid(place) {
                gathering.add(material, view, files.value(place).to_vec(), take)?;
            }
        }
    }
    Ok(())
}
