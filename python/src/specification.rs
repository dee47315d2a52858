//! The specification of a dataset.

use crate::{
    error::{invalid, of_file, of_store},
    reflectance::Parameters,
};
use dataset::{
    SpecificationError,
    specification::{SampleMesh, Shape},
};
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

    #[staticmethod]
    fn from_json(text: &str) -> PyResult<Self> {
        let read = dataset::Specification::from_json(text);
        read.map(Self).map_err(invalid)
    }

    fn to_toml(&self) -> String {
        self.0.to_toml()
    }

    fn to_json(&self) -> String {
        self.0.to_json()
    }

    /// The bytes of the mesh's file, where the sample is a mesh that is loaded.
    fn mesh<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyBytes>> {
        let loaded = self.0.sample.loaded_mesh()?;
        Some(PyBytes::new(py, loaded.bytes()))
    }

    /// What the mesh's file is called beside a file of the specification, where the sample is a mesh.
    fn mesh_file_name(&self) -> Option<String> {
        self.0.sample.mesh.as_ref().map(SampleMesh::file_name)
    }

    /// The same with the mesh that these bytes hold: the one that it names, or else the sample becomes it.
    fn with_mesh(&self, py: Python<'_>, bytes: &[u8]) -> PyResult<Self> {
        let (specification, bytes) = (self.0.clone(), bytes.to_vec());
        // Millions of triangles take seconds.
        let made = py.detach(move || match specification.sample.mesh {
            Some(_) => specification
                .with_mesh(bytes)
                .map_err(|error| error.to_string()),
            None => of_mesh(specification, bytes),
        });
        made.map(Self).map_err(invalid)
    }

    /// The same with the mesh that another has loaded, if that is the one that it names.
    fn with_mesh_of(&self, other: &Self) -> Self {
        Self(self.0.clone().with_mesh_of(&other.0))
    }

    /// Nothing where a mesh that it names is loaded, or it names none; otherwise a `ValueError`, which says
    /// how a mesh is loaded.
    pub fn check_mesh(&self) -> PyResult<()> {
        let sample = &self.0.sample;
        match &sample.mesh {
            Some(mesh) if sample.loaded_mesh().is_none() => Err(invalid(format_args!(
                "the sample is the mesh {}, which is not loaded: give its file or its bytes to \
                 Specification.with_mesh()",
                mesh.digest()
            ))),
            _ => Ok(()),
        }
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

/// A specification whose sample becomes the mesh of these bytes.
fn of_mesh(
    mut specification: dataset::Specification,
    bytes: Vec<u8>,
) -> Result<dataset::Specification, String> {
    let mesh = SampleMesh::of_bytes(bytes)
        .map_err(|error| format!("the mesh cannot be rendered: {error}"))?;
    specification.sample.shape = Shape::Mesh;
    specification.sample.mesh = Some(mesh.clone());
    // What is checked of a specification depends on its sample.
    let checked = dataset::Specification::from_json(&specification.to_json());
    let mut checked = checked.map_err(|error| error.to_string())?;
    checked.sample.mesh = Some(mesh);
    Ok(checked)
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
