//! Image files to arrays.

use crate::{
    error::{invalid, of_store},
    specification::Specification,
};
use dataset::Digest;
use export::rectify::Rectifier;
use exr::prelude::{ReadChannels, ReadLayers, Vec2, read};
use numpy::{IntoPyArray, PyArray3, PyArrayMethods, PyReadonlyArray3};
use pyo3::prelude::*;
use std::{
    io::Cursor,
    panic::{self, AssertUnwindSafe},
};

/// Rows of pixels and how many a row has.
struct Pixels {
    width: usize,
    values: Vec<f32>,
}

/// The most pixels that a film has along a side. The digest of a file says nothing of its size, where
/// manifest and file are a stranger's.
const SIDE_PIXELS_MAX: usize = *dataset::specification::limits::IMAGE_SIDE_PIXELS.end() as usize;

impl Pixels {
    /// Black pixels; none where they would be too many.
    fn new(size: Vec2<usize>) -> Self {
        let fits = size.width().max(size.height()) <= SIDE_PIXELS_MAX;
        let count = if fits { size.area() } else { 0 };
        Self {
            width: size.width(),
            values: vec![0.0; 3 * count],
        }
    }
}

/// The pixels of an EXR file as (height, width, 3), red, green and blue; checked against its digest
/// where that is given.
#[pyfunction]
#[pyo3(signature = (file, digest=None))]
pub fn decode<'py>(
    py: Python<'py>,
    file: &[u8],
    digest: Option<&str>,
) -> PyResult<Bound<'py, PyArray3<f32>>> {
    let expected = digest
        .map(str::parse::<Digest>)
        .transpose()
        .map_err(invalid)?;
    let pixels = py.detach(|| {
        let found = expected.map(|_| Digest::of(file));
        if let (Some(expected), Some(found)) = (expected, found)
            && expected != found
        {
            return Err(format!("the image has the digest {found}, not {expected}"));
        }
        read_pixels(file)
    });
    let Pixels { width, values } = pixels.map_err(of_store)?;
    let height = values.len() / (3 * width).max(1);
    values.into_pyarray(py).reshape([height, width, 3])
}

fn read_pixels(file: &[u8]) -> Result<Pixels, String> {
    let decoded = panic::catch_unwind(AssertUnwindSafe(|| {
        read()
            .no_deep_data()
            .largest_resolution_level()
            .rgb_channels(
                |size: Vec2<usize>, _| Pixels::new(size),
                |pixels, at, (red, green, blue): (f32, f32, f32)| {
                    let first = 3 * (at.y() * pixels.width + at.x());
                    if let Some(values) = pixels.values.get_mut(first..first + 3) {
                        values.copy_from_slice(&[red, green, blue]);
                    }
                },
            )
            .first_valid_layer()
            .all_attributes()
            .non_parallel()
            .from_buffered(Cursor::new(file))
    }));
    match decoded {
        Ok(Ok(image)) if image.layer_data.channel_data.pixels.values.is_empty() => Err(format!(
            "the image has no pixels, or more than {SIDE_PIXELS_MAX} a side"
        )),
        Ok(Ok(image)) => Ok(image.layer_data.channel_data.pixels),
        Ok(Err(error)) => Err(format!(
            "the file is no EXR image that can be read: {error}"
        )),
        Err(_) => Err("the file is no EXR image that can be read".to_owned()),
    }
}

/// The sample in view `view`, warped to a square: (side, side, 3) of an image of that view.
#[pyfunction]
pub fn rectify<'py>(
    py: Python<'py>,
    specification: &Specification,
    view: u32,
    side: u32,
    pixels: PyReadonlyArray3<'py, f32>,
) -> PyResult<Bound<'py, PyArray3<f32>>> {
    let film = &specification.0.image;
    let shape = [film.height as usize, film.width as usize, 3];
    let pixels = pixels.as_slice()?.as_chunks().0;
    if pixels.len() != shape[0] * shape[1] {
        return Err(invalid(format_args!("the image is not of shape {shape:?}")));
    }
    let warped = py.detach(|| {
        let rectifier = Rectifier::new(&specification.0, view, side)?;
        Ok(rectifier.apply(pixels))
    });
    let warped: Vec<[f32; 3]> =
        warped.map_err(|error: export::rectify::RectifyError| invalid(error))?;
    let side = side as usize;
    warped
        .into_flattened()
        .into_pyarray(py)
        .reshape([side, side, 3])
}
