//! Text as Markdown.

use std::fmt::Write;

/// What every page begins with: its title, and a comment for those who would edit it.
pub fn head(title: &str) -> String {
    format!(
        "<!-- Written by `brdfarm reference`. Do not edit: see CONTRIBUTING.md. -->\n\n# {title}\n\n"
    )
}

/// Plain text of a help message as Markdown. Code between backticks stays as it is, and the names of
/// options become code.
pub fn prose(text: &str) -> String {
    let mut out = String::new();
    for (place, part) in text.split('`').enumerate() {
        if place % 2 == 1 {
            let _ = write!(out, "`{part}`");
            continue;
        }
        for word in part.split_inclusive(char::is_whitespace) {
            out.push_str(&marked(word));
        }
    }
    out
}

/// A word, as code if it is the name of an option, and otherwise with its special characters escaped.
fn marked(word: &str) -> String {
    let is_name = |c: char| c.is_ascii_alphanumeric() || c == '-';
    let start = word.len() - word.trim_start_matches('(').len();
    let option = &word[start..];
    if option.starts_with("--") {
        let end = option.find(|c| !is_name(c)).unwrap_or(option.len());
        let (name, rest) = option.split_at(end);
        return format!("{}`{name}`{}", &word[..start], escaped(rest));
    }
    escaped(word)
}

fn escaped(text: &str) -> String {
    let mut out = String::new();
    let mut before = None;
    let mut characters = text.chars().peekable();
    while let Some(character) = characters.next() {
        let within_word = |other: Option<char>| other.is_some_and(char::is_alphanumeric);
        // An underscore inside a word marks nothing.
        let is_plain =
            character == '_' && within_word(before) && within_word(characters.peek().copied());
        if "<>*[]|_\\".contains(character) && !is_plain {
            out.push('\\');
        }
        out.push(character);
        before = Some(character);
    }
    out
}

/// A table: its head, then its rows.
pub fn table<const N: usize>(
    head: [&str; N],
    rows: impl IntoIterator<Item = [String; N]>,
) -> String {
    let line = |cells: &[&str]| format!("| {} |\n", cells.join(" | "));
    let mut out = line(&head);
    out += &line(&["---"; N]);
    for row in rows {
        out += &line(&row.each_ref().map(String::as_str));
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn help_becomes_markdown() {
        let text = "A larger --materials (--jobs N), `brdfarm a_b` and <X> in s3://A_B.";
        let expected =
            "A larger `--materials` (`--jobs` N), `brdfarm a_b` and \\<X\\> in s3://A_B.";
        assert_eq!(prose(text), expected);
    }

    #[test]
    fn a_table_has_a_line_for_each_row() {
        let rows = [["1".to_owned(), "2".to_owned()]];
        assert_eq!(
            table(["a", "b"], rows),
            "| a | b |\n| --- | --- |\n| 1 | 2 |\n"
        );
    }
}
