//! What tells two plans apart. A plan is a JSON object that pins what is being made in a folder.

use serde_json::Value;

/// Which other `what` the plan `found` is of, where `wanted` is wanted: the first entry that differs.
pub(crate) fn difference(found: &[u8], wanted: &str, what: &str) -> String {
    let parsed = |text: &[u8]| serde_json::from_slice::<Value>(text).ok();
    let (Some(Value::Object(found)), Some(Value::Object(wanted))) =
        (parsed(found), parsed(wanted.as_bytes()))
    else {
        return format!("another {what}");
    };
    // Other images follow from everything else, so they are named last.
    let mut different: Vec<_> = wanted
        .iter()
        .filter(|(key, value)| found.get(*key) != Some(value))
        .collect();
    different.sort_by_key(|(key, _)| key.as_str() == "images");
    let different = different.first();
    different.map_or(format!("another {what}"), |(key, value)| {
        let found = found.get(key.as_str()).unwrap_or(&Value::Null);
        format!("another {what}, of {key} {found} where {value} is wanted")
    })
}
