//! Which materials a command is about, as people write them: `3,5-9`.

use proto::MaterialRange;
use std::str::FromStr;

/// Materials, as ranges.
#[derive(Clone, Debug, PartialEq)]
pub struct Materials(pub Vec<MaterialRange>);

impl FromStr for Materials {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let parts = text.split(',').map(|part| {
            let (first, last) = part.split_once('-').unwrap_or((part, part));
            let number = |text: &str| {
                let number = text.trim().parse::<u32>();
                number.map_err(|_| format!("{part:?} is no material: write numbers, as in 3,5-9"))
            };
            let (first, last) = (number(first)?, number(last)?);
            if first > last {
                return Err(format!("{part:?} goes backwards: write {last}-{first}"));
            }
            Ok(MaterialRange { first, last })
        });
        parts.collect::<Result<_, String>>().map(Self)
    }
}

/// Ranges as people write them; "none" where there are none.
pub fn listed(ranges: &[MaterialRange]) -> String {
    let parts = ranges.iter().map(|range| match range.last - range.first {
        0 => range.first.to_string(),
        _ => format!("{}-{}", range.first, range.last),
    });
    let parts: Vec<String> = parts.collect();
    if parts.is_empty() {
        "none".to_owned()
    } else {
        parts.join(",")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn materials_read_as_they_are_listed() {
        for text in ["3", "3,5-9", "0-4294967295"] {
            let Materials(ranges) = text.parse().unwrap();
            assert_eq!(listed(&ranges), text);
        }
        for text in ["", "a", "3,", "9-5", "-3", "1-2-3"] {
            assert!(text.parse::<Materials>().is_err(), "{text}");
        }
    }
}
