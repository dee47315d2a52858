//! The specification of a dataset.

use crate::{
    error::{invalid, of_file, of_store},
    reflectance::Parameters,
};
use dataset::SpecificationError;
use export::manifest::read::{ReadError, read_specification};
use pyo3::{prelude::*, types::PyBytes};
use std::path::PathBuf;

/// A checked specification.
#[pyclass(frozen, module = "brdfarm._native")]
pub struct Specification(pub dataset::Specification);

#[pymethods]
impl Specification {
    #[staticmethod]
    fn preset() -> Self {
        Self(dataset::Specification::preset())
    }

    #[staticmethod]
    fn load(path: PathBuf) -> PyResult<Self> {
        let loaded = dataset::Specification::load(&path);
        loaded.map(Self).map_err(|error| match &error {
            SpecificationError::Unreadable { error: cause, .. } => of_file(cause, &error),
            _ => invalid(error),
        })
    }

    #[staticmethod]
    fn from_toml(text: &str, source: &str) -> PyResult<Self> {
        let read = dataset::Specification::from_toml(text, source);
        read.map(Self).map_err(invalid)
    }

    /// What `to_json` wrote, with the mesh of `like` if it names the same one.
    #[staticmethod]
    #[pyo3(signature = (text, like = None))]
    fn from_json(text: &str, like: Option<&Self>) -> PyResult<Self> {
        let read = dataset::Specification::from_json(text).map_err(invalid)?;
        Ok(Self(match like {
            Some(like) => read.with_mesh_of(&like.0),
            None => read,
        }))
    }

    /// What the file of its mesh is called, if it names one.
    fn mesh_name(&self) -> Option<String> {
        let mesh = self.0.sample.mesh.as_ref();
        mesh.map(dataset::specification::SampleMesh::file_name)
    }

    /// The bytes of that file, if the mesh is loaded.
    fn mesh<'py>(&self, python: Python<'py>) -> Option<Bound<'py, PyBytes>> {
        let loaded = self.0.sample.loaded_mesh()?;
        Some(PyBytes::new(python, loaded.bytes()))
    }

    /// The same with its mesh loaded from the bytes of its file.
    fn with_mesh(&self, bytes: Vec<u8>) -> PyResult<Self> {
        let loaded = self.0.clone().with_mesh(bytes);
        loaded.map(Self).map_err(invalid)
    }

    fn to_toml(&self) -> String {
        self.0.to_toml()
    }

    fn to_json(&self) -> String {
        self.0.to_json()
    }

    fn hash(&self) -> String {
        self.0.hash().to_string()
    }

    /// The parameters of a material of the set.
    fn material(&self, index: u32) -> Parameters {
        self.0.material(index).material.into()
    }

    /// The split that a material of the set belongs to.
    fn split(&self, index: u32) -> &'static str {
        self.0.split(index).name()
    }
}

/// The specification that a manifest in Parquet carries.
#[pyfunction]
pub fn manifest_specification(path: PathBuf) -> PyResult<Specification> {
    let read = read_specification(&path).map(Specification);
    read.map_err(|error| match &error {
        ReadError::File(file) => of_file(&file.source, &error),
        _ => of_store(error),
    })
}
