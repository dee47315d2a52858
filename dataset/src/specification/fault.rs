//! What a specification is refused for.

use super::error::quoted;
use std::fmt::Display;

/// What [`check`](super::check::check) refuses.
pub(super) struct Fault {
    /// The keys that together cause it; the first is the one to name.
    pub keys: Vec<String>,
    /// The refused value, where one alone is to blame.
    pub value: Option<String>,
    /// What that value must be; without one, what the first key does and why it may not.
    pub rule: String,
}

impl Fault {
    /// One value is to blame.
    pub fn of_value(key: &str, value: impl Display, rule: String) -> Self {
        Self {
            keys: vec![key.to_owned()],
            value: Some(quoted(&value.to_string())),
            rule,
        }
    }

    /// What several keys say together is to blame.
    pub fn of_keys<const N: usize>(keys: [String; N], rule: String) -> Self {
        Self {
            keys: keys.to_vec(),
            value: None,
            rule,
        }
    }
}
