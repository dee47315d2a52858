//! How an image's OpenEXR file begins, and how large it can be.
//!
//! Everything before the table of blocks is a function of the specification and of what the image
//! says of itself. The renderer's encoder writes exactly these bytes, which a test of the renderer
//! compares; a coordinator, which has no renderer, accepts no others. Were other attributes let
//! through, 16 x 16 pixels could come with 90 MB of junk.
//!
//! The format: a magic number, a version, then attributes. An attribute is its name and its type,
//! each ended by a zero byte, the size of its value and the value; a zero byte ends them all.
//! Numbers are little-endian. <https://openexr.com/en/latest/OpenEXRFileLayout.html>

use crate::{IMAGE_HEADER_ATTRIBUTE, ImageHeader, Specification, specification::Pixel};

/// Lines of pixels in a block: what OpenEXR's ZIP compression packs together.
pub const IMAGE_BLOCK_LINES: u32 = 16;

/// The magic number, and version 2 with no flag set: scan lines, one part, short names.
const MAGIC_AND_VERSION: [u8; 8] = [0x76, 0x2f, 0x31, 0x01, 2, 0, 0, 0];

/// What the renderer calls itself in the attribute `software`.
pub const IMAGE_SOFTWARE: &str = "brdfarm";

/// Chromaticities of Rec.709's primaries, red, green and blue, and of its white, D65; x and y of
/// each (ITU-R BT.709-6, item 1.3 and 1.4).
pub const REC709_CHROMATICITIES: [f32; 8] = [0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290];

/// Bytes of the text's size before the text that says which image it is, and of the end of all
/// attributes after it.
pub const IMAGE_FILE_TEXT_OVERHEAD: usize = 4 + 1;

/// Room for the attributes before that text, bytes.
const ATTRIBUTES_BYTES: usize = 1024;

/// Bytes of a block's place in the table, and of the line and size that begin a block.
const BLOCK_OVERHEAD_BYTES: u64 = 8 + 8;

/// The file's bytes up to the table of blocks.
pub fn image_file_header(specification: &Specification, header: &ImageHeader) -> Vec<u8> {
    let text = header.to_json();
    let mut file = image_file_start(specification);
    file.reserve_exact(text.len() + IMAGE_FILE_TEXT_OVERHEAD);
    file.extend((text.len() as u32).to_le_bytes());
    file.extend(text.as_bytes());
    file.push(0);
    file
}

/// How the file of every image of a dataset begins: up to the size of the text that says which image
/// it is. That text is the last attribute.
pub fn image_file_start(specification: &Specification) -> Vec<u8> {
    let film = &specification.image;
    let blocks = film.height.div_ceil(IMAGE_BLOCK_LINES);
    let window = numbers(&[0, 0, film.width - 1, film.height - 1]);
    let chromaticities = REC709_CHROMATICITIES.map(f32::to_le_bytes);
    let white = specification.white_luminance() as f32;
    let mut file = Vec::with_capacity(ATTRIBUTES_BYTES);
    file.extend(MAGIC_AND_VERSION);
    let attributes: [(&str, &str, &[u8]); 13] = [
        ("chunkCount", "int", &numbers(&[blocks])),
        ("channels", "chlist", &channels(film.pixel)),
        // ZIP, 16 lines a block; from the top down.
        ("compression", "compression", &[3]),
        ("lineOrder", "lineOrder", &[0]),
        ("displayWindow", "box2i", &window),
        ("pixelAspectRatio", "float", &1_f32.to_le_bytes()),
        ("screenWindowCenter", "v2f", &[0; 8]),
        ("screenWindowWidth", "float", &1_f32.to_le_bytes()),
        ("dataWindow", "box2i", &window),
        ("type", "string", b"scanlineimage"),
        ("whiteLuminance", "float", &white.to_le_bytes()),
        (
            "chromaticities",
            "chromaticities",
            chromaticities.as_flattened(),
        ),
        ("software", "string", IMAGE_SOFTWARE.as_bytes()),
    ];
    for (name, kind, value) in attributes {
        name_attribute(&mut file, name, kind);
        file.extend((value.len() as u32).to_le_bytes());
        file.extend(value);
    }
    name_attribute(&mut file, IMAGE_HEADER_ATTRIBUTE, "string");
    file
}

fn name_attribute(file: &mut Vec<u8>, name: &str, kind: &str) {
    for text in [name, kind] {
        file.extend(text.as_bytes());
        file.push(0);
    }
}

/// The largest file of an image whose header has `header_bytes` bytes: what does not compress is
/// stored as it is.
pub fn image_file_bytes_max(specification: &Specification, header_bytes: u64) -> u64 {
    let film = &specification.image;
    let blocks = u64::from(film.height.div_ceil(IMAGE_BLOCK_LINES));
    let lines = u64::from(film.height);
    header_bytes + blocks * BLOCK_OVERHEAD_BYTES + lines * image_line_bytes(specification)
}

/// Bytes of a line of pixels that is not compressed.
pub fn image_line_bytes(specification: &Specification) -> u64 {
    let film = &specification.image;
    3 * u64::from(film.width) * film.pixel.bytes()
}

/// The channels by name, each with its type, whether it is perceptually linear, three bytes that
/// are reserved, and its sampling along x and y.
fn channels(pixel: Pixel) -> Vec<u8> {
    let sample_type = match pixel {
        Pixel::Half => 1,
        Pixel::Float => 2,
    };
    let mut list = Vec::new();
    for name in [b'B', b'G', b'R'] {
        list.extend([name, 0]);
        list.extend(numbers(&[sample_type, 0, 1, 1]));
    }
    list.push(0);
    list
}

fn numbers(numbers: &[u32]) -> Vec<u8> {
    let bytes = numbers.iter().flat_map(|number| number.to_le_bytes());
    bytes.collect()
}
