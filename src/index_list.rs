//! Lists of indices on the command line, as in 3,5,8-10.

use crate::failure::BadInput;
use std::ops::RangeInclusive;
use std::str::FromStr;

/// Indices and ranges of them, in the order given.
#[derive(Clone, Debug)]
pub struct IndexList(Vec<RangeInclusive<u32>>);

impl FromStr for IndexList {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let index = |text: &str| {
            text.trim()
                .parse::<u32>()
                .map_err(|_| format!("{text:?} is no index: write a list as in 3,5,8-10"))
        };
        text.split(',')
            .map(|part| {
                let (first, last) = part.split_once('-').unwrap_or((part, part));
                let range = index(first)?..=index(last)?;
                if range.is_empty() {
                    return Err(format!(
                        "{part:?} runs backwards: write the lower end first"
                    ));
                }
                Ok(range)
            })
            .collect::<Result<_, String>>()
            .map(Self)
    }
}

impl IndexList {
    /// The indices below `count`; naming one at or beyond it is an error, but ranges may end there.
    pub fn below(&self, count: u32, what: &str) -> Result<Vec<u32>, BadInput> {
        if let Some(range) = self.0.iter().find(|range| *range.start() >= count) {
            return Err(BadInput(format!(
                "there is no {what} {}: there are {count}, counted from 0",
                range.start()
            )));
        }
        let last = count.saturating_sub(1);
        Ok(self
            .0
            .iter()
            .flat_map(|range| *range.start()..=(*range.end()).min(last))
            .collect())
    }
}
