//! Lists of indices as people write them: `3,5-9`.

use std::{fmt, ops::RangeInclusive, str::FromStr};
use thiserror::Error;

/// Indices and ranges of them, in the order given; no range is empty.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct IndexList(Vec<RangeInclusive<u32>>);

/// What is wrong with a list.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum IndexListError {
    /// A part is no number and no range.
    #[error("{0:?} is no index: write a list as in 3,5,8-10")]
    Index(String),
    /// A range's end is below its beginning.
    #[error("{part:?} goes backwards: write {last}-{first}")]
    Backwards {
        /// As it was written.
        part: String,
        /// Its beginning.
        first: u32,
        /// Its end.
        last: u32,
    },
    /// An index that there is not.
    #[error("there is no {what} {index}: there are {count}, counted from 0")]
    Beyond {
        /// What is counted.
        what: &'static str,
        /// The index.
        index: u32,
        /// How many there are.
        count: u32,
    },
    /// More indices than there are.
    #[error("the list names more indices than the {count} that there are: name each {what} once")]
    Repeated {
        /// What is counted.
        what: &'static str,
        /// How many there are.
        count: u32,
    },
}

impl FromStr for IndexList {
    type Err = IndexListError;

    fn from_str(text: &str) -> Result<Self, IndexListError> {
        let parts = text.split(',').map(|part| {
            let index = |text: &str| {
                let index = text.trim().parse::<u32>();
                index.map_err(|_| IndexListError::Index(text.to_owned()))
            };
            let (first, last) = part.split_once('-').unwrap_or((part, part));
            let (first, last) = (index(first)?, index(last)?);
            if first > last {
                let part = part.to_owned();
                return Err(IndexListError::Backwards { part, first, last });
            }
            Ok(first..=last)
        });
        parts.collect::<Result<_, _>>().map(Self)
    }
}

/// As it is read; "none" where nothing is in it.
impl fmt::Display for IndexList {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.0.is_empty() {
            return formatter.write_str("none");
        }
        for (number, range) in self.0.iter().enumerate() {
            let comma = if number == 0 { "" } else { "," };
            let (first, last) = (range.start(), range.end());
            if first == last {
                write!(formatter, "{comma}{first}")?;
            } else {
                write!(formatter, "{comma}{first}-{last}")?;
            }
        }
        Ok(())
    }
}

impl FromIterator<RangeInclusive<u32>> for IndexList {
    fn from_iter<I: IntoIterator<Item = RangeInclusive<u32>>>(ranges: I) -> Self {
        let ranges = ranges.into_iter();
        Self(ranges.filter(|range| !range.is_empty()).collect())
    }
}

impl IndexList {
    /// The ranges, in the order given.
    pub fn ranges(&self) -> &[RangeInclusive<u32>] {
        &self.0
    }

    /// The indices below `count`, at most that many; ranges may end beyond it.
    ///
    /// # Errors
    /// When it names one at or beyond `count`, or repeats so often that there are more than `count`.
    pub fn below(&self, count: u32, what: &'static str) -> Result<Vec<u32>, IndexListError> {
        if let Some(range) = self.0.iter().find(|range| *range.start() >= count) {
            let index = *range.start();
            return Err(IndexListError::Beyond { what, index, count });
        }
        let last = count.saturating_sub(1);
        let within = self.0.iter();
        let within = within.map(|range| *range.start()..=(*range.end()).min(last));
        let length = |range: &RangeInclusive<u32>| u64::from(range.end() - range.start()) + 1;
        let total: u64 = within.clone().map(|range| length(&range)).sum();
        if total > u64::from(count) {
            return Err(IndexListError::Repeated { what, count });
        }
        Ok(within.flatten().collect())
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic here is a failed test")]
mod tests {
    use super::*;

    #[test]
    fn lists_read_as_they_are_written() {
        for text in ["3", "3,5-9", "9,3,3", "0-4294967295"] {
            assert_eq!(text.parse::<IndexList>().unwrap().to_string(), text);
        }
        for text in ["", "a", "3,", "9-5", "-3", "1-2-3", "4294967296", "3;4"] {
            assert!(text.parse::<IndexList>().is_err(), "{text}");
        }
        let backwards = "9-5".parse::<IndexList>().unwrap_err().to_string();
        assert_eq!(backwards, "\"9-5\" goes backwards: write 5-9");
        assert_eq!(IndexList::default().to_string(), "none");
    }

    #[test]
    fn a_list_gives_the_indices_that_there_are_and_no_more() {
        let below = |text: &str| text.parse::<IndexList>().unwrap().below(14, "view");
        assert_eq!(below("5,3,8-10").unwrap(), [5, 3, 8, 9, 10]);
        assert_eq!(below("12-4294967295").unwrap(), [12, 13]);
        let beyond = below("3,14-15").unwrap_err().to_string();
        assert_eq!(beyond, "there is no view 14: there are 14, counted from 0");
        let repeated = below("0-13,0").unwrap_err();
        assert!(matches!(repeated, IndexListError::Repeated { .. }));
    }
}
