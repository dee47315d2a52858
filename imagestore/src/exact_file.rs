//! The parts of an image's file that are exact: its header, byte for byte, and where its blocks
//! lie. Only the packed pixels are left to the sender, and they take no more than raw ones.

use crate::rejection::{Rejection, layout, same};
use dataset::{IMAGE_BLOCK_LINES, ImageHeader, Specification, image_file_header, image_line_bytes};

/// Bytes of a block's place in the table.
const PLACE_BYTES: usize = 8;

/// Bytes before a block's pixels: its first line, and how many bytes the pixels take.
const BLOCK_HEAD_BYTES: usize = 8;

/// Checks everything of a file but its pixels, given what the file says of itself.
pub(crate) fn check(
    bytes: &[u8],
    specification: &Specification,
    identity: &ImageHeader,
) -> Result<(), Rejection> {
    let header = image_file_header(specification, identity);
    if !bytes.starts_with(&header) {
        return Err(Rejection::FileHeader(first_difference(bytes, &header)));
    }
    check_blocks(bytes, header.len(), specification, |_, _| Ok(()))
}

/// Checks that blocks follow the table and each other without a gap, from the top down, and that
/// the file ends with the last. Hands out each block's first line and packed pixels.
pub(crate) fn check_blocks<'a>(
    bytes: &'a [u8],
    table: usize,
    specification: &Specification,
    mut visit: impl FnMut(u32, &'a [u8]) -> Result<(), Rejection>,
) -> Result<(), Rejection> {
    let film_lines = specification.image.height;
    let blocks = film_lines.div_ceil(IMAGE_BLOCK_LINES);
    let mut place = table + blocks as usize * PLACE_BYTES;
    for block in 0..blocks {
        let told = word::<PLACE_BYTES>(bytes, table + block as usize * PLACE_BYTES)?;
        same("place of a block", u64::from_le_bytes(told), place as u64)?;
        let first_line = block * IMAGE_BLOCK_LINES;
        let line = word(bytes, place)?;
        same("block's first line", u32::from_le_bytes(line), first_line)?;
        let size = u32::from_le_bytes(word(bytes, place + 4)?);
        let lines = IMAGE_BLOCK_LINES.min(film_lines - first_line);
        let size_max = u64::from(lines) * image_line_bytes(specification);
        if u64::from(size) > size_max {
            let expected = format_args!("at most {size_max}");
            return Err(layout("size of a block in bytes", size, expected));
        }
        let pixels = place + BLOCK_HEAD_BYTES;
        place = pixels + size as usize;
        let packed = bytes.get(pixels..place).ok_or_else(|| ends(place))?;
        visit(first_line, packed)?;
    }
    same("size in bytes, as its blocks add up,", bytes.len(), place)
}

fn word<const BYTES: usize>(bytes: &[u8], place: usize) -> Result<[u8; BYTES], Rejection> {
    let word = bytes.get(place..).and_then(<[u8]>::first_chunk);
    word.copied().ok_or_else(|| ends(place))
}

fn ends(place: usize) -> Rejection {
    Rejection::Unreadable(format!("it ends within a block, before {place}"))
}

/// An attribute as it stands in a file.
#[derive(PartialEq, Eq)]
struct Attribute<'a> {
    name: &'a [u8],
    // Its type and its value with its size.
    rest: &'a [u8],
}

/// The attributes of a file, as far as they can be read.
struct Attributes<'a>(&'a [u8]);

impl<'a> Attributes<'a> {
    fn of(file: &'a [u8]) -> Self {
        // After the magic number and the version.
        Self(file.get(8..).unwrap_or_default())
    }
}

impl<'a> Iterator for Attributes<'a> {
    type Item = Attribute<'a>;

    fn next(&mut self) -> Option<Attribute<'a>> {
        let text_bytes = |bytes: &[u8]| bytes.iter().position(|byte| *byte == 0);
        let name_bytes = text_bytes(self.0).filter(|bytes| *bytes > 0)?;
        let (name, rest) = self.0.split_at(name_bytes);
        let rest = &rest[1..];
        let value = text_bytes(rest)? + 1 + 4;
        let size = rest.get(..value)?.last_chunk()?;
        let end = value.checked_add(u32::from_le_bytes(*size) as usize)?;
        let (rest, next) = rest.split_at_checked(end)?;
        self.0 = next;
        Some(Attribute { name, rest })
    }
}

/// What is wrong with a file's header that is not the one expected.
fn first_difference(file: &[u8], expected: &[u8]) -> String {
    let has = |mut file: Attributes<'_>, name: &[u8]| file.any(|found| found.name == name);
    let text = |name: &[u8]| format!("{:?}", String::from_utf8_lossy(name));
    let mut wanted = Attributes::of(expected);
    let mut found = Attributes::of(file);
    loop {
        return match (found.next(), wanted.next()) {
            (Some(found), Some(wanted)) if found == wanted => continue,
            (Some(found), Some(wanted)) if found.name == wanted.name => {
                let name = text(found.name);
                format!("has another value of the attribute {name} than the renderer writes")
            }
            (Some(found), _) if !has(Attributes::of(expected), found.name) => {
                let name = text(found.name);
                format!("has the attribute {name}, which the renderer does not write")
            }
            (_, Some(wanted)) if !has(Attributes::of(file), wanted.name) => {
                format!("lacks the attribute {}", text(wanted.name))
            }
            (Some(found), _) => {
                let name = text(found.name);
                format!("has the attribute {name} where the renderer does not write it")
            }
            (None, _) => "is not the one that the renderer writes".to_owned(),
        };
    }
}
