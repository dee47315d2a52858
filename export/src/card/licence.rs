//! Under which licence images are published.

use serde_json::{Value, json};
use spdx::{Expression, ParseMode, identifiers::LICENSES};
use std::{
    fmt::{self, Display, Formatter},
    str::FromStr,
};

/// The longest that is taken, bytes.
const BYTES_MAX: usize = 1000;

/// A licence.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum Licence {
    /// Nobody said.
    #[default]
    Unknown,
    /// An SPDX expression, as `CC-BY-4.0` or `MIT OR Apache-2.0`.
    Spdx(String),
    /// The address of its text.
    Url(String),
}

impl FromStr for Licence {
    type Err = String;

    /// Identifiers are understood in capitals and in small letters.
    fn from_str(text: &str) -> Result<Self, String> {
        let wrong = |what: String| {
            format!(
                "{what}: an SPDX expression is wanted, such as CC-BY-4.0, or an https:// address"
            )
        };
        if text.len() > BYTES_MAX {
            return Err(wrong(format!("it has {} bytes", text.len())));
        }
        if text == "unknown" {
            return Ok(Self::Unknown);
        }
        if text.starts_with("https://") {
            let is_plain = text
                .bytes()
                .all(|byte| byte.is_ascii_graphic() && !b"\"<>\\".contains(&byte));
            return match is_plain {
                true => Ok(Self::Url(text.to_owned())),
                false => Err(wrong("this is no address".to_owned())),
            };
        }
        let words = text.split_whitespace().map(canonical);
        let expression = words.collect::<Vec<String>>().join(" ");
        match Expression::parse_mode(&expression, ParseMode::STRICT) {
            Ok(_) => Ok(Self::Spdx(expression)),
            Err(error) => Err(wrong(error.reason.to_string())),
        }
    }
}

impl Display for Licence {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self {
            Self::Unknown => f.write_str("unknown"),
            Self::Spdx(text) | Self::Url(text) => f.write_str(text),
        }
    }
}

impl Licence {
    /// The lines of a dataset card's head: the hub knows single licences by its own names, which are
    /// SPDX's in small letters, and any other by name and link.
    pub(super) fn front_matter(&self) -> String {
        match self {
            Self::Unknown => "license: unknown\n".to_owned(),
            Self::Spdx(text) if LICENSES.iter().any(|licence| licence.name == text) => {
                format!("license: {}\n", text.to_ascii_lowercase())
            }
            Self::Spdx(text) => format!("license: other\nlicense_name: \"{text}\"\n"),
            Self::Url(url) => format!("license: other\nlicense_link: \"{url}\"\n"),
        }
    }

    /// Schema.org's `license`: the address of each licence that is named.
    pub(super) fn metadata(&self) -> Value {
        let words = match self {
            Self::Unknown => return json!("unknown"),
            Self::Url(url) => return json!(url),
            Self::Spdx(text) => text.split([' ', '(', ')']),
        };
        let known = words.filter(|word| LICENSES.iter().any(|licence| licence.name == *word));
        let urls: Vec<String> = known
            .map(|name| format!("https://spdx.org/licenses/{name}.html"))
            .collect();
        match &urls[..] {
            [] => json!(self.to_string()),
            [url] => json!(url),
            urls => json!(urls),
        }
    }
}

/// A word of an expression, an identifier as SPDX writes it.
fn canonical(word: &str) -> String {
    let inner = word.trim_matches(['(', ')']);
    let known = LICENSES.iter();
    let mut known = known.filter(|licence| licence.name.eq_ignore_ascii_case(inner));
    match known.next() {
        Some(licence) => word.replace(inner, licence.name),
        None => word.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn licences_are_expressions_or_addresses() {
        for (given, kept, front, url) in [
            (
                "cc-by-4.0",
                "CC-BY-4.0",
                "license: cc-by-4.0\n",
                json!("https://spdx.org/licenses/CC-BY-4.0.html"),
            ),
            (
                "(mit OR apache-2.0)",
                "(MIT OR Apache-2.0)",
                "license: other\nlicense_name: \"(MIT OR Apache-2.0)\"\n",
                json!([
                    "https://spdx.org/licenses/MIT.html",
                    "https://spdx.org/licenses/Apache-2.0.html"
                ]),
            ),
            (
                "https://example.org/terms",
                "https://example.org/terms",
                "license: other\nlicense_link: \"https://example.org/terms\"\n",
                json!("https://example.org/terms"),
            ),
            (
                "LicenseRef-lab",
                "LicenseRef-lab",
                "license: other\nlicense_name: \"LicenseRef-lab\"\n",
                json!("LicenseRef-lab"),
            ),
            ("unknown", "unknown", "license: unknown\n", json!("unknown")),
        ] {
            let licence: Licence = given.parse().unwrap();
            assert_eq!(licence.to_string(), kept);
            assert_eq!(licence.front_matter(), front);
            assert_eq!(licence.metadata(), url);
        }
        for bad in [
            "",
            "CC/BY",
            "cc-by-5.0",
            "MIT OR",
            "https://a b",
            "https://a\"",
            "https://a\\x",
            "http://a.org",
        ] {
            let said = bad.parse::<Licence>().unwrap_err();
            assert!(said.contains("SPDX"), "{said}");
        }
    }
}
