//! Which materials train a model and which judge it.

use crate::Specification;
use crate::keystream::{Purpose, keystream};
use rand_chacha::rand_core::Rng;
use serde::{Deserialize, Serialize};
use std::fmt;

/// The part of a dataset that a material, with all its views, belongs to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Split {
    /// Four materials of every six.
    Train,
    /// One material of every six.
    Validation,
    /// One material of every six.
    Test,
}

impl Split {
    /// The name, in lower case.
    pub fn name(self) -> &'static str {
        match self {
            Self::Train => "train",
            Self::Validation => "validation",
            Self::Test => "test",
        }
    }
}

impl fmt::Display for Split {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.pad(self.name())
    }
}

/// Consecutive materials that share out the splits among themselves.
const BLOCK_MATERIALS: u32 = 6;

const PURPOSE: Purpose = Purpose(*b"brdfarm dataset split   ");

/// The split of material `index` under a seed.
///
/// Every block of six has 30 arrangements of one validation, one test and four training
/// materials; each is as likely as any other, and blocks are independent.
impl Specification {
    /// The split of material `index`: a pure function of the index and the seed. Of materials 6k to
    /// 6k + 5 four train, one validates and one tests.
    pub fn split(&self, index: u32) -> Split {
        split(self.seed, index)
    }
}

fn split(seed: u64, index: u32) -> Split {
    const ARRANGEMENTS: u32 = BLOCK_MATERIALS * (BLOCK_MATERIALS - 1);
    // Draws from here up would make the first arrangements likelier: 2^32 is no multiple of 30.
    const UNBIASED_END: u32 = u32::MAX - u32::MAX % ARRANGEMENTS;
    let mut rng = keystream(seed, PURPOSE, u64::from(index / BLOCK_MATERIALS));
    let arrangement = loop {
        let draw = rng.next_u32();
        if draw < UNBIASED_END {
            break draw % ARRANGEMENTS;
        }
    };
    let validation = arrangement / (BLOCK_MATERIALS - 1);
    let among_others = arrangement % (BLOCK_MATERIALS - 1);
    let test = among_others + u32::from(among_others >= validation);
    match index % BLOCK_MATERIALS {
        position if position == validation => Split::Validation,
        position if position == test => Split::Test,
        _ => Split::Train,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_six_have_four_one_and_one() {
        for block in (0..3000).chain([u32::MAX / 6 - 1]) {
            let mut splits: Vec<_> = (0..6)
                .map(|position| split(2019, block * 6 + position))
                .collect();
            splits.sort();
            assert_eq!(splits[..4], [Split::Train; 4]);
            assert_eq!(splits[4..], [Split::Validation, Split::Test]);
        }
    }

    /// The splits from material `first` on, one letter each: T train, v validation, t test. The
    /// letters come from a separate program in Python that has its own ChaCha20.
    fn assert_splits(seed: u64, first: u32, letters: &str) {
        for (index, letter) in (first..=u32::MAX).zip(letters.chars()) {
            let expected = match letter {
                'T' => Split::Train,
                'v' => Split::Validation,
                _ => Split::Test,
            };
            assert_eq!(split(seed, index), expected, "material {index}");
        }
    }

    #[test]
    fn splits_are_those_of_an_independent_program() {
        assert_splits(2019, 0, "TvTtTTvTTtTTtTTvTTtTvTTTTTtTTvTtTvTT");
    }

    /// The last 16 indices: two whole blocks and four materials of a block that has no end.
    #[test]
    fn the_last_splits_are_those_of_an_independent_program() {
        for (seed, letters) in [
            (0, "TTtvTTTTvTtTtTTv"),
            (1, "TTvTtTvtTTTTTvTt"),
            (2019, "TvTTTtTTTtvTtvTT"),
        ] {
            assert_splits(seed, u32::MAX - 15, letters);
        }
    }

    #[test]
    fn names_are_lower_case_in_text_and_json() {
        for split in [Split::Train, Split::Validation, Split::Test] {
            assert_eq!(split.to_string(), split.name());
            let json = serde_json::to_string(&split).unwrap();
            assert_eq!(json, format!("\"{split}\""));
        }
    }
}
