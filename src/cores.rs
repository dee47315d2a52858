//! How much of the machine a command uses.

use std::num::NonZero;
use std::thread::available_parallelism;

/// The most threads or workers that one process may be told to start.
pub const COUNT_MAX: u64 = 1024;

/// As many as asked for, where 0 asks for one a core.
pub fn count(asked: u64) -> usize {
    match asked {
        0 => available_parallelism().map_or(1, NonZero::get),
        asked => asked as usize,
    }
}
