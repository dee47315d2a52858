//! Lines, words and numbers of a text whose bytes need not be UTF-8.

/// Characters of a file that a message repeats.
const QUOTED_CHARACTERS_MAX: usize = 24;

/// The lines of a text, numbered from 1.
pub struct Lines<'a> {
    rest: &'a [u8],
    end: u8,
    number: usize,
}

impl<'a> Lines<'a> {
    /// Lines that end with LF or CR LF; with CR alone where the text has no LF.
    pub fn of(text: &'a [u8]) -> Self {
        let end = if text.contains(&b'\n') { b'\n' } else { b'\r' };
        Self::ending_with(end, text)
    }

    /// Lines that end with a byte; a CR before an LF counts as white space.
    pub fn ending_with(end: u8, text: &'a [u8]) -> Self {
        Self {
            rest: text,
            end,
            number: 0,
        }
    }

    /// What follows the last line that was taken.
    pub fn rest(&self) -> &'a [u8] {
        self.rest
    }

    /// The number of the last line that was taken.
    pub fn number(&self) -> usize {
        self.number
    }

    /// The same lines over another text, which follows.
    pub fn go_on(self, text: &'a [u8]) -> Self {
        Self { rest: text, ..self }
    }

    /// The next line and whether it was ended.
    pub fn take(&mut self) -> Option<(&'a [u8], bool)> {
        if self.rest.is_empty() {
            return None;
        }
        self.number += 1;
        let length = self.rest.iter().position(|byte| *byte == self.end);
        let (line, rest) = match length.and_then(|length| self.rest.split_at_checked(length)) {
            Some((line, rest)) => (line, rest.get(1..)),
            None => (self.rest, None),
        };
        self.rest = rest.unwrap_or_default();
        Some((line, rest.is_some()))
    }
}

/// Takes the next word off a line.
pub fn take_word<'a>(line: &mut &'a [u8]) -> Option<&'a [u8]> {
    let start = line.trim_ascii_start();
    let length = start.iter().position(u8::is_ascii_whitespace);
    let (word, rest) = start
        .split_at_checked(length.unwrap_or(start.len()))
        .unwrap_or((start, &[]));
    *line = rest;
    (!word.is_empty()).then_some(word)
}

/// The number that a word is, if it is one; NaN and infinities are numbers here.
pub fn number<T: std::str::FromStr>(word: &[u8]) -> Option<T> {
    str::from_utf8(word).ok()?.parse().ok()
}

/// Bytes of a file as a message may repeat them: on one line, bounded.
pub fn quoted(bytes: &[u8]) -> String {
    // A character has at most four bytes.
    let bytes = bytes.get(..4 * QUOTED_CHARACTERS_MAX).unwrap_or(bytes);
    let text = String::from_utf8_lossy(bytes);
    let mut shown: String = text
        .chars()
        .take(QUOTED_CHARACTERS_MAX)
        .flat_map(char::escape_debug)
        .collect();
    if text.chars().nth(QUOTED_CHARACTERS_MAX).is_some() {
        shown.push_str("...");
    }
    format!("`{shown}`")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lines(text: &str) -> Vec<(&[u8], bool)> {
        let mut lines = Lines::of(text.as_bytes());
        std::iter::from_fn(|| lines.take()).collect()
    }

    #[test]
    fn lines_end_with_lf_or_else_with_cr() {
        let expected: [(&[u8], bool); 3] = [(b"a", true), (b"", true), (b"b", false)];
        assert_eq!(lines("a\n\nb"), expected);
        assert_eq!(lines("a\r\rb"), expected);
        assert_eq!(lines("a\r\n"), [(&b"a\r"[..], true)]);
        assert_eq!(lines(""), []);
    }

    #[test]
    fn words_stand_between_white_space() {
        let mut line = &b" \tv  -1.5\r"[..];
        assert_eq!(take_word(&mut line), Some(&b"v"[..]));
        let word = take_word(&mut line).unwrap();
        assert_eq!(number(word), Some(-1.5));
        assert_eq!(number::<i64>(word), None);
        assert_eq!(take_word(&mut line), None);
        assert_eq!(take_word(&mut line), None);
    }

    #[test]
    fn a_quotation_is_one_bounded_line() {
        assert_eq!(quoted(b"a\n\xff"), "`a\\n\u{fffd}`");
        let long = quoted("\u{10348}".repeat(1000).as_bytes());
        assert_eq!(long.chars().count(), QUOTED_CHARACTERS_MAX + 2);
        assert!(quoted(&[b'x'; 25]).ends_with("x...`"));
    }
}
