//! The header of a PLY file: a text that declares what follows it.

use crate::{
    MeshError,
    limits::{PLY_HEADER_BYTES_MAX, PLY_NAMES_MAX},
    text::{Lines, number, quoted, take_word},
};

/// How numbers are written after the header.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Encoding {
    Text,
    LittleEndian,
    BigEndian,
}

/// The types of numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scalar {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl Scalar {
    fn of(word: &[u8]) -> Option<Self> {
        Some(match word {
            b"char" | b"int8" => Self::I8,
            b"uchar" | b"uint8" => Self::U8,
            b"short" | b"int16" => Self::I16,
            b"ushort" | b"uint16" => Self::U16,
            b"int" | b"int32" => Self::I32,
            b"uint" | b"uint32" => Self::U32,
            b"float" | b"float32" => Self::F32,
            b"double" | b"float64" => Self::F64,
            _ => return None,
        })
    }

    /// Bytes of a number of this type in a binary file.
    pub fn bytes(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }

    /// The number of this type whose bits are the last of these.
    pub fn of_bits(self, bits: u64) -> f64 {
        match self {
            Self::I8 => f64::from(bits as i8),
            Self::U8 => f64::from(bits as u8),
            Self::I16 => f64::from(bits as i16),
            Self::U16 => f64::from(bits as u16),
            Self::I32 => f64::from(bits as i32),
            Self::U32 => f64::from(bits as u32),
            Self::F32 => f64::from(f32::from_bits(bits as u32)),
            Self::F64 => f64::from_bits(bits),
        }
    }

    pub fn is_float(self) -> bool {
        matches!(self, Self::F32 | Self::F64)
    }
}

/// What a property holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    Number(Scalar),
    /// The type of the length, and of what it counts.
    List(Scalar, Scalar),
}

/// A property of each of an element's rows.
#[derive(Debug)]
pub struct Property {
    pub name: String,
    pub kind: Kind,
}

/// A table: so many rows of the same properties.
#[derive(Debug)]
pub struct Element {
    pub name: String,
    pub count: u64,
    pub properties: Vec<Property>,
}

impl Element {
    /// Indices of the rows.
    pub fn rows(&self) -> std::ops::Range<usize> {
        0..usize::try_from(self.count).unwrap_or(usize::MAX)
    }
}

/// What a PLY file declares.
#[derive(Debug)]
pub struct Header {
    pub encoding: Encoding,
    pub elements: Vec<Element>,
}

impl Header {
    /// Parses the header, and returns the lines that follow it.
    pub fn parse(bytes: &[u8]) -> Result<(Self, Lines<'_>), MeshError> {
        let text = bytes.get(..PLY_HEADER_BYTES_MAX).unwrap_or(bytes);
        // A CR alone ends the lines where it ends the first.
        let end = match bytes {
            [_, _, _, b'\r', next, ..] if *next != b'\n' => b'\r',
            _ => b'\n',
        };
        let mut lines = Lines::ending_with(end, text);
        let mut encoding = None;
        let mut elements = Vec::new();
        while let Some((line, true)) = lines.take() {
            let mut rest = line;
            let keyword = take_word(&mut rest).unwrap_or_default();
            let declared = match keyword {
                b"ply" if lines.number() == 1 => Ok(()),
                b"comment" | b"obj_info" | b"" => continue,
                b"format" => format(&mut rest, &mut encoding),
                b"element" => element(&mut rest, &mut elements),
                b"property" => property(&mut rest, &mut elements),
                b"end_header" => Ok(()),
                _ => Err(format!(
                    "{} is no statement of a PLY header",
                    quoted(keyword)
                )),
            };
            let excess = take_word(&mut rest).map(|word| format!("{} is too much", quoted(word)));
            if let Some(message) = declared.err().or(excess) {
                let line = lines.number();
                return Err(MeshError::Syntax { line, message });
            }
            if keyword == b"end_header" {
                let encoding = encoding.ok_or_else(|| MeshError::PlyHeader {
                    message: "has no line `format`".to_owned(),
                })?;
                let length = text.len() - lines.rest().len();
                let lines = lines.go_on(bytes.get(length..).unwrap_or_default());
                return Ok((Self { encoding, elements }, lines));
            }
        }
        let message = if text.len() < bytes.len() {
            format!("does not end within its first {PLY_HEADER_BYTES_MAX} bytes")
        } else {
            "does not end: the file is incomplete".to_owned()
        };
        Err(MeshError::PlyHeader { message })
    }
}

fn format(rest: &mut &[u8], encoding: &mut Option<Encoding>) -> Result<(), String> {
    let word = take_word(rest).unwrap_or_default();
    let declared = match word {
        b"ascii" => Encoding::Text,
        b"binary_little_endian" => Encoding::LittleEndian,
        b"binary_big_endian" => Encoding::BigEndian,
        _ => return Err(format!("{} is no format of PLY files", quoted(word))),
    };
    let version = take_word(rest).unwrap_or_default();
    if version != b"1.0" {
        return Err(format!(
            "the version is {}, but must be 1.0",
            quoted(version)
        ));
    }
    match encoding.replace(declared) {
        None => Ok(()),
        Some(_) => Err("the format is declared twice".to_owned()),
    }
}

fn element(rest: &mut &[u8], elements: &mut Vec<Element>) -> Result<(), String> {
    let name = name(rest, elements.iter().map(|element| element.name.as_str()))?;
    let count = take_word(rest).unwrap_or_default();
    let count =
        number(count).ok_or_else(|| format!("{} is no number of elements", quoted(count)))?;
    elements.push(Element {
        name,
        count,
        properties: Vec::new(),
    });
    Ok(())
}

fn property(rest: &mut &[u8], elements: &mut [Element]) -> Result<(), String> {
    let element = elements
        .last_mut()
        .ok_or("a property stands before the first element")?;
    let mut scalar = || {
        let word = take_word(rest).unwrap_or_default();
        match Scalar::of(word) {
            Some(scalar) => Ok(Some(scalar)),
            None if word == b"list" => Ok(None),
            None => Err(format!("{} is no type of numbers", quoted(word))),
        }
    };
    let kind = match scalar()? {
        Some(scalar) => Kind::Number(scalar),
        None => match (scalar()?, scalar()?) {
            (Some(length), Some(item)) if !length.is_float() => Kind::List(length, item),
            _ => return Err("a list must have a length and numbers of some type".to_owned()),
        },
    };
    let known = element
        .properties
        .iter()
        .map(|property| property.name.as_str());
    let name = name(rest, known)?;
    element.properties.push(Property { name, kind });
    Ok(())
}

/// Takes a name that is not yet known.
fn name<'a>(
    rest: &mut &[u8],
    mut known: impl ExactSizeIterator<Item = &'a str>,
) -> Result<String, String> {
    let word = take_word(rest).ok_or("a name is missing")?;
    if known.len() >= PLY_NAMES_MAX {
        return Err(format!(
            "there are more than {PLY_NAMES_MAX} names before this one"
        ));
    }
    let name = String::from_utf8_lossy(word).into_owned();
    if known.any(|known| known == name) {
        return Err(format!("{} is declared twice", quoted(word)));
    }
    Ok(name)
}
