//! How many things happen a second, over the last minute.

use std::{collections::VecDeque, time::Duration};

/// Over how long the rate is taken.
const WINDOW: Duration = Duration::from_secs(60);

/// Counts by second; no more than a window of them.
#[derive(Debug, Default)]
pub(crate) struct Rate {
    // (second since the start, count), oldest first.
    counts: VecDeque<(u64, u64)>,
}

impl Rate {
    pub fn count(&mut self, things: u64, now: Duration) {
        let second = now.as_secs();
        match self.counts.back_mut() {
            Some((last, count)) if *last == second => *count += things,
            _ => self.counts.push_back((second, things)),
        }
        let oldest = second.saturating_sub(WINDOW.as_secs());
        while self.counts.front().is_some_and(|(at, _)| *at < oldest) {
            self.counts.pop_front();
        }
    }

    /// Things a second, over the last minute or since the start where that is less.
    pub fn per_second(&self, now: Duration) -> f64 {
        let oldest = now.as_secs().saturating_sub(WINDOW.as_secs());
        let recent = self.counts.iter().filter(|(at, _)| *at >= oldest);
        let things: u64 = recent.map(|(_, count)| count).sum();
        let seconds = now.min(WINDOW).as_secs_f64();
        things as f64 / seconds.max(1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_rate_forgets_what_is_older_than_a_minute() {
        let mut rate = Rate::default();
        let at = Duration::from_secs;
        rate.count(20, at(10));
        assert_eq!(rate.per_second(at(20)), 1.0);
        rate.count(30, at(10) + Duration::from_millis(400));
        rate.count(10, at(60));
        assert_eq!(rate.per_second(at(60)), 1.0);
        assert_eq!(rate.per_second(at(100)), 10.0 / 60.0);
        assert_eq!(rate.per_second(at(1000)), 0.0);
        rate.count(1, at(1000));
        assert_eq!(rate.counts.len(), 1);
    }
}
