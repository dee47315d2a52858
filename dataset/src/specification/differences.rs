//! What two specifications do not have in common, for people.

use super::{
    Specification,
    canonical::{UNHASHED_KEYS, canonical_json},
};
use serde_json::Value;
use std::fmt::{Display, Formatter, Result};

/// How many values are told; of more only their number.
const TOLD_MAX: usize = 3;

/// Values that two specifications do not have in common, of those that change an image or a label.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Differences(Vec<Difference>);

/// A value that two specifications do not have in common.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Difference {
    // As in the file: `image.width`, `views[3].rotation_deg`.
    key: String,
    found: String,
    given: String,
}

impl Differences {
    /// Between the specification of a store and the one that is given.
    pub fn between(found: &Specification, given: &Specification) -> Self {
        let mut differences = Vec::new();
        let [found, given] = [found, given].map(Specification::tree);
        compare("", Some(&found), Some(&given), &mut differences);
        differences.retain(|difference| !UNHASHED_KEYS.contains(&difference.key.as_str()));
        Self(differences)
    }
}

/// As in `image.width: 128 in the store, 64 given; views: 14 in the store, 13 given`.
impl Display for Differences {
    fn fmt(&self, f: &mut Formatter<'_>) -> Result {
        for (place, Difference { key, found, given }) in self.0.iter().take(TOLD_MAX).enumerate() {
            if place > 0 {
                f.write_str("; ")?;
            }
            write!(f, "{key}: {found} in the store, {given} given")?;
        }
        match self.0.len().saturating_sub(TOLD_MAX) {
            0 => Ok(()),
            1 => f.write_str("; and one more value differs"),
            more => write!(f, "; and {more} more values differ"),
        }
    }
}

fn compare(key: &str, found: Option<&Value>, given: Option<&Value>, all: &mut Vec<Difference>) {
    match (found, given) {
        (Some(Value::Object(found)), Some(Value::Object(given))) => {
            let new = given.keys().filter(|name| !found.contains_key(*name));
            for name in found.keys().chain(new) {
                let below = match key {
                    "" => name.clone(),
                    key => format!("{key}.{name}"),
                };
                compare(&below, found.get(name), given.get(name), all);
            }
        }
        (Some(Value::Array(found)), Some(Value::Array(given))) if found.len() == given.len() => {
            for (place, (found, given)) in found.iter().zip(given).enumerate() {
                compare(&format!("{key}[{place}]"), Some(found), Some(given), all);
            }
        }
        (found, given) if found == given => {}
        (found, given) => all.push(Difference {
            key: key.to_owned(),
            found: told(found),
            given: told(given),
        }),
    }
}

/// A value in few words.
fn told(value: Option<&Value>) -> String {
    match value {
        None | Some(Value::Null) => "none".to_owned(),
        Some(Value::Array(values)) if values.iter().any(Value::is_object) => {
            values.len().to_string()
        }
        Some(value) => canonical_json(value),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn told_between(change: impl FnOnce(&mut Specification)) -> String {
        let found = Specification::preset();
        let mut given = found.clone();
        change(&mut given);
        Differences::between(&found, &given).to_string()
    }

    #[test]
    fn values_are_told_by_their_keys() {
        let one = told_between(|given| given.image.width = 64);
        assert_eq!(one, "image.width: 128 in the store, 64 given");
        let view = told_between(|given| {
            given.views.pop();
        });
        assert_eq!(view, "views: 14 in the store, 13 given");
        let four = told_between(|given| {
            given.seed = 5;
            given.image.width = 64;
            given.image.height = 64;
            given.accuracy.absolute = 0.5;
        });
        assert!(four.ends_with("; and one more value differs"), "{four}");
    }

    /// Whatever changes the hash is told, and nothing else.
    #[test]
    fn what_the_hash_leaves_out_is_no_difference() {
        let same = told_between(|given| {
            given.name = "another".to_owned();
            given.materials = 7;
        });
        assert_eq!(same, "");
    }
}
