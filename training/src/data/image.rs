//! One rectified image of an export.

use crate::error::{TrainingError, bad_input};
use exr::prelude::*;
use half::f16;
use std::path::Path;

struct Square {
    size: [usize; 2],
    // Empty where the size is not the one that is expected: a header may claim any.
    values: Vec<[f32; 3]>,
}

/// Reads an image of `from` x `from` pixels as three planes of `to` x `to`, means of blocks.
///
/// # Errors
/// When the file is missing, is no such image, or has a value that is not finite or negative.
pub(super) fn read(
    path: &Path,
    from: u32,
    to: u32,
    planes: &mut [f16],
) -> std::result::Result<(), TrainingError> {
    if !path.is_file() {
        return Err(bad_input(
            path,
            "the image is missing: run the export again, it goes on where it stopped",
        ));
    }
    let side = from as usize;
    let read = exr::prelude::read()
        .no_deep_data()
        .largest_resolution_level()
        .rgb_channels(
            move |size, _| {
                let size = [size.width(), size.height()];
                let expected = size == [side, side];
                Square {
                    size,
                    values: vec![[0.0; 3]; if expected { side * side } else { 0 }],
                }
            },
            move |square: &mut Square, position, (r, g, b): (f32, f32, f32)| {
                let place = position.y() * side + position.x();
                if let Some(value) = square.values.get_mut(place) {
                    *value = [r, g, b];
                }
            },
        )
        .first_valid_layer()
        .all_attributes()
        .non_parallel()
        .from_file(path);
    let image = read.map_err(|error| bad_input(path, format!("no OpenEXR image: {error}")))?;
    let square = image.layer_data.channel_data.pixels;
    let [width, height] = square.size;
    if square.values.is_empty() {
        return Err(bad_input(
            path,
            format!(
                "the image has {width} x {height} pixels where the export's have {side} x {side}"
            ),
        ));
    }
    average(path, &square.values, side, to as usize, planes)
}

fn average(
    path: &Path,
    values: &[[f32; 3]],
    from: usize,
    to: usize,
    planes: &mut [f16],
) -> std::result::Result<(), TrainingError> {
    let block = from / to;
    for row in 0..to {
        for column in 0..to {
            let mut sum = [0.0; 3];
            for y in row * block..(row + 1) * block {
                for x in column * block..(column + 1) * block {
                    let value = values[y * from + x];
                    if value.iter().any(|v| !v.is_finite() || *v < 0.0) {
                        return Err(bad_input(
                            path,
                            format!("pixel ({x}, {y}) is {value:?}: verify the store"),
                        ));
                    }
                    for (sum, channel) in sum.iter_mut().zip(value) {
                        *sum += f64::from(channel);
                    }
                }
            }
            for (channel, sum) in sum.into_iter().enumerate() {
                let mean = f16::from_f64_const(sum / (block * block) as f64);
                planes[(channel * to + row) * to + column] = mean.min(f16::MAX);
            }
        }
    }
    Ok(())
}
