//! What happens when: the soonest first, and of one instant in the order in which it was planned.

use std::{cmp::Ordering, collections::BinaryHeap, time::Duration};

/// Events that are still to happen.
#[derive(Debug)]
pub struct Events<E> {
    planned: BinaryHeap<Planned<E>>,
    count: u64,
    now: Duration,
}

#[derive(Debug)]
struct Planned<E> {
    at: Duration,
    number: u64,
    event: E,
}

impl<E> Default for Events<E> {
    fn default() -> Self {
        Self {
            planned: BinaryHeap::new(),
            count: 0,
            now: Duration::ZERO,
        }
    }
}

impl<E> Events<E> {
    /// The time since the beginning.
    pub fn now(&self) -> Duration {
        self.now
    }

    /// Plans an event so long from now.
    pub fn after(&mut self, delay: Duration, event: E) {
        let number = self.count;
        self.count += 1;
        let at = self.now + delay;
        self.planned.push(Planned { at, number, event });
    }

    /// How many events were planned so far.
    pub fn count(&self) -> u64 {
        self.count
    }

    /// Takes the next event, at whose time it then is.
    pub fn take_next(&mut self) -> Option<E> {
        let Planned { at, event, .. } = self.planned.pop()?;
        self.now = at;
        Some(event)
    }
}

impl<E> Ord for Planned<E> {
    // The heap gives out its greatest.
    fn cmp(&self, other: &Self) -> Ordering {
        (other.at, other.number).cmp(&(self.at, self.number))
    }
}

impl<E> PartialOrd for Planned<E> {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl<E> PartialEq for Planned<E> {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl<E> Eq for Planned<E> {}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_soonest_is_first_and_equals_keep_their_order() {
        let mut events = Events::default();
        for (milliseconds, name) in [(3, 'd'), (1, 'a'), (2, 'b'), (2, 'c')] {
            events.after(Duration::from_millis(milliseconds), name);
        }
        let mut order = String::new();
        while let Some(name) = events.take_next() {
            if name == 'a' {
                events.after(Duration::from_millis(1), 'e');
            }
            order.push(name);
        }
        assert_eq!(order, "abced");
        assert_eq!(events.now(), Duration::from_millis(3));
    }
}
