//! What can be wrong with a specification: one sentence each, with the place.

use super::limits::{QUOTED_CHARACTERS_MAX, TEXT_BYTES_MAX};
use std::fmt;

/// Why a specification was refused. Each is one line of text.
#[derive(Debug, thiserror::Error)]
pub enum SpecificationError {
    /// The file cannot be opened or read.
    #[error("{file}: the specification cannot be read: {error}")]
    Unreadable {
        /// The file's name.
        file: String,
        /// Why.
        #[source]
        error: std::io::Error,
    },
    /// The text is longer than [`TEXT_BYTES_MAX`].
    #[error(
        "{file}: a specification has at most {TEXT_BYTES_MAX} bytes, but this is larger; \
         is it the right file?"
    )]
    TooLarge {
        /// The file's name.
        file: String,
    },
    /// The bytes are no text.
    #[error("{file}: byte {offset} is not UTF-8; a specification is a TOML text")]
    NotUtf8 {
        /// The file's name.
        file: String,
        /// The first bad byte, counted from 0.
        offset: usize,
    },
    /// The text is not TOML.
    #[error("{place}: this is not TOML: {message}")]
    Syntax {
        /// Where.
        place: Place,
        /// What the parser says.
        message: String,
    },
    /// The text is not the JSON of a complete specification.
    #[error("this is not a specification as JSON: {message}")]
    Json {
        /// What the parser says, with line and column.
        message: String,
    },
    /// There is no such key.
    #[error("{place}: unknown key `{key}`{hint}")]
    UnknownKey {
        /// Where.
        place: Place,
        /// The key with its tables' names.
        key: String,
        /// The nearest known name, or the known names.
        hint: String,
    },
    /// A value has another type.
    #[error("{place}: `{key}` must be {expected}, but is {found}")]
    WrongType {
        /// Where.
        place: Place,
        /// The key with its tables' names.
        key: String,
        /// The type it has to have.
        expected: &'static str,
        /// What it is.
        found: String,
    },
    /// A value, or values together, are not allowed.
    #[error("{place}: `{key}` {message}")]
    Refused {
        /// Where.
        place: Place,
        /// The key with its tables' names.
        key: String,
        /// What it is and what it may be.
        message: String,
    },
}

/// A place in a file, written `file:line:column`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Place {
    /// The file's name.
    pub file: String,
    /// Line and column, counted from 1, columns in characters; absent where a fault has no one
    /// place in the file.
    pub line_column: Option<(usize, usize)>,
}

impl Place {
    /// The place of a byte of a text.
    pub(super) fn of(file: &str, text: &str, offset: usize) -> Self {
        let before = &text[..text.floor_char_boundary(offset)];
        let line = before.bytes().filter(|byte| *byte == b'\n').count() + 1;
        let line_start = before.rfind('\n').map_or(0, |end| end + 1);
        let column = before[line_start..].chars().count() + 1;
        Self {
            file: file.to_owned(),
            line_column: Some((line, column)),
        }
    }
}

impl fmt::Display for Place {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.line_column {
            Some((line, column)) => write!(formatter, "{}:{line}:{column}", self.file),
            None => formatter.write_str(&self.file),
        }
    }
}

/// Text of a file as an error may repeat it: one line, bounded.
pub(super) fn quoted(text: &str) -> String {
    let mut shown = String::new();
    for character in text.chars().take(QUOTED_CHARACTERS_MAX) {
        match character {
            '"' | '\'' | '\\' => shown.push(character),
            _ => shown.extend(character.escape_debug()),
        }
    }
    if text.chars().nth(QUOTED_CHARACTERS_MAX).is_some() {
        shown.push_str("...");
    }
    shown
}
