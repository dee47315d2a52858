//! A TOML text while it is read, with the place of every value for the errors.

use super::{
    error::{Place, SpecificationError, quoted},
    fault::Fault,
    suggest::hint,
};
use std::{collections::BTreeMap, ops::Range, path::Path};
use toml::{
    Spanned,
    de::{DeTable, DeValue},
};

/// What a value is read into.
pub(super) trait Field {
    /// Replaces what the value says. The range is checked later, with everything else.
    fn read(
        &mut self,
        value: &Spanned<DeValue<'_>>,
        key: &str,
        reader: &mut Reader<'_>,
    ) -> Result<(), SpecificationError>;
}

/// A text that is being read, and where its values stand.
pub(super) struct Reader<'a> {
    pub(super) source: &'a str,
    pub(super) text: &'a str,
    /// Where files that the text names are looked for.
    pub(super) folder: Option<&'a Path>,
    /// The bytes of each value by its key, such as `views[2].checker`.
    pub(super) spans: BTreeMap<String, Range<usize>>,
}

impl Reader<'_> {
    pub(super) fn place(&self, offset: usize) -> Place {
        Place::of(self.source, self.text, offset)
    }

    pub(super) fn syntax(&self, error: &toml::de::Error) -> SpecificationError {
        let end = self.text.trim_end().len();
        let offset = error.span().map_or(0, |span| span.start);
        let mut message = one_line(error.message());
        if offset >= end {
            message.push_str("; the file ends here: is it cut short?");
        }
        SpecificationError::Syntax {
            place: self.place(offset),
            message,
        }
    }

    pub(super) fn wrong_type(
        &self,
        key: &str,
        expected: &'static str,
        value: &Spanned<DeValue<'_>>,
    ) -> SpecificationError {
        SpecificationError::WrongType {
            place: self.place(value.span().start),
            key: key.to_owned(),
            expected,
            found: described(value.get_ref()),
        }
    }

    /// The sentence about a fault, at the place of the first of its keys that the text has, or else
    /// of the nearest table around one of them.
    pub(super) fn refused(&self, fault: Fault) -> SpecificationError {
        let given = fault.keys.iter().find_map(|key| self.spans.get(key));
        let around = || fault.keys.iter().find_map(|key| self.span_around(key));
        let place = match given.or_else(around) {
            Some(span) => self.place(span.start),
            None => Place {
                file: self.source.to_owned(),
                line_column: None,
            },
        };
        let message = match fault.value {
            None => fault.rule,
            Some(value) => {
                // As the file spells it: a number beyond a field's type was cut on the way here.
                let spelled = given.and_then(|span| self.text.get(span.clone()));
                let value = spelled.map_or(value, quoted);
                format!("is {value}, but must be {}", fault.rule)
            }
        };
        let key = fault.keys.into_iter().next().unwrap_or_default();
        SpecificationError::Refused {
            place,
            key,
            message,
        }
    }

    fn span_around(&self, key: &str) -> Option<&Range<usize>> {
        let mut outer = key;
        while let Some(end) = outer.rfind(['.', '[']) {
            outer = &outer[..end];
            if let Some(span) = self.spans.get(outer) {
                return Some(span);
            }
        }
        None
    }

    /// Reads a table's entries, in the order of the file, each into the field of its name.
    pub(super) fn read_table(
        &mut self,
        table: &DeTable<'_>,
        table_key: &str,
        fields: &mut [(&'static str, &mut dyn Field)],
    ) -> Result<(), SpecificationError> {
        let mut entries: Vec<_> = table.iter().collect();
        entries.sort_by_key(|(name, _)| name.span().start);
        for (name, value) in entries {
            let key = below(table_key, name.get_ref());
            let Some((_, field)) = fields.iter_mut().find(|(known, _)| known == name.get_ref())
            else {
                let known: Vec<_> = fields.iter().map(|(known, _)| *known).collect();
                return Err(SpecificationError::UnknownKey {
                    place: self.place(name.span().start),
                    key: quoted(&key),
                    hint: hint(table_key, name.get_ref(), &known),
                });
            };
            self.read_field(value, key, *field)?;
        }
        Ok(())
    }

    pub(super) fn read_field(
        &mut self,
        value: &Spanned<DeValue<'_>>,
        key: String,
        field: &mut dyn Field,
    ) -> Result<(), SpecificationError> {
        field.read(value, &key, self)?;
        self.spans.insert(key, value.span());
        Ok(())
    }
}

/// A parser's message, which may repeat parts of the text, on one line and bounded.
pub(super) fn one_line(message: &str) -> String {
    const MESSAGE_CHARACTERS_MAX: usize = 200;
    let printable = |c: char| if c.is_control() { ' ' } else { c };
    let line: String = message.chars().map(printable).collect();
    let words: Vec<_> = line.split_whitespace().collect();
    words
        .join(" ")
        .chars()
        .take(MESSAGE_CHARACTERS_MAX)
        .collect()
}

fn below(table_key: &str, name: &str) -> String {
    match table_key {
        "" => name.to_owned(),
        _ => format!("{table_key}.{name}"),
    }
}

/// A value as an error names it.
fn described(value: &DeValue<'_>) -> String {
    match value {
        DeValue::String(text) => format!("the text \"{}\"", quoted(text)),
        DeValue::Integer(number) => format!("the integer {}", quoted(&number.to_string())),
        DeValue::Float(number) => format!("the float {}", quoted(number.as_str())),
        DeValue::Boolean(truth) => truth.to_string(),
        DeValue::Datetime(_) => "a date or time".to_owned(),
        DeValue::Array(values) => format!("a list of {}", values.len()),
        DeValue::Table(_) => "a table".to_owned(),
    }
}
