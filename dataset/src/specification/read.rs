//! Reading a specification from TOML, over the preset, and from JSON.

use super::{
    Specification,
    check::{Fault, check},
    error::{Place, SpecificationError, quoted},
    fields::Field,
    limits::TEXT_BYTES_MAX,
    suggest::hint,
};
use std::{collections::BTreeMap, fs::File, io::Read, ops::Range, path::Path, sync::LazyLock};
use toml::{
    Spanned,
    de::{DeTable, DeValue},
};

static PRESET: LazyLock<Specification> = LazyLock::new(|| {
    toml::from_str(include_str!("../maxbrdf.toml"))
        .unwrap_or_else(|error| unreachable!("the preset is complete, as a test shows: {error}"))
});

impl Specification {
    /// The built-in preset, `maxbrdf`: the paper's dataset.
    pub fn preset() -> Self {
        PRESET.clone()
    }

    /// Reads a TOML text over the preset: what it leaves out keeps the preset's value. If it has
    /// `[[views]]`, they replace all of the preset's; a view's table that leaves something out has
    /// camera and light at 45 degrees, no turn and no chart. A list replaces a list. An integer is
    /// accepted where a float is meant.
    ///
    /// # Errors
    ///
    /// The first fault found, as one sentence that starts with `source:line:column`; `source` is
    /// the file's name.
    pub fn from_toml(text: &str, source: &str) -> Result<Self, SpecificationError> {
        if text.len() > TEXT_BYTES_MAX {
            let file = source.to_owned();
            return Err(SpecificationError::TooLarge { file });
        }
        let mut reader = Reader {
            source,
            text,
            spans: BTreeMap::new(),
        };
        let table = DeTable::parse(text).map_err(|error| reader.syntax(&error))?;
        let mut specification = Self::preset();
        let document = Spanned::new(table.span(), DeValue::Table(table.into_inner()));
        specification.read(&document, "", &mut reader)?;
        check(&specification).map_err(|fault| reader.refused(fault))?;
        Ok(specification)
    }

    /// Reads a TOML file as [`Self::from_toml`] does.
    ///
    /// # Errors
    ///
    /// Also where the file cannot be read, has more than [`TEXT_BYTES_MAX`] bytes or is not UTF-8.
    pub fn load(path: &Path) -> Result<Self, SpecificationError> {
        let file = path.display().to_string();
        let mut bytes = Vec::new();
        let read = File::open(path).and_then(|opened| {
            opened
                .take(TEXT_BYTES_MAX as u64 + 1)
                .read_to_end(&mut bytes)
        });
        if let Err(error) = read {
            return Err(SpecificationError::Unreadable { file, error });
        }
        if bytes.len() > TEXT_BYTES_MAX {
            return Err(SpecificationError::TooLarge { file });
        }
        match str::from_utf8(&bytes) {
            Ok(text) => Self::from_toml(text, &file),
            Err(error) => Err(SpecificationError::NotUtf8 {
                file,
                offset: error.valid_up_to(),
            }),
        }
    }

    /// Reads what [`Self::to_json`] wrote: every field is required, and checked like a file's.
    ///
    /// # Errors
    ///
    /// The first fault found, as one sentence.
    pub fn from_json(text: &str) -> Result<Self, SpecificationError> {
        const SOURCE: &str = "specification as JSON";
        if text.len() > TEXT_BYTES_MAX {
            let file = SOURCE.to_owned();
            return Err(SpecificationError::TooLarge { file });
        }
        let specification: Self =
            serde_json::from_str(text).map_err(|error| SpecificationError::Json {
                message: one_line(&error.to_string()),
            })?;
        let reader = Reader {
            source: SOURCE,
            text: "",
            spans: BTreeMap::new(),
        };
        check(&specification).map_err(|fault| reader.refused(fault))?;
        Ok(specification)
    }
}

/// A parser's message, which may repeat parts of the text, on one line and bounded.
fn one_line(message: &str) -> String {
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

/// A text that is being read, and where its values stand.
pub(super) struct Reader<'a> {
    source: &'a str,
    text: &'a str,
    /// The bytes of each value by its key, such as `views[2].checker`.
    spans: BTreeMap<String, Range<usize>>,
}

impl Reader<'_> {
    fn place(&self, offset: usize) -> Place {
        Place::of(self.source, self.text, offset)
    }

    fn syntax(&self, error: &toml::de::Error) -> SpecificationError {
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
    fn refused(&self, fault: Fault) -> SpecificationError {
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
