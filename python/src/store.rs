//! A store open for reading.

use crate::{
    error::{failed, invalid, of_opening, of_store},
    interruptible,
    specification::Specification,
};
use datastore::{ReadOnlyStore, StoreName};
use export::manifest::{Format, export};
use pyo3::{exceptions::PyIndexError, prelude::*, types::PyBytes};
use std::{path::PathBuf, sync::Arc};

/// A store as it was when it was opened.
#[pyclass(frozen, module = "brdfarm._native")]
pub struct Store(Arc<ReadOnlyStore>);

#[pymethods]
impl Store {
    /// Opens a store in a folder or a database.
    #[staticmethod]
    fn open(py: Python<'_>, name: PathBuf) -> PyResult<Self> {
        let opened = interruptible::run(py, move || ReadOnlyStore::open(StoreName::new(name)))?;
        let opened = opened.map_err(|error| of_opening(&error))?;
        Ok(Self(Arc::new(opened)))
    }

    fn specification(&self) -> Specification {
        Specification(self.0.specification().clone())
    }

    /// The materials that are complete, in order.
    fn materials(&self) -> Vec<u32> {
        let asked = self.0.specification().materials;
        let complete = self.0.materials_complete();
        complete.filter(|material| *material < asked).collect()
    }

    /// The bytes of an image's file, checked against its digest, and that digest.
    fn read<'py>(
        &self,
        py: Python<'py>,
        material: u32,
        view: u32,
    ) -> PyResult<(Bound<'py, PyBytes>, String)> {
        let completion = self.0.completion(material).map_err(of_store)?;
        let completion = completion.ok_or_else(|| {
            let sentence = format!("material {material} is not complete in {}", self.0.name());
            PyIndexError::new_err(sentence)
        })?;
        let image = completion.views.get(view as usize).ok_or_else(|| {
            let count = completion.views.len();
            let sentence = format!("there is no view {view}: a material has {count}");
            PyIndexError::new_err(sentence)
        })?;
        let bytes = py.detach(|| self.0.read_image(image));
        let bytes = bytes.map_err(|fault| {
            let path = self.0.image_path(&image.digest);
            of_store(format_args!("{}: {fault}", path.display()))
        })?;
        Ok((PyBytes::new(py, &bytes), image.digest.to_string()))
    }

    /// Writes the manifest of what is complete in Parquet.
    fn write_manifest(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        if path.as_os_str().is_empty() {
            return Err(invalid("a manifest needs a file to be written to"));
        }
        let store = Arc::clone(&self.0);
        let written = interruptible::run(py, move || export(&store, Format::Parquet, true, &path))?;
        written.map(drop).map_err(failed)
    }
}
