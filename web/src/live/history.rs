//! What the farm did lately: events, completed materials, and images a minute over the last hour.

use limits::web::{LAST_EVENTS, LAST_IMAGES};
use proto::Event;
use std::{
    collections::VecDeque,
    time::{Duration, Instant},
};

/// How long one point of the rate stands for.
const MINUTE: Duration = Duration::from_secs(60);

/// Points of the rate that are kept: an hour.
const MINUTES: usize = 60;

/// How often images are counted when nobody looks.
const COUNT_PAUSE: Duration = Duration::from_secs(10);

/// What happened lately.
#[derive(Clone, Debug)]
pub struct History {
    began: Instant,
    /// Events, the newest first.
    pub events: VecDeque<Event>,
    /// Completed materials, the newest first.
    pub completed: VecDeque<u32>,
    // When images were counted last, and how many there were.
    counted: Option<(Instant, u64)>,
    // The minute in which images were counted first.
    first: Option<u64>,
    // Minutes since the start, and images completed in each; those without one may be absent.
    minutes: VecDeque<(u64, u64)>,
}

/// Images a second over the last hour.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rate {
    /// The mean over whole minutes.
    pub mean: f64,
    /// The standard error of that mean.
    pub error: f64,
}

impl History {
    /// Nothing so far.
    pub fn new(began: Instant) -> Self {
        Self {
            began,
            events: VecDeque::new(),
            completed: VecDeque::new(),
            counted: None,
            first: None,
            minutes: VecDeque::new(),
        }
    }

    /// Notes what happened.
    pub fn note_event(&mut self, event: Event) {
        if let Some(material) = completed(&event) {
            self.completed.retain(|other| *other != material);
            self.completed.push_front(material);
            self.completed.truncate(LAST_IMAGES);
        }
        // Leases are too many to read.
        if event.kind != "leased" {
            self.events.push_front(event);
            self.events.truncate(LAST_EVENTS);
        }
    }

    /// Whether images have not been counted for a while.
    pub fn wants_images(&self, now: Instant) -> bool {
        self.counted
            .is_none_or(|(at, _)| now.saturating_duration_since(at) >= COUNT_PAUSE)
    }

    /// Notes how many images there are.
    pub fn note_images(&mut self, images: u64, now: Instant) {
        let before = self.counted.replace((now, images));
        let more = before.map_or(0, |(_, before)| images.saturating_sub(before));
        let minute = self.minute(now);
        self.first.get_or_insert(minute);
        match self.minutes.back_mut() {
            Some((last, count)) if *last == minute => *count += more,
            _ => self.minutes.push_back((minute, more)),
        }
        let oldest = minute.saturating_sub(MINUTES as u64);
        while self.minutes.front().is_some_and(|(at, _)| *at < oldest) {
            self.minutes.pop_front();
        }
    }

    /// Images a second by how many minutes ago they came, the oldest first; whole minutes alone.
    pub fn points(&self, now: Instant) -> Vec<(f64, f64)> {
        let minute = self.minute(now);
        let oldest = minute.saturating_sub(MINUTES as u64);
        // In its first minute the counting began somewhere.
        let first = self.first.map_or(minute, |first| first + 1);
        let of = |at: u64| {
            let found = self.minutes.iter().find(|(minute, _)| *minute == at);
            found.map_or(0, |(_, count)| *count)
        };
        (oldest.max(first)..minute)
            .map(|at| ((minute - at) as f64, of(at) as f64 / MINUTE.as_secs_f64()))
            .collect()
    }

    /// The rate over the last hour; none before there are two whole minutes.
    pub fn rate(&self, now: Instant) -> Option<Rate> {
        let rates: Vec<f64> = self.points(now).into_iter().map(|(_, rate)| rate).collect();
        let count = rates.len() as f64;
        if rates.len() < 2 {
            return None;
        }
        let mean = rates.iter().sum::<f64>() / count;
        let squares: f64 = rates.iter().map(|rate| (rate - mean) * (rate - mean)).sum();
        Some(Rate {
            mean,
            error: (squares / (count - 1.0) / count).sqrt(),
        })
    }

    fn minute(&self, now: Instant) -> u64 {
        now.saturating_duration_since(self.began).as_secs() / MINUTE.as_secs()
    }
}

/// Whether an event tells of a completed material.
fn completed(event: &Event) -> Option<u32> {
    (event.kind == "completed").then_some(event.material)?
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_rate_is_the_mean_of_whole_minutes_with_its_error() {
        let began = Instant::now();
        let at = |seconds: u64| began + Duration::from_secs(seconds);
        let mut history = History::new(began);
        history.note_images(1_000, at(0));
        assert_eq!(history.rate(at(30)), None);
        // 60 and 180 images in the second and third minute, none in the fourth.
        history.note_images(1_006, at(59));
        history.note_images(1_066, at(119));
        history.note_images(1_246, at(179));
        history.note_images(1_246, at(245));
        assert_eq!(
            history.points(at(245)),
            [(3.0, 1.0), (2.0, 3.0), (1.0, 0.0)]
        );
        let rate = history.rate(at(245)).unwrap();
        assert!((rate.mean - 4.0 / 3.0).abs() < 1e-12);
        // Deviations of -1/3, 5/3, -4/3: variance 7/3 over 3 minutes.
        assert!((rate.error - (7.0f64 / 9.0).sqrt()).abs() < 1e-12);
        // A store that lost images is no negative rate, and an hour is all that counts.
        history.note_images(5, at(250));
        history.note_images(5, at(4_000));
        assert!(history.points(at(4_000)).len() <= MINUTES);
        assert_eq!(history.rate(at(4_000)).unwrap().mean, 0.0);
    }

    #[test]
    fn the_newest_come_first_and_no_more_than_a_page_holds() {
        let mut history = History::new(Instant::now());
        for material in 0..100 {
            for kind in ["leased", "completed"] {
                history.note_event(Event {
                    kind: kind.to_owned(),
                    material: Some(material),
                    ..Event::default()
                });
            }
        }
        assert_eq!(history.events.len(), LAST_EVENTS);
        assert_eq!(history.completed.len(), LAST_IMAGES);
        assert_eq!(history.completed[0], 99);
        assert!(history.events.iter().all(|event| event.kind == "completed"));
    }
}
