//! No files of a crate import each other in a circle.
//!
//! Read from the `use` lines of all crates of the workspace, without those of unit tests. A module and what lies below
//! it are one: what a `mod.rs` has is shared by the files beside it. Paths that are written out in the code are not
//! read.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

/// The modules of a crate by their paths, with what each imports of the others.
type Imports = BTreeMap<Vec<String>, BTreeSet<Vec<String>>>;

/// All source files below a folder.
fn sources(folder: &Path) -> Vec<PathBuf> {
    let mut sources = Vec::new();
    for entry in fs::read_dir(folder).expect("a folder of sources") {
        let path = entry.expect("an entry").path();
        if path.is_dir() {
            sources.extend(self::sources(&path));
        } else if path.extension().is_some_and(|end| end == "rs") {
            sources.push(path);
        }
    }
    sources
}

/// The module of a file: its path below `src`, without `mod` and `lib`.
fn module(src: &Path, file: &Path) -> Vec<String> {
    let below = file.strip_prefix(src).expect("a file below src");
    let names = below.with_extension("");
    let names = names.iter().map(|name| name.to_string_lossy().into_owned());
    let mut module: Vec<_> = names.collect();
    if module
        .last()
        .is_some_and(|last| ["mod", "lib", "main"].contains(&last.as_str()))
    {
        module.pop();
    }
    module
}

/// The paths that a tree of imports names: `a::{b, c::d}` is `a::b` and `a::c::d`.
fn leaves(tree: &str) -> Vec<Vec<String>> {
    let tree = tree.trim();
    let Some((stem, group)) = tree.split_once('{') else {
        let path = tree.split(" as ").next().unwrap_or(tree);
        return vec![
            path.split("::")
                .map(|name| name.trim().to_owned())
                .collect(),
        ];
    };
    let group = group.trim_end().strip_suffix('}').expect("a group ends");
    let stem = stem.trim().trim_end_matches("::");
    let (mut depth, mut begin, mut leaves_found) = (0, 0, Vec::new());
    for (at, letter) in group.char_indices().chain([(group.len(), ',')]) {
        match letter {
            '{' => depth += 1,
            '}' => depth -= 1,
            ',' if depth == 0 => {
                let part = group[begin..at].trim();
                begin = at + 1;
                if !part.is_empty() {
                    leaves_found.extend(leaves(&format!("{stem}::{part}")));
                }
            }
            _ => {}
        }
    }
    leaves_found
}

/// What a source file has outside of its unit tests.
fn without_tests(text: &str) -> &str {
    let end = text.find("#[cfg(test)]\nmod tests {");
    &text[..end.unwrap_or(text.len())]
}

/// The trees of all `use` lines.
fn uses(text: &str) -> impl Iterator<Item = String> {
    let lines = text.split_inclusive('\n').scan(0, |at, line| {
        *at += line.len();
        Some((*at - line.len(), line))
    });
    lines.filter_map(|(at, line)| {
        let begins = ["use ", "pub use ", "pub(super) use ", "pub(crate) use "];
        let begin = begins.into_iter().find(|begin| line.starts_with(begin))?;
        let tree = &text[at + begin.len()..];
        Some(tree[..tree.find(';')?].replace('\n', " "))
    })
}

/// From the crate's root, where a path seen in a module leads.
fn absolute(module: &[String], path: &[String]) -> Vec<String> {
    let mut from = module.to_vec();
    let mut path = path;
    while let Some((first, rest)) = path.split_first() {
        match first.as_str() {
            "crate" => from.clear(),
            "super" => drop(from.pop()),
            "self" => {}
            _ => break,
        }
        path = rest;
    }
    from.extend_from_slice(path);
    from
}

/// What the files of a crate import of each other.
fn imports(src: &Path) -> Imports {
    let files = sources(src);
    let modules: BTreeSet<_> = files.iter().map(|file| module(src, file)).collect();
    let mut imports = Imports::new();
    for file in &files {
        let own = module(src, file);
        let text = fs::read_to_string(file).expect("a source");
        for tree in uses(without_tests(&text)) {
            for path in leaves(&tree) {
                let mut target = absolute(&own, &path);
                while !target.is_empty() && !modules.contains(&target) {
                    target.pop();
                }
                if !own.starts_with(&target) && !target.starts_with(&own) {
                    imports.entry(own.clone()).or_default().insert(target);
                }
            }
        }
    }
    imports
}

/// A circle through a module, if there is one.
fn circle(imports: &Imports, start: &Vec<String>) -> Option<Vec<String>> {
    let (mut seen, mut open) = (BTreeSet::new(), vec![vec![start]]);
    while let Some(way) = open.pop() {
        let last = *way.last().expect("a way begins");
        for next in imports.get(last).into_iter().flatten() {
            if next == start {
                return Some(way.iter().map(|module| module.join("::")).collect());
            }
            if seen.insert(next) {
                open.push(way.iter().copied().chain([next]).collect());
            }
        }
    }
    None
}

#[test]
fn no_files_import_each_other_in_a_circle() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"))
        .parent()
        .expect("a workspace");
    let (mut circles, mut count) = (Vec::new(), 0);
    for entry in fs::read_dir(root).expect("the workspace") {
        let src = entry.expect("an entry").path().join("src");
        if !src.is_dir() {
            continue;
        }
        let imports = imports(&src);
        count += imports.values().map(BTreeSet::len).sum::<usize>();
        let of_crate = imports.keys().filter_map(|module| circle(&imports, module));
        circles
            .extend(of_crate.map(|circle| format!("{}: {}", src.display(), circle.join(" -> "))));
    }
    assert!(count > 500, "only {count} imports were found");
    assert!(circles.is_empty(), "{}", circles.join("\n"));
}

#[test]
fn trees_of_imports_are_read() {
    let found = leaves("super::{a::{self, B as C}, d, E}");
    let expected = ["super::a::self", "super::a::B", "super::d", "super::E"];
    assert_eq!(
        found.iter().map(|path| path.join("::")).collect::<Vec<_>>(),
        expected
    );
    let text = "use a::{\n    b,\n    c,\n};\npub use d;\n#[cfg(test)]\nmod tests {\n    use super::e;\n}\n";
    let trees: Vec<_> = uses(without_tests(text)).collect();
    assert_eq!(trees.len(), 2);
    assert_eq!(leaves(&trees[0]).len(), 2);
    let module = ["a", "b"].map(str::to_owned);
    let path = ["super", "c", "D"].map(str::to_owned);
    assert_eq!(absolute(&module, &path).join("::"), "a::c::D");
    let two: Imports = [("x", "y"), ("y", "x")]
        .map(|(from, to)| (vec![from.to_owned()], BTreeSet::from([vec![to.to_owned()]])))
        .into();
    assert_eq!(
        circle(&two, &vec!["x".to_owned()]),
        Some(vec!["x".to_owned(), "y".to_owned()])
    );
}
