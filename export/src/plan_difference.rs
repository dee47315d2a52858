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
        if key.as_str() == "images" {
            return format!("another {what}, of other images: the store has more now, or others");
        }
        let found = told(found.get(key.as_str()).unwrap_or(&Value::Null));
        format!(
            "another {what}, of {key} {found} where {} is wanted",
            told(value)
        )
    })
}

/// A value in words; what is absent is no limit, or not asked for.
fn told(value: &Value) -> String {
    match value {
        Value::Null => "none".to_owned(),
        value => value.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_difference_is_told_in_words() {
        let found = br#"{"images": "a1", "split": null, "views": [5, 8]}"#;
        for (wanted, told) in [
            (
                r#"{"images": "b2", "split": "train", "views": [5, 8]}"#,
                "another export, of split none where \"train\" is wanted",
            ),
            (
                r#"{"images": "b2", "split": null, "views": [5, 8]}"#,
                "another export, of other images: the store has more now, or others",
            ),
            (
                r#"{"images": "b2", "split": null, "views": [5, 8], "where": "ior > 2"}"#,
                "another export, of where none where \"ior > 2\" is wanted",
            ),
        ] {
            assert_eq!(difference(found, wanted, "export"), told);
        }
        assert_eq!(difference(b"no JSON", "{}", "export"), "another export");
    }
}
