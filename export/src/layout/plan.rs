//! What an export is made of, worked out before anything is written.

use super::{
    DESCRIPTIONS, Options, Work,
    place::{Place, READ_BYTES_MAX},
    unit::{Layout, Unit},
};
use crate::error::ExportError;
use crate::file::unable;
use crate::plan_difference::difference;
use dataset::{Digest, Split, specification::SampleMesh};
use serde_json::{Value, json};
use std::collections::HashMap;
use std::fs;
use std::path::Path;

/// The file that says what an export is to be.
const PLAN_FILE: &str = "export.json";

/// What a file system has in its root.
const LOST_AND_FOUND: &str = "lost+found";

/// Bytes of labels with an image in a shard, at most.
const LABEL_BYTES: u64 = 8 << 10;

/// All units, and the description by which an export is known again.
pub(super) struct Plan {
    pub units: Vec<Unit>,
    description: String,
}

impl Plan {
    pub fn new(work: &Work<'_>, options: &Options) -> Result<Self, ExportError> {
        let mut hasher = Vec::new();
        let mut sizes = Vec::with_capacity(work.chosen.materials.len());
        for &material in &work.chosen.materials {
            let images = work.chosen.files_of(work.store, material)?;
            hasher.extend(material.to_le_bytes());
            let mut bytes = 0;
            for (_, done) in &images {
                hasher.extend(done.digest.as_bytes());
                bytes += work.factory.bytes_max(done.bytes) + LABEL_BYTES;
                if work.layout == (Layout::Files { links: true }) {
                    bytes -= done.bytes;
                }
            }
            sizes.push((material, bytes));
        }
        let specification = work.store.specification();
        let by_split = [Split::Train, Split::Validation, Split::Test].map(|split| {
            let of_split = sizes
                .iter()
                .filter(|(material, _)| specification.split(*material) == split);
            (split, of_split.copied().collect::<Vec<_>>())
        });
        let units = by_split
            .into_iter()
            .flat_map(|(split, materials)| units(work.layout, split, &materials, options))
            .collect();
        let products = &options.products;
        let mut description = json!({
            "layout": work.layout.name(),
            "specification": work.store.specification_hash().to_string(),
            "renderer_version": dataset::RENDERER_VERSION,
            "images": Digest::of(&hasher).to_string(),
            "split": options.selection.split.map(Split::name),
            "views": work.chosen.views,
            "npy": products.npy,
            "png_exposure_stops": products.png_exposure_stops,
            "rectified_side": products.rectified_side,
            "shard_bytes": options.shard_bytes,
        });
        // Exports of before conditions are gone on with.
        if let Some(condition) = &options.selection.condition {
            description["where"] = condition.to_string().into();
        }
        Ok(Self {
            units,
            description: format!("{description:#}\n"),
        })
    }

    /// Makes sure that a place is empty or holds this very export, and says in it what it is. Another
    /// export in a folder is removed first if it is to be overwritten.
    pub fn claim(&self, place: &Place, overwrite: bool) -> Result<(), ExportError> {
        place.make()?;
        let found = match place.read(PLAN_FILE)? {
            Some(found) if found == self.description.as_bytes() => return Ok(()),
            found => found,
        };
        if let Some(content) = found {
            let found = match content.len() as u64 <= READ_BYTES_MAX {
                true => difference(&content, &self.description, "export"),
                false => "another export".to_owned(),
            };
            match place {
                // Another program's folder may have the same names.
                Place::Folder(folder) if overwrite && is_plan(&content) => remove(folder)?,
                Place::Folder(folder) if !is_plan(&content) => {
                    return Err(ExportError::Occupied {
                        folder: folder.clone(),
                        found: format!("a {PLAN_FILE} that this program did not write"),
                    });
                }
                Place::Folder(folder) => {
                    return Err(ExportError::OtherExport {
                        folder: folder.clone(),
                        found,
                    });
                }
                Place::Bucket(_) => {
                    return Err(ExportError::OtherExportInBucket {
                        place: place.name(),
                        found,
                    });
                }
            }
        }
        // The plan's own file may have been cut short.
        let unfinished = format!("{PLAN_FILE}.new");
        match place.occupant(&[&unfinished, LOST_AND_FOUND])? {
            Some(name) => Err(ExportError::Occupied {
                folder: place.name(),
                found: format!("{name:?}"),
            }),
            None => Ok(place.write_bytes(PLAN_FILE, self.description.as_bytes())?),
        }
    }

    /// The path of each material's unit.
    pub fn units_by_material(&self) -> HashMap<u32, &str> {
        let materials = self.units.iter().flat_map(|unit| {
            let path = unit.path.as_str();
            unit.materials.iter().map(move |material| (*material, path))
        });
        materials.collect()
    }
}

/// Whether a plan file was written by this program.
fn is_plan(content: &[u8]) -> bool {
    let keys = ["layout", "specification", "renderer_version", "images"];
    let plan = serde_json::from_slice::<Value>(content);
    plan.is_ok_and(|plan| keys.iter().all(|key| plan.get(key).is_some()))
}

/// Removes an export from its folder: what an export writes, and nothing if something else is there.
/// The plan goes last, so if the removal is cut short, the folder is still known as an export.
fn remove(folder: &Path) -> Result<(), ExportError> {
    let splits = [Split::Train, Split::Validation, Split::Test].map(Split::name);
    let mut parts = Vec::new();
    for entry in fs::read_dir(folder).map_err(unable("read", folder))? {
        let entry = entry.map_err(unable("read", folder))?;
        let name = entry.file_name().to_string_lossy().into_owned();
        // What was being written when an export was killed.
        let stem = name.strip_suffix(".new").unwrap_or(&name);
        let stem = stem.strip_suffix(".whole").unwrap_or(stem);
        match stem {
            PLAN_FILE | LOST_AND_FOUND => {}
            _ if splits.contains(&stem) || DESCRIPTIONS.contains(&stem) => parts.push(entry),
            // Perhaps another mesh than the one that is exported now.
            _ if SampleMesh::of_file_name(stem).is_some() => parts.push(entry),
            _ => {
                return Err(ExportError::Occupied {
                    folder: folder.to_owned(),
                    found: format!("{name:?} beside an export"),
                });
            }
        }
    }
    for part in parts {
        let path = part.path();
        let kind = part.file_type().map_err(unable("look at", &path))?;
        let removed = match kind.is_dir() {
            true => fs::remove_dir_all(&path),
            false => fs::remove_file(&path),
        };
        removed.map_err(unable("remove", &path))?;
    }
    let plan = folder.join(PLAN_FILE);
    Ok(fs::remove_file(&plan).map_err(unable("remove", &plan))?)
}

fn units(layout: Layout, split: Split, materials: &[(u32, u64)], options: &Options) -> Vec<Unit> {
    let mut shards: Vec<Unit> = Vec::new();
    for &(material, bytes) in materials {
        let joins = !matches!(layout, Layout::Files { .. })
            && shards
                .last()
                .is_some_and(|shard| shard.bytes_max + bytes <= options.shard_bytes);
        match shards.last_mut() {
            Some(shard) if joins => {
                shard.materials.push(material);
                shard.bytes_max += bytes;
            }
            _ => shards.push(Unit {
                path: format!("{split}/{material:06}"),
                split,
                materials: vec![material],
                bytes_max: bytes,
            }),
        }
    }
    let count = shards.len();
    for (number, shard) in shards.iter_mut().enumerate() {
        match layout {
            Layout::Files { .. } => {}
            Layout::WebDataset => shard.path = format!("{split}/{split}-{number:06}.tar"),
            Layout::HuggingFace => {
                shard.path = format!("{split}/{split}-{number:05}-of-{count:05}.parquet");
            }
        }
    }
    shards
}
