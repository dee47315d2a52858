//! The shell lines of a Markdown page.

/// What is typed at one time: a line, with those that continue it.
pub struct Statement {
    /// The number of its first line in the page.
    pub line: usize,
    pub text: String,
}

/// Where a statement ends.
enum End<'a> {
    /// With the first line that has no backslash at its end.
    Line,
    /// With `done`.
    Loop,
    /// With this word, alone on its line.
    Word(&'a str),
}

impl<'a> End<'a> {
    fn of(first: &'a str) -> Self {
        if first.starts_with("for ") {
            return Self::Loop;
        }
        let word = first
            .split_once("<<'")
            .and_then(|(_, rest)| rest.split_once('\''));
        word.map_or(Self::Line, |(word, _)| Self::Word(word))
    }

    fn is(&self, line: &str) -> bool {
        match self {
            Self::Line => !line.ends_with('\\'),
            Self::Loop => line.starts_with("done"),
            Self::Word(word) => line == *word,
        }
    }
}

/// The statements of all shell blocks, without comments and empty lines.
pub fn statements(page: &str) -> Vec<Statement> {
    let mut lines = (1..).zip(page.lines());
    let mut found = Vec::new();
    while let Some((_, fence)) = lines.next() {
        if !["```sh", "```bash", "```shell", "```console"].contains(&fence.trim()) {
            continue;
        }
        while let Some((line, first)) = lines.next().filter(|(_, text)| text.trim() != "```") {
            if first.trim().is_empty() || first.starts_with('#') {
                continue;
            }
            let end = End::of(first);
            let mut text = first.to_owned();
            let mut last = first;
            while !end.is(last) {
                (_, last) = lines.next().expect("the statement ends");
                text = format!("{text}\n{last}");
            }
            found.push(Statement { line, text });
        }
    }
    found
}
