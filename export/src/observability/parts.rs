//! A table under way: a folder beside it holds the plan and a file for each material that is done.
//!
//! Every file appears whole. The plan is the first file to come and the last to go, so a folder
//! that was left at any instant is known again.

use super::{Plan, Row, part, table};
use crate::error::ExportError;
use crate::file::{beside, sync_folder, unable, write_bytes};
use crate::manifest::read::read_metadata;
use crate::plan_difference::difference;
use dataset::Digest;
use std::fs::{self, File};
use std::io::{self, Read};
use std::path::{Path, PathBuf};

/// The file of the plan.
const PLAN_FILE: &str = "plan.json";

/// The largest plan that is read, bytes.
const PLAN_BYTES_MAX: u64 = 4 << 20;

/// The parts of a table.
#[derive(Debug)]
pub struct Parts {
    plan: Plan,
    description: String,
    digest: Digest,
    folder: PathBuf,
    table: PathBuf,
}

impl Parts {
    /// Begins a table, or goes on with it: the parts are in the folder `TABLE.parts`. `None` where
    /// the table is whole already.
    ///
    /// # Errors
    /// When the table or the folder holds something else or belongs to another plan, or the system
    /// refuses.
    pub fn claim(plan: Plan, table: &Path) -> Result<Option<Self>, ExportError> {
        let mut folder = table.as_os_str().to_owned();
        folder.push(".parts");
        let description = plan.description();
        let parts = Self {
            digest: Digest::of(description.as_bytes()),
            plan,
            description,
            folder: folder.into(),
            table: table.to_owned(),
        };
        let begun = parts.is_begun()?;
        if parts.is_whole()? {
            // A kill may have left some of the folder.
            parts.remove()?;
            return Ok(None);
        }
        if !begun {
            let folder = &parts.folder;
            fs::create_dir_all(folder).map_err(unable("make", folder))?;
            write_bytes(&folder.join(PLAN_FILE), parts.description.as_bytes())?;
        }
        Ok(Some(parts))
    }

    /// The materials that have no part yet, or a damaged one.
    ///
    /// # Errors
    /// When the system refuses to read one.
    pub fn missing(&self) -> Result<Vec<u32>, ExportError> {
        let mut missing = Vec::new();
        for &material in &self.plan.materials {
            if self.rows(material)?.is_none() {
                missing.push(material);
            }
        }
        Ok(missing)
    }

    /// Keeps the rows of a material, one for each set of the plan in order.
    ///
    /// # Errors
    /// When the part cannot be written.
    pub fn put(&self, material: u32, rows: &[Row]) -> Result<(), ExportError> {
        let part = part::encode(&self.digest, material, rows);
        Ok(write_bytes(&self.path(material), &part)?)
    }

    /// Joins the parts to the table, which appears whole, and removes them. Gives the number of rows.
    ///
    /// # Errors
    /// When a part is missing or damaged, or the table cannot be written. The parts then stay.
    pub fn join(self) -> Result<u64, ExportError> {
        let rows = |material| match self.rows(material) {
            Ok(Some(rows)) => Ok(rows),
            Ok(None) => Err(ExportError::Part(self.path(material))),
            Err(error) => Err(error),
        };
        table::write(&self.plan, &self.description, &self.table, rows)?;
        sync_folder(match self.table.parent() {
            Some(parent) if !parent.as_os_str().is_empty() => parent,
            _ => Path::new("."),
        })?;
        self.remove()?;
        Ok(self.plan.rows())
    }

    /// Whether the folder of this table is there.
    fn is_begun(&self) -> Result<bool, ExportError> {
        let other = |found| {
            Err(ExportError::OtherTable {
                path: self.folder.clone(),
                found,
            })
        };
        match read_at_most(&self.folder.join(PLAN_FILE), PLAN_BYTES_MAX)? {
            Some(found) if found == self.description.as_bytes() => Ok(true),
            Some(found) => other(difference(&found, &self.description, "table")),
            // The plan itself may have been cut short.
            None => match self.occupant()? {
                Some(name) => other(format!("{name:?}")),
                None => Ok(false),
            },
        }
    }

    /// The first thing in the folder but an unfinished plan.
    fn occupant(&self) -> Result<Option<String>, ExportError> {
        let entries = match fs::read_dir(&self.folder) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
            entries => entries.map_err(unable("read", &self.folder))?,
        };
        let unfinished = beside(Path::new(PLAN_FILE));
        for entry in entries {
            let name = entry.map_err(unable("read", &self.folder))?.file_name();
            if name != *unfinished.as_os_str() {
                return Ok(Some(name.to_string_lossy().into_owned()));
            }
        }
        Ok(None)
    }

    /// Whether the table itself is there.
    fn is_whole(&self) -> Result<bool, ExportError> {
        if fs::symlink_metadata(&self.table).is_err() {
            return Ok(false);
        }
        let found = match read_metadata(&self.table, table::PLAN_KEY) {
            Ok(Some(plan)) if plan == self.description => return Ok(true),
            Ok(Some(plan)) => difference(plan.as_bytes(), &self.description, "table"),
            _ => "something else".to_owned(),
        };
        let path = self.table.clone();
        Err(ExportError::OtherTable { path, found })
    }

    /// The rows of a material; `None` where they are missing or damaged.
    fn rows(&self, material: u32) -> Result<Option<Vec<Row>>, ExportError> {
        let sets = &self.plan.sets;
        let found = read_at_most(&self.path(material), part::bytes(sets.len()) as u64)?;
        Ok(found.and_then(|bytes| part::decode(&self.digest, material, sets, &bytes)))
    }

    fn path(&self, material: u32) -> PathBuf {
        self.folder.join(format!("{material:06}.part"))
    }

    /// Removes the folder, the plan last.
    fn remove(&self) -> Result<(), ExportError> {
        let of_materials = self
            .plan
            .materials
            .iter()
            .map(|&material| self.path(material));
        let plan = self.folder.join(PLAN_FILE);
        for path in of_materials.chain([plan]) {
            for path in [beside(&path), path] {
                gone(fs::remove_file(&path), &path)?;
            }
        }
        gone(fs::remove_dir(&self.folder), &self.folder)
    }
}

/// What is not there need not be removed.
fn gone(removed: io::Result<()>, path: &Path) -> Result<(), ExportError> {
    match removed {
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(()),
        removed => Ok(removed.map_err(unable("remove", path))?),
    }
}

/// Reads a file, which comes cut off behind `most` bytes and one more; `None` where there is none.
fn read_at_most(path: &Path, most: u64) -> Result<Option<Vec<u8>>, ExportError> {
    let mut content = Vec::new();
    let read = File::open(path).and_then(|file| file.take(most + 1).read_to_end(&mut content));
    match read {
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(None),
        read => {
            read.map_err(unable("read", path))?;
            Ok(Some(content))
        }
    }
}
