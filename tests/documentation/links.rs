//! Whether links lead somewhere.

use crate::markdown;
use std::fs;
use std::path::{Component, Path, PathBuf};

/// What is wrong with the links of a page: a sentence for each. Links with a scheme are not followed.
pub fn faults(root: &Path, page: &Path) -> Vec<String> {
    let Ok(text) = fs::read_to_string(root.join(page)) else {
        return vec![format!("{} cannot be read", page.display())];
    };
    let read = markdown::read(&text);
    let links = read.links.iter().chain(&read.included);
    let links = links.filter(|link| !has_scheme(link));
    links
        .filter_map(|link| fault(root, page, link))
        .map(|fault| format!("{}: {fault}", page.display()))
        .collect()
}

fn has_scheme(link: &str) -> bool {
    let is_name = |scheme: &str| {
        scheme
            .chars()
            .all(|c| c.is_ascii_alphanumeric() || c == '+')
    };
    link.split_once(':')
        .is_some_and(|(scheme, _)| is_name(scheme))
}

fn fault(root: &Path, page: &Path, link: &str) -> Option<String> {
    let (path, anchor) = link.split_once('#').unwrap_or((link, ""));
    let target = match path {
        "" => Some(page.to_owned()),
        path => resolved(page, path),
    };
    let Some(target) = target else {
        return Some(format!("{link} leads out of the repository"));
    };
    if !root.join(&target).exists() {
        return Some(format!("{link}: there is no {}", target.display()));
    }
    if anchor.is_empty() || has_anchor(&root.join(&target), anchor) {
        return None;
    }
    Some(format!("{link}: {} has no such anchor", target.display()))
}

/// The path in the repository that a page's link leads to.
fn resolved(page: &Path, link: &str) -> Option<PathBuf> {
    let mut target = page.parent()?.to_owned();
    for part in Path::new(link).components() {
        match part {
            Component::Normal(name) => target.push(name),
            Component::ParentDir if target.pop() => {}
            Component::CurDir => {}
            _ => return None,
        }
    }
    Some(target)
}

fn has_anchor(file: &Path, anchor: &str) -> bool {
    let Ok(text) = fs::read_to_string(file) else {
        return false;
    };
    match file.extension().and_then(|ending| ending.to_str()) {
        Some("md") => markdown::read(&text).anchors.contains(anchor),
        Some("html") => text.contains(&format!("id=\"{anchor}\"")),
        _ => false,
    }
}

#[test]
fn broken_links_are_found() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| fs::write(folder.path().join(name), text).unwrap();
    fs::create_dir(folder.path().join("docs")).unwrap();
    write(
        "A.md",
        "# Title\n\n[self](#title) [b](docs/b.md#there) [c](docs) <https://example.org/no>\n",
    );
    write(
        "docs/b.md",
        "# There\n\n[a](../A.md#title) [html](c.html#x)\n",
    );
    write("docs/c.html", "<p id=\"x\">");
    assert!(faults(folder.path(), Path::new("A.md")).is_empty());
    assert!(faults(folder.path(), Path::new("docs/b.md")).is_empty());
    write(
        "docs/b.md",
        "# There\n\n[1](../A.md#no) [2](no.md) ![3](../../x) [4](#no) [5](c.html#no)\n\n{{#include ../no}}\n",
    );
    assert_eq!(faults(folder.path(), Path::new("docs/b.md")).len(), 6);
}
