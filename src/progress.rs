//! Progress where a person waits: a bar on a terminal, a line now and then elsewhere.

use crate::plural::{count, time};
use clap::ValueEnum;
use coordinator::Progress;
use indicatif::{MultiProgress, ProgressBar, ProgressStyle, WeakProgressBar};
use rustix::termios;
use serde::Serialize;
use std::{
    collections::VecDeque,
    io::{self, IsTerminal, Write},
    sync::{LazyLock, Mutex, PoisonError},
    thread,
    time::{Duration, Instant},
};

/// All bars of the process, so that logs know what to step over.
static BARS: LazyLock<MultiProgress> = LazyLock::new(MultiProgress::new);

/// How often a bar that stands still is drawn again.
const REDRAW: Duration = Duration::from_millis(500);

/// How often a line is written where there is no terminal.
const LINE_INTERVAL: Duration = Duration::from_secs(30);

/// With fewer columns there is no room for a bar beside the text.
const BAR_COLUMNS_MIN: u16 = 72;

/// Over how long the rate is measured.
const RATE_WINDOW: Duration = Duration::from_secs(60);

/// How often it is, at most.
const RATE_INTERVAL: Duration = Duration::from_secs(1);

/// How a run says how far it is.
#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum Style {
    /// A bar on a terminal, a line every 30 seconds elsewhere
    Text,
    /// On standard error one JSON object a second: images, total, rate (images a second, over the last
    /// minute), errors. When nobody reads them any more, the run stops
    Json,
}

/// A program that reads the progress is gone.
pub struct ReaderGone;

/// How far the farm is: images, images a second, time left, errors.
pub enum FarmProgress {
    /// For people.
    Bar(FarmBar),
    /// For programs.
    Lines(FarmLines),
}

impl FarmProgress {
    /// Begins at what is there already.
    pub fn new(style: Style, images_total: u64, images_there: u64) -> Self {
        match style {
            Style::Text => Self::Bar(FarmBar::new(images_total, images_there)),
            Style::Json => Self::Lines(FarmLines::new(images_total, images_there)),
        }
    }

    /// Shows how far the farm is.
    pub fn show(&self, progress: &Progress) -> Result<(), ReaderGone> {
        match self {
            Self::Bar(bar) => {
                bar.show(progress);
                Ok(())
            }
            Self::Lines(lines) => lines.write(progress),
        }
    }

    /// Takes what is shown away.
    pub fn clear(&self) {
        if let Self::Bar(bar) = self {
            bar.clear();
        }
    }
}

/// Progress as JSON.
pub struct FarmLines {
    total: u64,
    // When the last line was written, and of how many images it told.
    written: Mutex<Option<(Instant, u64)>>,
    recent: Mutex<Recent>,
}

/// One of its lines.
#[derive(Serialize)]
struct Line {
    images: u64,
    total: u64,
    rate: f64,
    errors: u64,
}

impl FarmLines {
    fn new(total: u64, images_there: u64) -> Self {
        Self {
            total,
            written: Mutex::new(None),
            recent: Mutex::new(Recent::new(Instant::now(), images_there)),
        }
    }

    /// Writes a line, unless the last is not a second old. That all are there is told at once.
    fn write(&self, progress: &Progress) -> Result<(), ReaderGone> {
        let now = Instant::now();
        let rate = noted(&self.recent, progress.images);
        let mut written = self.written.lock().unwrap_or_else(PoisonError::into_inner);
        let is_told = |(at, images)| {
            let is_recent = now.duration_since(at) < RATE_INTERVAL;
            images >= self.total || is_recent && progress.images < self.total
        };
        if written.is_some_and(is_told) {
            return Ok(());
        }
        *written = Some((now, progress.images));
        let line = Line {
            images: progress.images,
            total: self.total,
            rate,
            errors: progress.failures,
        };
        let line = serde_json::to_string(&line)
            .unwrap_or_else(|_| unreachable!("numbers under names are JSON"));
        writeln!(io::stderr(), "{line}").map_err(|_| ReaderGone)
    }
}

/// Notes how many images there are now; returns how many come a second.
fn noted(recent: &Mutex<Recent>, images: u64) -> f64 {
    let mut recent = recent.lock().unwrap_or_else(PoisonError::into_inner);
    recent.note(Instant::now(), images);
    recent.rate(Instant::now())
}

/// The farm's bar.
pub struct FarmBar {
    bar: ProgressBar,
    recent: Mutex<Recent>,
}

impl FarmBar {
    fn new(images_total: u64, images_there: u64) -> Self {
        let bar = added(
            images_total,
            [
                "{wide_bar} {pos}/{len} images  {msg}",
                "{pos}/{len} {wide_msg}",
            ],
        );
        bar.set_position(images_there);
        let recent = Mutex::new(Recent::new(Instant::now(), images_there));
        Self { bar, recent }
    }

    fn show(&self, progress: &Progress) {
        let rate = noted(&self.recent, progress.images);
        let left = self.bar.length().unwrap_or_default();
        let left = left.saturating_sub(progress.images);
        let mut said = Vec::new();
        // While nothing comes nobody knows how long it takes.
        if rate > 0.0 {
            said.push(format!("{rate:.1}/s"));
            said.push(format!("{} left", time(left as f64 / rate)));
        }
        if progress.failures > 0 {
            said.push(count(progress.failures, "error"));
        }
        self.bar.set_position(progress.images);
        self.bar.set_message(said.join(", "));
    }

    fn clear(&self) {
        self.bar.finish_and_clear();
    }
}

/// How many images there were at which time, the last minute long.
struct Recent(VecDeque<(Instant, u64)>);

impl Recent {
    fn new(now: Instant, images: u64) -> Self {
        Self(VecDeque::from([(now, images)]))
    }

    fn note(&mut self, now: Instant, images: u64) {
        let is_next = |(at, _): &(Instant, u64)| now.duration_since(*at) >= RATE_INTERVAL;
        // The first stays: it is what the others are compared with.
        if self.0.len() < 2 || self.0.iter().rev().nth(1).is_some_and(is_next) {
            self.0.push_back((now, images));
        } else if let Some(last) = self.0.back_mut() {
            *last = (now, images);
        }
        let is_old = |(at, _): &(Instant, u64)| now.duration_since(*at) > RATE_WINDOW;
        while self.0.len() > 2 && self.0.get(1).is_some_and(is_old) {
            self.0.pop_front();
        }
    }

    /// Images a second.
    fn rate(&self, now: Instant) -> f64 {
        let (Some((began, before)), Some((_, images))) = (self.0.front(), self.0.back()) else {
            return 0.0;
        };
        let seconds = now.duration_since(*began).as_secs_f64();
        match seconds > 0.0 {
            // What turns out to be wrong is taken back.
            true => images.saturating_sub(*before) as f64 / seconds,
            false => 0.0,
        }
    }
}

/// A bar over `total` things called `what`.
pub fn bar(total: u64, what: &'static str) -> ProgressBar {
    let bar = added(
        total,
        [
            "{wide_bar} {pos}/{len} {msg}  {eta} left",
            "{pos}/{len} {wide_msg} {eta}",
        ],
    );
    bar.set_message(what);
    bar
}

/// A bar with its template for a terminal of usual width and that for a narrow one.
fn added(total: u64, [wide, narrow]: [&str; 2]) -> ProgressBar {
    let columns = termios::tcgetwinsize(io::stderr()).map(|size| size.ws_col);
    let template = match columns {
        Ok(1..BAR_COLUMNS_MIN) => narrow,
        _ => wide,
    };
    let bar = BARS
        .add(ProgressBar::new(total))
        .with_style(style(template));
    bar.enable_steady_tick(REDRAW);
    if !io::stderr().is_terminal() {
        let bar = bar.downgrade();
        thread::spawn(move || write_lines(&bar));
    }
    bar
}

/// Says how far a bar is, now and then, until it is gone.
fn write_lines(bar: &WeakProgressBar) {
    loop {
        thread::sleep(LINE_INTERVAL);
        let Some(bar) = bar.upgrade().filter(|bar| !bar.is_finished()) else {
            return;
        };
        let (done, total) = (bar.position(), bar.length().unwrap_or_default());
        // Standard error may be gone; there is nobody left to tell.
        let _ = writeln!(io::stderr(), "{done} of {total} {}", bar.message());
    }
}

fn style(template: &str) -> ProgressStyle {
    ProgressStyle::with_template(template)
        .unwrap_or_else(|_| unreachable!("the templates above are well formed"))
}

/// Standard error for logs: bars make way for every line and come back below it.
pub struct AboveBars;

impl Write for AboveBars {
    fn write(&mut self, line: &[u8]) -> io::Result<usize> {
        BARS.suspend(|| io::stderr().write(line))
    }

    fn flush(&mut self) -> io::Result<()> {
        io::stderr().flush()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A run that goes on from 5,000 images and makes 10 a second says 10.
    #[test]
    fn the_rate_is_that_of_the_last_minute() {
        let began = Instant::now();
        let mut recent = Recent::new(began, 5_000);
        assert_eq!(recent.rate(began), 0.0);
        let later = |seconds: u64| began + Duration::from_secs(seconds);
        for second in 1..=300 {
            recent.note(later(second), 5_000 + 10 * second);
            assert!((recent.rate(later(second)) - 10.0).abs() < 1e-9);
        }
        assert!(recent.0.len() < 70);
        // Nothing comes any more.
        recent.note(later(360), 8_000);
        assert!(recent.rate(later(360)) < 1.0);
        recent.note(later(420), 8_000);
        recent.note(later(421), 8_000);
        assert_eq!(recent.rate(later(421)), 0.0);
    }
}
