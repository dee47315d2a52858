//! Writing a specification: JSON, its canonical form and hash, TOML.

use super::Specification;
use crate::Digest;
use serde::Serialize;
use serde_json::Value;
use std::fmt::Write;

/// The keys that the hash leaves out.
pub(super) const UNHASHED_KEYS: [&str; 2] = ["name", "materials"];

impl Specification {
    /// All of the specification as canonical JSON, but for a `sample.shape` that is `square` and a mesh that is not
    /// there: deterministic, and [`Self::from_json`] gives the same value again.
    pub fn to_json(&self) -> String {
        canonical_json(&self.written())
    }

    /// The canonical form that [`Self::hash`] hashes: JSON as RFC 8785 writes it (keys sorted, no
    /// spaces, numbers as ECMAScript prints them), except that integers keep all their digits.
    ///
    /// `name` and `materials` are left out on purpose, for neither changes a pixel or a label. An
    /// image of a set of 12 materials so has the same bytes as that of the same material in the set
    /// of 9,000, and a store can grow without rendering anything again.
    pub fn canonical(&self) -> String {
        let mut tree = self.written();
        if let Value::Object(fields) = &mut tree {
            for key in UNHASHED_KEYS {
                fields.remove(key);
            }
        }
        canonical_json(&tree)
    }

    /// BLAKE3 of [`Self::canonical`]: the identity of what is rendered. Neither the order of keys,
    /// nor comments, nor defaults that a file states change it; any other change of a value does.
    pub fn hash(&self) -> Digest {
        Digest::of(self.canonical().as_bytes())
    }

    /// A complete TOML file that [`Self::from_toml`] reads to an equal value.
    ///
    /// # Panics
    ///
    /// If the seed is above the limit, which no checked specification's is.
    pub fn to_toml(&self) -> String {
        toml::to_string(self)
            .unwrap_or_else(|error| unreachable!("TOML has all but integers this large: {error}"))
    }

    /// Every value by its key.
    pub(super) fn tree(&self) -> Value {
        let mut tree = self.written();
        tree["sample"]["shape"] = as_json(&self.sample.shape);
        tree["sample"]["mesh"] = as_json(&self.sample.mesh);
        tree
    }

    /// The values that are written, by their keys.
    fn written(&self) -> Value {
        as_json(self)
    }
}

fn as_json(value: &impl Serialize) -> Value {
    serde_json::to_value(value)
        .unwrap_or_else(|_| unreachable!("numbers, texts and lists under texts are JSON"))
}

/// JSON with sorted keys and no spaces. It sorts by itself: whether serde_json's maps are sorted
/// is for other crates' features to decide.
pub(super) fn canonical_json(value: &Value) -> String {
    fn write(text: &mut String, value: &Value) {
        match value {
            Value::Object(fields) => {
                let mut fields: Vec<_> = fields.iter().collect();
                fields.sort_by_key(|(key, _)| *key);
                text.push('{');
                for (place, (key, value)) in fields.into_iter().enumerate() {
                    if place > 0 {
                        text.push(',');
                    }
                    let _ = write!(text, "\"{key}\":");
                    write(text, value);
                }
                text.push('}');
            }
            Value::Array(values) => {
                text.push('[');
                for (place, value) in values.iter().enumerate() {
                    if place > 0 {
                        text.push(',');
                    }
                    write(text, value);
                }
                text.push(']');
            }
            scalar => text.push_str(&scalar_text(scalar)),
        }
    }
    let mut text = String::new();
    write(&mut text, value);
    text
}

/// A scalar as JSON.
fn scalar_text(scalar: &Value) -> String {
    match scalar {
        Value::Number(number) if number.is_f64() => number.as_f64().map(number_text),
        _ => None,
    }
    .unwrap_or_else(|| scalar.to_string())
}

/// A finite number as ECMAScript prints it (ECMA-262, Number::toString): the shortest digits that
/// read back to it, and an exponent below 1e-6 and from 1e21.
pub(super) fn number_text(number: f64) -> String {
    let size = number.abs();
    if number == 0.0 {
        // Also for -0, which equals 0.
        "0".to_owned()
    } else if (1e-6..1e21).contains(&size) {
        number.to_string()
    } else {
        let text = format!("{number:e}");
        match text.split_once('e') {
            Some((digits, power)) if !power.starts_with('-') => format!("{digits}e+{power}"),
            _ => text,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::specification::Shape;

    #[test]
    fn numbers_print_as_in_rfc_8785() {
        // Of its appendix B.
        let published = [
            (0x0000_0000_0000_0000, "0"),
            (0x8000_0000_0000_0000, "0"),
            (0x0000_0000_0000_0001, "5e-324"),
            (0x7fef_ffff_ffff_ffff, "1.7976931348623157e+308"),
            (0x4340_0000_0000_0000, "9007199254740992"),
            (0x4430_0000_0000_0000, "295147905179352830000"),
            (0x44b5_2d02_c7e1_4af5, "9.999999999999997e+22"),
            (0x444b_1ae4_d6e2_ef4f, "999999999999999900000"),
            (0x444b_1ae4_d6e2_ef50, "1e+21"),
            (0x3eb0_c6f7_a0b5_ed8c, "9.999999999999997e-7"),
            (0x3eb0_c6f7_a0b5_ed8d, "0.000001"),
            (0x41b3_de43_5555_5553, "333333333.3333332"),
            (0xbecb_f647_612f_3696, "-0.0000033333333333333333"),
        ];
        for (bits, text) in published {
            assert_eq!(number_text(f64::from_bits(bits)), text);
        }
    }

    #[test]
    fn a_square_is_not_written_and_other_shapes_are() {
        let mut specification = Specification::preset();
        for text in [
            specification.canonical(),
            specification.to_json(),
            specification.to_toml(),
        ] {
            assert!(!text.contains("shape"), "{text}");
        }
        specification.sample.shape = Shape::Sphere;
        assert_ne!(specification.hash(), Specification::preset().hash());
        let read = Specification::from_json(&specification.to_json()).expect("JSON");
        assert_eq!(read, specification);
        let read = Specification::from_toml(&specification.to_toml(), "set.toml").expect("TOML");
        assert_eq!(read, specification);
    }

    #[test]
    fn the_canonical_form_of_the_preset_is_sorted_and_lacks_two_keys() {
        let canonical = Specification::preset().canonical();
        assert!(canonical.starts_with(r#"{"accuracy":{"absolute":0.0001,"relative":0.001},"#));
        assert!(!canonical.contains("name") && !canonical.contains("materials"));
        assert!(!canonical.contains(' '));
    }

    /// A change of this hash is a change of every dataset's identity.
    #[test]
    fn the_preset_has_its_hash() {
        let hash = Specification::preset().hash().to_string();
        assert_eq!(
            hash,
            "ec61cf11819ed02bf6eddbf36a8da81f22a55bc6478af9d2b4b5e07c99939b1d"
        );
    }
}
