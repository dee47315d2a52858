//! All that is read of addresses, forms and cookies, in one function for fuzzers.

use crate::{
    access::Sessions,
    catalogue::{Entry, Filter},
    pages::{action::Action, jobs, login, material},
};
use coordinator::security::Tokens;
use dataset::{Specification, Split};

/// Reads bytes as each of these in turn, and tells whether one of them was accepted.
///
/// # Panics
/// Where one that was accepted is not what it has to be: a fault.
pub fn read(bytes: &[u8], specification: &Specification, tokens: &Tokens) -> bool {
    let text = str::from_utf8(bytes).unwrap_or_default();
    let filter = Filter::parse(text);
    if let Ok(filter) = &filter {
        let again = Filter::parse(&filter.query());
        assert_eq!(again.as_ref(), Ok(filter), "an address opens the same view");
        let entries = [0, 1, 2].map(|material| entry(material, specification));
        let chosen = filter.choose(&entries, specification);
        assert!(chosen.iter().all(|index| *index < entries.len()));
    }
    let to = login::target(text);
    let leads_here = to.starts_with('/') && !to.starts_with("//") && !to.starts_with("/\\");
    assert!(leads_here, "signing in leads to {to:?}");
    let role = Sessions::default().role(tokens, text);
    assert_eq!(role, None, "nobody makes a cookie without a token");
    let others = [
        Action::parse(bytes).is_ok(),
        jobs::Wanted::parse(text).is_ok(),
        material::exposure(text).is_ok(),
    ];
    filter.is_ok() || others.contains(&true)
}

fn entry(material: u32, specification: &Specification) -> Entry {
    Entry {
        material,
        split: Split::Train,
        labels: Entry::labels(specification, material),
        seconds: 1.0,
        error: 1e-4,
        missed: 0.0,
        brightness: (material > 0).then_some(0.5),
        bytes: 1,
    }
}
