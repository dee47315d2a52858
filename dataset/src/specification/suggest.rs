//! What an unknown key may have meant.

use super::Specification;
use serde_json::Value;

/// Characters of an unknown name that are compared; known names are shorter.
const COMPARED_CHARACTERS_MAX: usize = 64;

/// Names at least this similar, of 0 to 1, are offered.
const SIMILARITY_MIN: f64 = 0.6;

/// The end of an error's sentence about key `name` in the table `table_key`, whose names are
/// `known`: the nearest name there, or the same name or a near one in another table, or else all
/// names there.
pub(super) fn hint(table_key: &str, name: &str, known: &[&str]) -> String {
    let name: String = name.chars().take(COMPARED_CHARACTERS_MAX).collect();
    let here = known.iter().map(|known| match table_key {
        "" => (*known).to_owned(),
        _ => format!("{table_key}.{known}"),
    });
    let elsewhere = all_keys();
    let nearest = here
        // Names nearer by come first, and the first of equals wins.
        .chain(elsewhere)
        .map(|key| (similarity(&name, &key), key))
        .reduce(|best, other| if other.0 > best.0 { other } else { best });
    match nearest {
        Some((similarity, key)) if similarity >= SIMILARITY_MIN => {
            format!("; did you mean `{key}`?")
        }
        _ => format!("; the keys here are {}", known.join(", ")),
    }
}

/// How alike a name and the last part of a key are, 0 to 1.
fn similarity(name: &str, key: &str) -> f64 {
    let last = key.rsplit('.').next().unwrap_or(key);
    let alike = strsim::normalized_damerau_levenshtein(&name.to_lowercase(), last);
    // `distance` for `distance_m`: half a name is often a unit forgotten.
    if name.len() > 2 && last.starts_with(name) {
        alike.max(SIMILARITY_MIN)
    } else {
        alike
    }
}

/// Every key of a specification, outer tables first.
pub(super) fn all_keys() -> Vec<String> {
    let mut keys = Vec::new();
    if let Value::Object(fields) = Specification::preset().tree() {
        for (key, value) in &fields {
            keys.push(key.clone());
            let (prefix, table) = match value {
                Value::Array(values) => (format!("{key}[0]"), values.first()),
                _ => (key.clone(), Some(value)),
            };
            let names = table.and_then(Value::as_object).into_iter().flatten();
            keys.extend(names.map(|(name, _)| format!("{prefix}.{name}")));
        }
    }
    keys
}
