//! The reflectance model over arrays of directions.

use crate::error::invalid;
use dataset::{Material, specification::Tint};
use numpy::{
    IntoPyArray, PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray2, PyUntypedArrayMethods,
};
use pyo3::prelude::*;
use renderer::{query, reflectance::Reflectance, vector::Vec3};

/// The ten parameters in the order of [`Material`]'s fields.
#[derive(Clone, Copy, FromPyObject, IntoPyObject)]
pub struct Parameters(f64, f64, f64, f64, [f64; 3], [f64; 3]);

impl From<Material> for Parameters {
    fn from(material: Material) -> Self {
        let Material {
            roughness,
            anisotropy,
            angle_deg,
            ior,
            rgb0,
            rgb90,
        } = material;
        Self(roughness, anisotropy, angle_deg, ior, rgb0, rgb90)
    }
}

impl Parameters {
    /// The material, if its parameters are in range.
    pub fn material(self) -> PyResult<Material> {
        let Self(roughness, anisotropy, angle_deg, ior, rgb0, rgb90) = self;
        let material = Material {
            roughness,
            anisotropy,
            angle_deg,
            ior,
            rgb0,
            rgb90,
        };
        let wrong = |error| invalid(format_args!("the material's {error}"));
        material.check().map_err(wrong)?;
        Ok(material)
    }

    fn reflectance(self, tint: &str) -> PyResult<Reflectance> {
        let tint = match tint {
            "hue" => Tint::Hue,
            "product" => Tint::Product,
            other => {
                let sentence = format!("tint is {other:?}: it is \"hue\" or \"product\"");
                return Err(invalid(sentence));
            }
        };
        Ok(Reflectance::new(&self.material()?, 0.0, tint))
    }
}

/// Checks that parameters are in range.
#[pyfunction]
pub fn check_material(parameters: Parameters) -> PyResult<()> {
    parameters.material().map(drop)
}

/// f(wi, wo) of each pair of directions: (n, 3) for (n, 3) and (n, 3).
#[pyfunction]
pub fn evaluate<'py>(
    py: Python<'py>,
    parameters: Parameters,
    tint: &str,
    wi: PyReadonlyArray2<'py, f64>,
    wo: PyReadonlyArray2<'py, f64>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let reflectance = parameters.reflectance(tint)?;
    let (wi, wo) = (rows::<3>(&wi, "wi")?, rows::<3>(&wo, "wo")?);
    let values = py.detach(|| -> PyResult<Vec<f64>> {
        let mut values = Vec::with_capacity(3 * wi.len());
        for (row, (wi, wo)) in wi.iter().zip(wo).enumerate() {
            let (wi, wo) = (direction("wi", row, *wi)?, direction("wo", row, *wo)?);
            values.extend(reflectance.evaluate(wi, wo));
        }
        Ok(values)
    })?;
    let count = wi.len();
    values.into_pyarray(py).reshape([count, 3])
}

/// The density with which [`sample`] draws wi for wo, a steradian: (n,) for (n, 3) and (n, 3).
#[pyfunction]
pub fn pdf<'py>(
    py: Python<'py>,
    parameters: Parameters,
    wi: PyReadonlyArray2<'py, f64>,
    wo: PyReadonlyArray2<'py, f64>,
) -> PyResult<Bound<'py, PyArray1<f64>>> {
    let reflectance = parameters.reflectance("hue")?;
    let (wi, wo) = (rows::<3>(&wi, "wi")?, rows::<3>(&wo, "wo")?);
    let densities = py.detach(|| {
        let pairs = wi.iter().zip(wo).enumerate();
        let density = |(row, (wi, wo)): (usize, (&[f64; 3], &[f64; 3]))| {
            let (wi, wo) = (direction("wi", row, *wi)?, direction("wo", row, *wo)?);
            Ok(reflectance.density(wi, wo))
        };
        pairs.map(density).collect::<PyResult<Vec<f64>>>()
    })?;
    Ok(densities.into_pyarray(py))
}

/// Directions, their weights and their densities, as arrays.
type Sampled<'py> = (
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray1<f64>>,
);

/// Draws a direction to the light for each direction to the viewer and point of the unit square:
/// (n, 3), (n, 3) and (n,) for (n, 3) and (n, 2). Zeros where the drawn direction lies below the
/// surface.
#[pyfunction]
pub fn sample<'py>(
    py: Python<'py>,
    parameters: Parameters,
    tint: &str,
    wo: PyReadonlyArray2<'py, f64>,
    points: PyReadonlyArray2<'py, f64>,
) -> PyResult<Sampled<'py>> {
    let reflectance = parameters.reflectance(tint)?;
    let (wo, points) = (rows::<3>(&wo, "wo")?, rows::<2>(&points, "u")?);
    let count = wo.len();
    let (wi, weights, densities) = py.detach(|| -> PyResult<_> {
        let mut wi = Vec::with_capacity(3 * count);
        let mut weights = Vec::with_capacity(3 * count);
        let mut densities = Vec::with_capacity(count);
        for (row, (wo, point)) in wo.iter().zip(points).enumerate() {
            let wo = direction("wo", row, *wo)?;
            let drawn = reflectance.sample(wo, inner_point(row, *point)?);
            let (direction, weight, density) = match drawn {
                Some(drawn) => {
                    let Vec3 { x, y, z } = drawn.wi;
                    ([x, y, z], drawn.weight, drawn.density)
                }
                None => ([0.0; 3], [0.0; 3], 0.0),
            };
            wi.extend(direction);
            weights.extend(weight);
            densities.push(density);
        }
        Ok((wi, weights, densities))
    })?;
    Ok((
        wi.into_pyarray(py).reshape([count, 3])?,
        weights.into_pyarray(py).reshape([count, 3])?,
        densities.into_pyarray(py),
    ))
}

/// The rows of an array of N columns that lies in memory row by row.
fn rows<'a, const N: usize>(
    array: &'a PyReadonlyArray2<'_, f64>,
    name: &str,
) -> PyResult<&'a [[f64; N]]> {
    let (rows, rest) = array.as_slice()?.as_chunks();
    match rest.is_empty() && array.shape().last() == Some(&N) {
        true => Ok(rows),
        false => Err(invalid(format_args!("{name} has not {N} columns"))),
    }
}

/// The unit vector along the direction in a row, as the command `brdf` makes it.
fn direction(name: &'static str, row: usize, components: [f64; 3]) -> PyResult<Vec3> {
    query::direction(name, components)
        .map_err(|error| invalid(format_args!("direction {row} of {error}")))
}

/// A point of the unit square; a zero is moved inside, where the lobe is sampled.
fn inner_point(row: usize, point: [f64; 2]) -> PyResult<[f64; 2]> {
    if !point.iter().all(|u| (0.0..1.0).contains(u)) {
        let sentence = format!("u: point {row} is {point:?}, outside [0, 1)");
        return Err(invalid(sentence));
    }
    Ok(point.map(|u| u.max(SMALLEST)))
}

/// Half of the smallest step of NumPy's uniform numbers.
const SMALLEST: f64 = 1.0 / (1_u64 << 54) as f64;
