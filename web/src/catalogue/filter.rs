//! Which materials a page shows and in which order, as the address of the page says it.
//!
//! ```text
//! /materials?roughness_max=20&split=test&where=ior+%3E+2&sort=-seconds&page=3
//! ```
//!
//! Every field of [`FIELDS`] has `NAME_min` and `NAME_max`, both included; `split` is a split's
//! name; `where` is a condition as `dataset export --where` takes it; `sort` is a field's name, with
//! a hyphen for the largest first; `page` counts from 1; `view` is the view that pictures show.

use super::entry::{Entry, FIELDS, Field};
use dataset::{Specification, Split, condition::Condition};
use thiserror::Error;
use url::form_urlencoded;

/// Which materials, in which order, which page of them.
#[derive(Clone, Debug, PartialEq)]
pub struct Filter {
    /// Of each field its bounds.
    bounds: [[Option<f64>; 2]; FIELDS.len()],
    /// The split, if it matters.
    pub split: Option<Split>,
    /// A condition on labels, and its text.
    pub condition: Option<(String, Condition)>,
    /// The order.
    pub sort: Sort,
    /// The page, from 1.
    pub page: usize,
    /// Which view pictures show.
    pub view: u32,
}

/// By which field, and whether the largest come first.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sort {
    /// Index into [`FIELDS`].
    field: usize,
    /// Whether the largest come first.
    pub is_descending: bool,
}

/// What is wrong with a filter.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum FilterError {
    /// There is no such key.
    #[error("no filter is called {0:?}")]
    Key(String),
    /// A key occurs twice.
    #[error("{0} is given twice")]
    Twice(String),
    /// A value cannot be read.
    #[error("{key} is {wanted}, and {value:?} is none")]
    Value {
        /// The key.
        key: String,
        /// What it should be.
        wanted: &'static str,
        /// What it is.
        value: String,
    },
    /// A condition cannot be read.
    #[error("where: {0}")]
    Condition(String),
}

impl Default for Filter {
    fn default() -> Self {
        Self {
            bounds: [[None; 2]; FIELDS.len()],
            split: None,
            condition: None,
            sort: Sort {
                field: 0,
                is_descending: false,
            },
            page: 1,
            view: 0,
        }
    }
}

impl Sort {
    /// By which field.
    pub fn field(&self) -> &'static Field {
        &FIELDS[self.field]
    }

    /// As an address says it.
    pub fn text(&self) -> String {
        let minus = if self.is_descending { "-" } else { "" };
        format!("{minus}{}", self.field().name)
    }

    /// Reads what an address says.
    fn parse(text: &str) -> Option<Self> {
        let (name, is_descending) = match text.strip_prefix('-') {
            Some(name) => (name, true),
            None => (text, false),
        };
        let field = FIELDS.iter().position(|field| field.name == name)?;
        Some(Self {
            field,
            is_descending,
        })
    }
}

impl Filter {
    /// Reads the query of an address. A value that is empty, as forms send them, says nothing.
    ///
    /// # Errors
    /// Says which key or value is wrong.
    pub fn parse(query: &str) -> Result<Self, FilterError> {
        let mut filter = Self::default();
        let mut seen = Vec::new();
        for (key, value) in form_urlencoded::parse(query.as_bytes()) {
            let value = value.trim();
            if value.is_empty() {
                continue;
            }
            if seen.contains(&key) {
                return Err(FilterError::Twice(key.into_owned()));
            }
            filter.set(&key, value)?;
            seen.push(key);
        }
        Ok(filter)
    }

    fn set(&mut self, key: &str, value: &str) -> Result<(), FilterError> {
        let wrong = |wanted| FilterError::Value {
            key: key.to_owned(),
            wanted,
            value: value.to_owned(),
        };
        match key {
            "split" => {
                let splits = [Split::Train, Split::Validation, Split::Test];
                let split = splits.into_iter().find(|split| split.name() == value);
                self.split = Some(split.ok_or_else(|| wrong("train, validation or test"))?);
            }
            "where" => {
                let condition = value.parse::<Condition>();
                let condition =
                    condition.map_err(|error| FilterError::Condition(error.to_string()))?;
                self.condition = Some((value.to_owned(), condition));
            }
            "sort" => {
                self.sort = Sort::parse(value)
                    .ok_or_else(|| wrong("a field's name, with a hyphen for the largest first"))?;
            }
            "page" => {
                let page = value.parse().ok().filter(|page| *page > 0);
                self.page = page.ok_or_else(|| wrong("a page's number from 1"))?;
            }
            "view" => self.view = value.parse().map_err(|_| wrong("a view's number"))?,
            _ => {
                let (name, side) = match key.rsplit_once('_') {
                    Some((name, "min")) => (name, 0),
                    Some((name, "max")) => (name, 1),
                    _ => return Err(FilterError::Key(key.to_owned())),
                };
                let field = FIELDS.iter().position(|field| field.name == name);
                let field = field.ok_or_else(|| FilterError::Key(key.to_owned()))?;
                let bound = value.parse().ok().filter(|bound: &f64| !bound.is_nan());
                self.bounds[field][side] = Some(bound.ok_or_else(|| wrong("a number"))?);
            }
        }
        Ok(())
    }

    /// The bounds of a field, lower and upper.
    pub fn bounds(&self, field: &Field) -> [Option<f64>; 2] {
        let index = FIELDS.iter().position(|other| other.name == field.name);
        index.map_or([None; 2], |index| self.bounds[index])
    }

    /// The query that says this filter; [`Filter::parse`] reads it back.
    pub fn query(&self) -> String {
        let mut query = form_urlencoded::Serializer::new(String::new());
        for (field, bounds) in FIELDS.iter().zip(&self.bounds) {
            for (bound, side) in bounds.iter().zip(["min", "max"]) {
                if let Some(bound) = bound {
                    query.append_pair(&format!("{}_{side}", field.name), &bound.to_string());
                }
            }
        }
        if let Some(split) = self.split {
            query.append_pair("split", split.name());
        }
        if let Some((text, _)) = &self.condition {
            query.append_pair("where", text);
        }
        let plain = Self::default();
        if self.sort != plain.sort {
            query.append_pair("sort", &self.sort.text());
        }
        if self.view != plain.view {
            query.append_pair("view", &self.view.to_string());
        }
        if self.page != plain.page {
            query.append_pair("page", &self.page.to_string());
        }
        query.finish()
    }

    /// Whether it leaves anything out.
    pub fn is_narrow(&self) -> bool {
        let bounded = self.bounds.iter().flatten().any(Option::is_some);
        bounded || self.split.is_some() || self.condition.is_some()
    }

    /// The materials that it lets through, in its order, as indices into `entries`. Materials of
    /// which the field to sort by is unknown come last, equal ones by their index.
    pub fn choose(&self, entries: &[Entry], specification: &Specification) -> Vec<usize> {
        let mut chosen: Vec<usize> = (0..entries.len())
            .filter(|index| self.lets_through(&entries[*index], specification))
            .collect();
        let Sort {
            field,
            is_descending,
        } = self.sort;
        if field == 0 {
            // Entries stand in the order of their indices.
            if is_descending {
                chosen.reverse();
            }
            return chosen;
        }
        let key = |index: &usize| {
            let value = (FIELDS[field].of)(&entries[*index]);
            let signed = value.map(|value| if is_descending { -value } else { value });
            signed.unwrap_or(f64::INFINITY)
        };
        chosen.sort_by(|a, b| key(a).total_cmp(&key(b)));
        chosen
    }

    fn lets_through(&self, entry: &Entry, specification: &Specification) -> bool {
        let within = FIELDS.iter().zip(&self.bounds).all(|(field, bounds)| {
            if let [None, None] = bounds {
                return true;
            }
            let [low, high] = bounds;
            (field.of)(entry).is_some_and(|value| {
                low.is_none_or(|low| value >= low) && high.is_none_or(|high| value <= high)
            })
        });
        within
            && self.split.is_none_or(|split| split == entry.split)
            && self.condition.as_ref().is_none_or(|(_, condition)| {
                condition.holds(&specification.material(entry.material), entry.split)
            })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn entries(specification: &Specification, count: u32) -> Vec<Entry> {
        let entry = |material: u32| Entry {
            material,
            split: specification.split(material),
            labels: Entry::labels(specification, material),
            seconds: f64::from(material % 7),
            error: 1e-4,
            missed: 0.0,
            brightness: (!material.is_multiple_of(3)).then_some(f64::from(material % 5)),
            bytes: 1,
        };
        (0..count).map(entry).collect()
    }

    #[test]
    fn what_is_chosen_is_what_the_address_says() {
        let specification = Specification::preset();
        let entries = entries(&specification, 300);
        let chosen = |query: &str| {
            let filter = Filter::parse(query).unwrap();
            filter.choose(&entries, &specification)
        };
        assert_eq!(chosen(""), (0..300).collect::<Vec<_>>());
        assert_eq!(chosen("sort=-material")[0], 299);
        let rough = chosen("roughness_max=20&split=test&where=ior+%3E+2&sort=-seconds");
        assert!(!rough.is_empty());
        for pair in rough.windows(2) {
            let [a, b] = [pair[0], pair[1]].map(|index| &entries[index]);
            assert!(a.seconds > b.seconds || (a.seconds == b.seconds && a.material < b.material));
        }
        let by_hand = entries.iter().filter(|entry| {
            entry.labels[0] <= 20.0 && entry.split == Split::Test && entry.labels[3] > 2.0
        });
        assert_eq!(by_hand.count(), rough.len());
        // Unknown values come last, and no bound lets them through.
        let bright = chosen("sort=brightness");
        assert_eq!(bright.len(), 300);
        assert!(entries[bright[299]].brightness.is_none());
        assert!(entries[chosen("sort=-brightness")[0]].brightness.is_some());
        assert_eq!(chosen("brightness_min=-1").len(), 200);
    }

    #[test]
    fn what_is_wrong_is_named() {
        for (query, error) in [
            ("colour_min=3", "no filter is called \"colour_min\""),
            ("roughness=3", "no filter is called \"roughness\""),
            (
                "roughness_min=abc",
                "roughness_min is a number, and \"abc\" is none",
            ),
            ("ior_max=NaN", "ior_max is a number, and \"NaN\" is none"),
            (
                "page=0",
                "page is a page's number from 1, and \"0\" is none",
            ),
            (
                "page=-1",
                "page is a page's number from 1, and \"-1\" is none",
            ),
            (
                "split=all",
                "split is train, validation or test, and \"all\" is none",
            ),
            ("page=1&page=2", "page is given twice"),
        ] {
            assert_eq!(Filter::parse(query).unwrap_err().to_string(), error);
        }
        let unread = Filter::parse("where=roughness+%3C").unwrap_err();
        assert!(unread.to_string().starts_with("where: "), "{unread}");
        // Forms send every field, most of them empty.
        assert_eq!(
            Filter::parse("roughness_min=&split=&where=&x="),
            Ok(Filter::default())
        );
    }

    proptest! {
        #[test]
        fn an_address_opens_the_same_view_again(
            bounds in proptest::collection::vec(proptest::option::of(-1e9..1e9f64), 30),
            split in 0..4usize, sort in 0..15usize, is_descending: bool,
            page in 1..1_000_000_000usize, view in 0..14u32,
        ) {
            let mut filter = Filter {
                split: [None, Some(Split::Train), Some(Split::Validation), Some(Split::Test)][split],
                sort: Sort { field: sort, is_descending },
                page,
                view,
                ..Filter::default()
            };
            for (index, bound) in bounds.into_iter().enumerate() {
                filter.bounds[index / 2][index % 2] = bound;
            }
            prop_assert_eq!(Filter::parse(&filter.query()), Ok(filter));
        }

        #[test]
        fn no_query_makes_it_panic(query in "([a-z_%0-9+&=.-]|\\PC){0,200}") {
            let _ = Filter::parse(&query);
        }
    }
}
