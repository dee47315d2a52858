//! Plain files: a folder for each material, a file for each view and product.

use super::{Place, Unit, Work};
use crate::{
    error::ExportError,
    file::{beside, unable},
    product::Encoding,
};
use std::{collections::BTreeMap, fs, io, path::Path};

/// Whether a material's folder is there. The folder gets its name when its files are written, but
/// they are synced at the end of all: after a power loss their sizes tell.
pub(super) fn is_there(work: &Work<'_>, unit: &Unit, folder: &Path) -> Result<bool, ExportError> {
    let folder = folder.join(&unit.path);
    if !folder.is_dir() {
        return Ok(false);
    }
    for &material in &unit.materials {
        for (view, done) in work.chosen.files_of(work.store, material)? {
            for kind in &work.kinds {
                let path = folder.join(name(view, kind.extension));
                let bytes = fs::metadata(&path).map_or(0, |file| file.len());
                let whole = match (kind.encoding, kind.rectified) {
                    (Encoding::Exr, false) => bytes == done.bytes,
                    _ => bytes > 0,
                };
                if !whole {
                    fs::remove_dir_all(&folder).map_err(unable("remove", &folder))?;
                    return Ok(false);
                }
            }
        }
    }
    Ok(true)
}

/// Whether a material's files are all objects of a bucket: one that is there is whole.
pub(super) fn are_objects(
    work: &Work<'_>,
    unit: &Unit,
    objects: &BTreeMap<String, u64>,
) -> Result<bool, ExportError> {
    for &material in &unit.materials {
        for (view, _) in work.chosen.files_of(work.store, material)? {
            for kind in &work.kinds {
                let key = format!("{}/{}", unit.path, name(view, kind.extension));
                if !objects.contains_key(&key) {
                    return Ok(false);
                }
            }
        }
    }
    Ok(true)
}

/// Writes a material's folder.
pub(super) fn write(
    work: &Work<'_>,
    unit: &Unit,
    links: bool,
    tell: &(dyn Fn() + Sync),
) -> Result<(), ExportError> {
    match work.place {
        Place::Folder(folder) => write_files(work, unit, &folder.join(&unit.path), links, tell),
        Place::Bucket(_) => write_objects(work, unit, tell),
    }
}

fn write_objects(
    work: &Work<'_>,
    unit: &Unit,
    tell: &(dyn Fn() + Sync),
) -> Result<(), ExportError> {
    for &material in &unit.materials {
        work.each_image(unit, material, |image, products| {
            for product in products {
                let key = format!("{}/{}", unit.path, name(image.view, product.kind.extension));
                work.place.write_bytes(&key, &product.bytes)?;
            }
            tell();
            Ok(())
        })?;
    }
    Ok(())
}

fn write_files(
    work: &Work<'_>,
    unit: &Unit,
    path: &Path,
    links: bool,
    tell: &(dyn Fn() + Sync),
) -> Result<(), ExportError> {
    if let Some(parent) = path.parent() {
        fs::create_dir_all(parent).map_err(unable("make", parent))?;
    }
    let beside = beside(path);
    match fs::remove_dir_all(&beside) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => {
            return Err(unable("remove", &beside)(error).into());
        }
        _ => {}
    }
    fs::create_dir(&beside).map_err(unable("make", &beside))?;
    for &material in &unit.materials {
        work.each_image(unit, material, |image, products| {
            for product in products {
                let place = beside.join(name(image.view, product.kind.extension));
                if links && product.kind == work.kinds[0] {
                    fs::hard_link(work.store.image_path(&image.done.digest), &place)
                        .map_err(unable("link an image of the store to", &place))?;
                } else {
                    fs::write(&place, &product.bytes).map_err(unable("write", &place))?;
                }
            }
            tell();
            Ok(())
        })?;
    }
    Ok(fs::rename(&beside, path).map_err(unable("rename to", path))?)
}

fn name(view: u32, extension: &str) -> String {
    format!("v{view:02}.{extension}")
}
