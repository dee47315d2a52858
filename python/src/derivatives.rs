//! Derivatives of a view's pixels by the ten parameters.

use crate::{
    error::{failed, invalid},
    interruptible,
    reflectance::Parameters,
    rendering::pool,
    specification::Specification,
};
use inverse::{
    InverseError,
    derivatives::{Differentiator, ImageOfChannels, ParameterDerivative, ViewDerivatives},
};
use numpy::{IntoPyArray, PyArray3, PyArray4, PyArrayMethods};
use pyo3::prelude::*;
use renderer::geometry::BackendChoice;

/// (height, width, 3), and twice (height, width, 3, 10): pixels, derivatives, bounds of their errors.
type Arrays<'py> = (
    Bound<'py, PyArray3<f64>>,
    Bound<'py, PyArray4<f64>>,
    Bound<'py, PyArray4<f64>>,
);

/// Differentiates the pixels of view `view` of a material by its parameters, each a fraction of its
/// range.
#[pyfunction]
#[pyo3(signature = (specification, parameters, view, backend, threads))]
pub fn derivatives<'py>(
    py: Python<'py>,
    specification: &Specification,
    parameters: Parameters,
    view: u32,
    backend: &str,
    threads: usize,
) -> PyResult<Arrays<'py>> {
    let material = parameters.material()?;
    let backend = backend.parse::<BackendChoice>().map_err(invalid)?;
    specification.check_mesh()?;
    let specification = specification.0.clone();
    let found = interruptible::run(py, move || {
        let differentiate = || {
            let differentiator = Differentiator::new(&specification, backend)?;
            differentiator.views(&material, &[view])
        };
        match pool(threads) {
            Some(pool) => pool.install(differentiate),
            None => differentiate(),
        }
    })?;
    let mut found: Vec<ViewDerivatives> = found.map_err(|error| match error {
        InverseError::Render(error) => failed(error),
        error => invalid(error),
    })?;
    let Some(found) = found.pop() else {
        unreachable!("one view was asked for");
    };
    let shape = [found.height as usize, found.width as usize, 3];
    let pixels = found.pixels.as_flattened().to_vec();
    let by = |of: fn(&ParameterDerivative) -> &ImageOfChannels| {
        let images = found.by.each_ref().map(|by| of(by).as_flattened());
        let values = (0..pixels.len()).flat_map(|place| images.map(|image| image[place]));
        let [height, width, channels] = shape;
        let values: Vec<f64> = values.collect();
        values
            .into_pyarray(py)
            .reshape([height, width, channels, images.len()])
    };
    let (values, errors) = (by(|by| &by.values)?, by(|by| &by.errors)?);
    Ok((pixels.into_pyarray(py).reshape(shape)?, values, errors))
}
