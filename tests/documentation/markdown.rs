//! Links and anchors of a Markdown page.

use pulldown_cmark::{Event, Options, Parser, Tag, TagEnd};
use std::collections::BTreeSet;

/// What a page has.
pub struct Page {
    /// Where its links and images lead, as written.
    pub links: Vec<String>,
    /// The anchors of its headings.
    pub anchors: BTreeSet<String>,
    /// The files that mdBook includes into it, as written.
    pub included: Vec<String>,
}

/// Reads a page.
pub fn read(text: &str) -> Page {
    let mut page = Page {
        links: Vec::new(),
        anchors: BTreeSet::new(),
        included: Vec::new(),
    };
    let mut heading: Option<String> = None;
    for event in Parser::new_ext(text, Options::ENABLE_TABLES) {
        match event {
            Event::Start(Tag::Link { dest_url, .. } | Tag::Image { dest_url, .. }) => {
                page.links.push(dest_url.into_string());
            }
            Event::Start(Tag::Heading { .. }) => heading = Some(String::new()),
            Event::End(TagEnd::Heading(_)) => {
                let anchor = slug(&heading.take().unwrap_or_default());
                let again = (1..).map(|number| format!("{anchor}-{number}"));
                let free = [anchor.clone()].into_iter().chain(again);
                let free = free.into_iter().find(|name| !page.anchors.contains(name));
                page.anchors.extend(free);
            }
            Event::Text(part) | Event::Code(part) => {
                if let Some(heading) = &mut heading {
                    heading.push_str(&part);
                }
                page.included.extend(included(&part));
            }
            _ => {}
        }
    }
    page
}

/// The anchor of a heading, as GitHub and mdBook make it.
fn slug(heading: &str) -> String {
    let lower = heading.trim().to_lowercase();
    let kept = lower.chars().filter_map(|c| match c {
        ' ' => Some('-'),
        c if c.is_alphanumeric() || c == '-' || c == '_' => Some(c),
        _ => None,
    });
    kept.collect()
}

/// The file of `{{#include FILE}}`.
fn included(text: &str) -> Option<String> {
    let (_, rest) = text.split_once("{{#include ")?;
    let (file, _) = rest.split_once("}}")?;
    Some(file.trim().to_owned())
}

#[test]
fn anchors_are_those_of_github() {
    let page =
        read("# A `code`, and more\n\n## Again\n\n## Again\n\n### `[image]`\n\n## snake_case -x\n");
    let anchors: Vec<_> = page.anchors.iter().map(String::as_str).collect();
    assert_eq!(
        anchors,
        [
            "a-code-and-more",
            "again",
            "again-1",
            "image",
            "snake_case--x"
        ]
    );
}

#[test]
fn code_has_no_links() {
    let page = read("`[a](b)` [c](d) ![e](f)\n\n```\n[g](h)\n```\n\n| [i](j) |\n| --- |\n");
    assert_eq!(page.links, ["d", "f", "j"]);
    assert_eq!(read("{{#include ../A.md}}").included, ["../A.md"]);
}
