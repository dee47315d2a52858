//! What an export says of its pairs: `export.json`, written first, and `manifest.parquet`, which
//! appears when the export is whole.

use super::{Label, Source};
use crate::error::{TrainingError, bad_input};
use dataset::manifest::{Row, Value};
use dataset::{Digest, Material, Specification, Split};
use export::file::unable;
use export::manifest::read;
use serde::Deserialize;
use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

/// An export and its pairs, without their pixels.
pub(super) struct Folder {
    pub path: PathBuf,
    pub specification: Specification,
    pub renderer_version: String,
    /// Names the export's images and how they were rectified.
    pub digest: Digest,
    pub views: [u32; 2],
    /// Pixels a side of its rectified images.
    pub side: u32,
    pub labels: Vec<Label>,
    /// By label: the oblique image, then the one from above.
    pub images: Vec<[PathBuf; 2]>,
}

/// The fields of `export.json` that count here.
#[derive(Deserialize)]
struct Plan {
    layout: String,
    renderer_version: String,
    rectified_side: Option<u32>,
}

impl Folder {
    pub fn open(source: &Source) -> Result<Self, TrainingError> {
        let path = &source.folder;
        let (plan, digest) = read_plan(path)?;
        let side = check_plan(path, &plan, source.side)?;
        let manifest = path.join("manifest.parquet");
        if !manifest.is_file() {
            return Err(bad_input(
                path,
                "the export is not finished: run `brdfarm dataset export` again, it goes on where \
                 it stopped",
            ));
        }
        let specification = read::read_specification(&manifest)?;
        let mut rows = BTreeMap::new();
        read::read::<TrainingError>(&manifest, |_, row| {
            rows.insert(row.image(), row);
            Ok(())
        })?;
        let views = choose_views(path, &specification, &rows, source.views)?;
        let (labels, images) = pair(path, &rows, views)?;
        Ok(Self {
            path: path.clone(),
            specification,
            renderer_version: plan.renderer_version,
            digest,
            views,
            side,
            labels,
            images,
        })
    }
}

fn read_plan(folder: &Path) -> Result<(Plan, Digest), TrainingError> {
    let path = folder.join("export.json");
    if !path.is_file() {
        return Err(bad_input(
            folder,
            "no export of brdfarm: make one with `brdfarm dataset export FOLDER --layout files \
             --views 5,8 --rectified 64`",
        ));
    }
    let text = fs::read(&path).map_err(unable("read", &path))?;
    let plan = serde_json::from_slice(&text).map_err(|error| bad_input(&path, error))?;
    Ok((plan, Digest::of(&text)))
}

fn check_plan(folder: &Path, plan: &Plan, side: u32) -> Result<u32, TrainingError> {
    if plan.layout != "files" {
        return Err(bad_input(
            folder,
            format!("the export's layout is {}, not files", plan.layout),
        ));
    }
    let Some(rectified) = plan.rectified_side else {
        return Err(bad_input(
            folder,
            "the export has no rectified images: export with --rectified",
        ));
    };
    if side == 0 || rectified % side != 0 {
        return Err(bad_input(
            folder,
            format!(
                "the rectified images have {rectified} pixels a side, which is no multiple of \
                 {side}"
            ),
        ));
    }
    Ok(rectified)
}

/// The two views, the lower camera first.
fn choose_views(
    folder: &Path,
    specification: &Specification,
    rows: &BTreeMap<(u32, u32), Row>,
    wanted: Option<[u32; 2]>,
) -> Result<[u32; 2], TrainingError> {
    let there: BTreeSet<u32> = rows.keys().map(|(_, view)| *view).collect();
    let views: Vec<u32> = match wanted {
        Some(views) => views.to_vec(),
        None => there.iter().copied().collect(),
    };
    let Ok([one, other]) = <[u32; 2]>::try_from(views) else {
        return Err(bad_input(
            folder,
            format!("the export has the views {there:?}: choose two with --views"),
        ));
    };
    if let Some(missing) = [one, other].iter().find(|view| !there.contains(view)) {
        return Err(bad_input(
            folder,
            format!("the export has no view {missing}: it has {there:?}"),
        ));
    }
    let elevation = |view: u32| {
        let view = specification.views.get(view as usize);
        view.map_or(0.0, |view| view.camera_elevation_deg)
    };
    Ok(if elevation(one) <= elevation(other) {
        [one, other]
    } else {
        [other, one]
    })
}

type Images = Vec<[PathBuf; 2]>;

fn pair(
    folder: &Path,
    rows: &BTreeMap<(u32, u32), Row>,
    views: [u32; 2],
) -> Result<(Vec<Label>, Images), TrainingError> {
    let materials: BTreeSet<u32> = rows.keys().map(|(material, _)| *material).collect();
    let (mut labels, mut images) = (Vec::new(), Vec::new());
    for material in materials {
        let mut paths = Vec::with_capacity(2);
        for view in views {
            let Some(row) = rows.get(&(material, view)) else {
                return Err(bad_input(
                    folder,
                    format!("material {material} has no view {view}"),
                ));
            };
            let Some(Value::Text(path)) = row.value("path") else {
                unreachable!("every row has a path");
            };
            let stem = path.strip_suffix(".exr").unwrap_or(path);
            paths.push(folder.join(format!("{stem}.rectified.exr")));
            if view == views[0] {
                labels.push(label(folder, row)?);
            }
        }
        if let Ok(pair) = <[PathBuf; 2]>::try_from(paths) {
            images.push(pair);
        }
    }
    if labels.is_empty() {
        return Err(bad_input(folder, "the export has no material"));
    }
    Ok((labels, images))
}

fn label(folder: &Path, row: &Row) -> Result<Label, TrainingError> {
    let (index, _) = row.image();
    let number = |name| match row.value(name) {
        Some(Value::F64(number)) => *number,
        _ => unreachable!("every row has a {name}"),
    };
    let colour = |name| match row.value(name) {
        Some(Value::F64List(channels)) => <[f64; 3]>::try_from(channels.as_slice()).ok(),
        _ => None,
    };
    let (Some(rgb0), Some(rgb90)) = (colour("rgb0_linear"), colour("rgb90_linear")) else {
        unreachable!("every row has two colours of three channels");
    };
    let material = Material {
        roughness: number("roughness"),
        anisotropy: number("anisotropy"),
        angle_deg: number("angle_deg"),
        ior: number("ior"),
        rgb0,
        rgb90,
    };
    material
        .check()
        .map_err(|error| bad_input(folder, format!("material {index}: {error}")))?;
    let split = match row.value("split") {
        Some(Value::Text(name)) => [Split::Train, Split::Validation, Split::Test]
            .into_iter()
            .find(|split| split.name() == name),
        _ => None,
    };
    let split = split
        .ok_or_else(|| bad_input(folder, format!("material {index} is of an unknown split")))?;
    Ok(Label {
        index,
        split,
        material,
    })
}
