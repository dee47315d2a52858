//! The native half of the Python package `brdfarm`: arrays in, arrays out.
//!
//! The package itself is Python, in `package/brdfarm`: it checks shapes, has the types that people
//! see, and says in its docstrings what everything is. This half computes. It lets go of the
//! interpreter's lock wherever it computes, and keeps no thread between calls, so that a process may
//! fork.

mod decoding;
mod derivatives;
mod error;
mod interruptible;
mod reflectance;
mod rendering;
mod specification;
mod store;

use pyo3::prelude::*;

#[pymodule]
fn _native(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("RENDERER_VERSION", dataset::RENDERER_VERSION)?;
    module.add("MESH_BYTES_MAX", mesh::limits::FILE_BYTES_MAX)?;
    module.add("StoreError", module.py().get_type::<error::StoreError>())?;
    module.add_class::<specification::Specification>()?;
    module.add_class::<rendering::Rendering>()?;
    module.add_class::<store::Store>()?;
    module.add_function(wrap_pyfunction!(
        specification::manifest_specification,
        module
    )?)?;
    module.add_function(wrap_pyfunction!(reflectance::check_material, module)?)?;
    module.add_function(wrap_pyfunction!(reflectance::evaluate, module)?)?;
    module.add_function(wrap_pyfunction!(reflectance::sample, module)?)?;
    module.add_function(wrap_pyfunction!(reflectance::pdf, module)?)?;
    module.add_function(wrap_pyfunction!(rendering::render, module)?)?;
    module.add_function(wrap_pyfunction!(derivatives::derivatives, module)?)?;
    module.add_function(wrap_pyfunction!(decoding::decode, module)?)?;
    module.add_function(wrap_pyfunction!(decoding::rectify, module)?)?;
    Ok(())
}
