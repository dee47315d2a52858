//! NumPy arrays: version 1.0 of the format of `numpy.lib.format`, little-endian, in C order.

use super::Picture;
use dataset::specification::Pixel;
use half::f16;

/// What the header's length is a multiple of.
const ALIGNMENT_BYTES: usize = 64;

/// Magic, version and length of the header.
const PREFIX_BYTES: usize = 10;

/// An array of height x width x 3: float16 or float32, as the image's pixels are.
pub(super) fn encode(picture: &Picture) -> Vec<u8> {
    let kind = match picture.pixel {
        Pixel::Half => "<f2",
        Pixel::Float => "<f4",
    };
    let mut header = format!(
        "{{'descr': '{kind}', 'fortran_order': False, 'shape': ({}, {}, 3), }}",
        picture.height, picture.width
    );
    let unpadded = PREFIX_BYTES + header.len() + 1;
    let padding = unpadded.next_multiple_of(ALIGNMENT_BYTES) - unpadded;
    header.extend(std::iter::repeat_n(' ', padding));
    header.push('\n');
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((header.len() as u16).to_le_bytes());
    bytes.extend(header.as_bytes());
    for channel in picture.values.as_flattened() {
        match picture.pixel {
            // Exact for images, whose values were 16-bit floats; rectified ones are rounded as in
            // their EXR file.
            Pixel::Half => {
                let half = f16::from_f32_const(channel.min(f16::MAX.to_f32_const()));
                bytes.extend(half.to_le_bytes());
            }
            Pixel::Float => bytes.extend(channel.to_le_bytes()),
        }
    }
    bytes
}
