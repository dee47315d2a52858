//! The numbers after the header of a PLY file.

use super::header::{Element, Encoding, Kind, Property, Scalar};
use crate::{
    MeshError,
    text::{Lines, number, quoted, take_word},
};

/// One row of an element.
#[derive(Clone, Copy)]
pub struct Row<'e> {
    pub element: &'e Element,
    pub index: usize,
}

impl Row<'_> {
    fn truncated(&self) -> MeshError {
        MeshError::Truncated {
            element: self.element.name.clone(),
            index: self.index,
            count: self.element.count,
        }
    }

    /// Says what is wrong with a value of the row.
    pub fn value(&self, property: &Property, message: &'static str) -> MeshError {
        MeshError::PlyValue {
            element: self.element.name.clone(),
            index: self.index,
            property: property.name.clone(),
            message,
        }
    }
}

/// What follows the header, from the next number on.
pub struct Body<'a> {
    encoding: Encoding,
    /// Of a text, the lines after the row's.
    lines: Lines<'a>,
    /// Of a text, what is left of the row's line; of a binary file, of the file.
    rest: &'a [u8],
}

impl<'a> Body<'a> {
    pub fn new(encoding: Encoding, lines: Lines<'a>) -> Self {
        let rest = match encoding {
            Encoding::Text => &[],
            Encoding::LittleEndian | Encoding::BigEndian => lines.rest(),
        };
        Self {
            encoding,
            lines,
            rest,
        }
    }

    /// Refuses more rows than the bytes that are left can hold, before anything is made for them.
    pub fn check_count(&self, element: &Element) -> Result<(), MeshError> {
        let properties = element.properties.iter();
        let row_bytes: usize = match self.encoding {
            // A digit and a space or the line's end, which the last row may lack.
            Encoding::Text => 2 * properties.len(),
            Encoding::LittleEndian | Encoding::BigEndian => properties
                .map(|property| match property.kind {
                    Kind::Number(scalar) | Kind::List(scalar, _) => scalar.bytes(),
                })
                .sum(),
        };
        let (bytes, end) = match self.encoding {
            Encoding::Text => (self.lines.rest().len(), 1),
            Encoding::LittleEndian | Encoding::BigEndian => (self.rest.len(), 0),
        };
        if element.count.saturating_mul(row_bytes as u64) > (bytes + end) as u64 {
            return Err(MeshError::PlyCount {
                element: element.name.clone(),
                count: element.count,
                bytes,
            });
        }
        Ok(())
    }

    /// Begins a row, which in a text is the next line that is not blank.
    pub fn start_row(&mut self, row: Row<'_>) -> Result<(), MeshError> {
        if self.encoding != Encoding::Text {
            return Ok(());
        }
        while let Some((line, _)) = self.lines.take() {
            self.rest = line.trim_ascii();
            if !self.rest.is_empty() {
                return Ok(());
            }
        }
        Err(row.truncated())
    }

    /// Ends a row; nothing may be left of a text's line.
    pub fn end_row(&mut self) -> Result<(), MeshError> {
        if self.encoding != Encoding::Text || self.rest.is_empty() {
            return Ok(());
        }
        let line = self.lines.number();
        let rest = quoted(self.rest.trim_ascii());
        let message = format!("{rest} is more than the header announces for a line");
        Err(MeshError::Syntax { line, message })
    }

    /// Takes a number.
    pub fn number(
        &mut self,
        row: Row<'_>,
        property: &Property,
        scalar: Scalar,
    ) -> Result<f64, MeshError> {
        if self.encoding == Encoding::Text {
            return self.number_of_text(row, property);
        }
        let bytes = self.take(scalar.bytes()).ok_or_else(|| row.truncated())?;
        let byte = |bits: u64, byte: &u8| bits << 8 | u64::from(*byte);
        let bits = if self.encoding == Encoding::BigEndian {
            bytes.iter().fold(0, byte)
        } else {
            bytes.iter().rev().fold(0, byte)
        };
        Ok(scalar.of_bits(bits))
    }

    fn number_of_text(&mut self, row: Row<'_>, property: &Property) -> Result<f64, MeshError> {
        let word = take_word(&mut self.rest);
        if word.is_none() && self.lines.rest().is_empty() {
            return Err(row.truncated());
        }
        let message = match word.map(|word| (word, number(word))) {
            Some((_, Some(number))) => return Ok(number),
            Some((word, None)) => format!("{} is no number", quoted(word)),
            None => format!("the line ends before property `{}`", property.name),
        };
        let line = self.lines.number();
        Err(MeshError::Syntax { line, message })
    }

    /// Takes the length of a property that is a list.
    pub fn list_length(
        &mut self,
        row: Row<'_>,
        property: &Property,
        length: Scalar,
    ) -> Result<usize, MeshError> {
        let number = self.number(row, property, length)?;
        if number >= 0.0 && number <= f64::from(u32::MAX) && number.fract() == 0.0 {
            return Ok(number as usize);
        }
        Err(row.value(
            property,
            "is a list whose length is no whole number of 32 bits",
        ))
    }

    /// Passes over a property.
    pub fn skip(&mut self, row: Row<'_>, property: &Property) -> Result<(), MeshError> {
        let (count, scalar) = match property.kind {
            Kind::Number(scalar) => (1, scalar),
            Kind::List(length, item) => (self.list_length(row, property, length)?, item),
        };
        if self.encoding == Encoding::Text {
            for _ in 0..count {
                self.number_of_text(row, property)?;
            }
            return Ok(());
        }
        count
            .checked_mul(scalar.bytes())
            .and_then(|bytes| self.take(bytes))
            .map(|_| ())
            .ok_or_else(|| row.truncated())
    }

    /// Refuses what follows the last element, but for white space.
    pub fn finish(&self) -> Result<(), MeshError> {
        let excess = match self.encoding {
            Encoding::Text => self.lines.rest(),
            Encoding::LittleEndian | Encoding::BigEndian => self.rest,
        };
        let bytes = excess.len();
        if excess.trim_ascii_start().is_empty() {
            Ok(())
        } else {
            Err(MeshError::PlyExcess { bytes })
        }
    }

    fn take(&mut self, bytes: usize) -> Option<&'a [u8]> {
        let (taken, rest) = self.rest.split_at_checked(bytes)?;
        self.rest = rest;
        Some(taken)
    }
}
