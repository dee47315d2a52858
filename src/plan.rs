//! What a set comes to, told before it is rendered.

use crate::plural::{count, time};
use dataset::{Specification, specification::Pixel};

/// Processor time of an image, seconds: a fixed part, and a part that grows with its pixels and is
/// given for the preset's 128 x 128. The sum, 13.4 ms, is the mean over the preset's 9,000 materials,
/// storage and the check of every image included, on one core of an AMD EPYC with AVX-512. The shares
/// were fitted to the first 1,000 materials on films of 32 pixels a side, which took 9.1 ms.
const SECONDS: [f64; 2] = [0.008_7, 0.004_7];

/// Size of an image with 16-bit floats, bytes, in the same two parts. The sum is the mean over the
/// preset's 9,000 materials; on films of 32 pixels a side an image has 2,740.
const BYTES: [f64; 2] = [2_100.0, 10_000.0];

/// Says how many materials and images are to be rendered, and about how many bytes they take. For a
/// set with the preset's parameters and accuracy it also says how long: on that many cores, or as the
/// time of one core.
pub fn line(specification: &Specification, images: u64, cores: Option<usize>) -> String {
    let preset = Specification::preset();
    let pixels = |set: &Specification| f64::from(set.image.width) * f64::from(set.image.height);
    let scale = pixels(specification) / pixels(&preset);
    let depth = match specification.image.pixel {
        Pixel::Half => 1.0,
        Pixel::Float => 2.0,
    };
    let of_all = |[each, more]: [f64; 2]| images as f64 * (each + more * scale);
    let megabytes = of_all(BYTES) * depth / 1e6;
    let materials = images.div_ceil(specification.views.len() as u64);
    let mut line = format!(
        "to render: {}, {} of {} x {}, about {megabytes:.0} MB",
        count(materials, "material"),
        count(images, "image"),
        specification.image.width,
        specification.image.height,
    );
    let as_in_the_preset = specification.accuracy == preset.accuracy
        && specification.integrator == preset.integrator
        && specification.parameters == preset.parameters;
    if as_in_the_preset {
        let seconds = of_all(SECONDS);
        line += &match cores {
            Some(cores) => format!(
                " and {} on {}",
                time(seconds / cores as f64),
                count(cores as u64, "core")
            ),
            None => format!(" and {} of a core", time(seconds)),
        };
    }
    line
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_the_preset_comes_to() {
        let mut set = Specification::preset();
        let told = "to render: 9000 materials, 126000 images of 128 x 128, about 1525 MB";
        assert_eq!(
            line(&set, 126_000, Some(2)),
            format!("{told} and 14 min on 2 cores")
        );
        assert_eq!(
            line(&set, 126_000, None),
            format!("{told} and 28 min of a core")
        );
        // Nobody measured that.
        set.accuracy.relative /= 10.0;
        assert_eq!(line(&set, 126_000, Some(2)), told);
    }
}
