//! Progress where a person waits: a bar on a terminal, nothing elsewhere.

use crate::plural::count;
use coordinator::Progress;
use indicatif::{MultiProgress, ProgressBar, ProgressStyle};
use std::io::{self, Write};
use std::sync::LazyLock;
use std::time::Duration;

/// All bars of the process, so that logs know what to step over.
static BARS: LazyLock<MultiProgress> = LazyLock::new(MultiProgress::new);

/// How often a bar that stands still is drawn again.
const REDRAW: Duration = Duration::from_millis(500);

/// The farm's bar: images, images a second, time left, errors.
pub struct FarmBar {
    bar: ProgressBar,
}

impl FarmBar {
    /// A bar that starts at what is there already.
    pub fn new(images_total: u64, images_there: u64) -> Self {
        let bar = BARS
            .add(ProgressBar::new(images_total))
            .with_style(style(
                "{wide_bar} {pos}/{len} images  {per_sec}  {eta} left  {msg}",
            ))
            .with_position(images_there);
        bar.reset_eta();
        bar.enable_steady_tick(REDRAW);
        Self { bar }
    }

    /// Shows how far the farm is.
    pub fn show(&self, progress: &Progress) {
        self.bar.set_position(progress.images);
        self.bar.set_message(match progress.failures {
            0 => String::new(),
            errors => count(errors, "error"),
        });
    }

    /// Takes the bar away.
    pub fn clear(&self) {
        self.bar.finish_and_clear();
    }
}

/// A bar over `total` things called `what`.
pub fn bar(total: u64, what: &'static str) -> ProgressBar {
    let bar = BARS
        .add(ProgressBar::new(total))
        .with_style(style("{wide_bar} {pos}/{len} {msg}  {eta} left"));
    bar.set_message(what);
    bar.enable_steady_tick(REDRAW);
    bar
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
