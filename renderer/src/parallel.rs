//! Work that is handed to other threads only where it is worth it.
//!
//! To wake a thread, and to let it look for more, takes as long as some ten thousand evaluations of the
//! reflectance. Most parts of an image at a coarse accuracy take less.

use rayon::prelude::*;

/// Evaluations of the reflectance that are worth other threads: about half a millisecond. Chosen.
const WORTH: u64 = 100_000;

/// Works out all items, in their order. Other threads of the current rayon pool help once `took` tells that what is
/// left may take long. An item is taken to take as many evaluations as the dearest before it, or as `likely`.
///
/// The result depends neither on the pool nor on what is taken to be worth it: buffers carry nothing from item to item.
pub fn map<Item: Sync, Found: Send, Buffers: Default>(
    items: &[Item],
    likely: u64,
    work: impl Fn(&mut Buffers, &Item) -> Found + Sync,
    took: impl Fn(&Found) -> u64,
) -> Vec<Found> {
    let mut found = Vec::with_capacity(items.len());
    let (mut buffers, mut dearest) = (Buffers::default(), likely);
    for (index, item) in items.iter().enumerate() {
        let left = &items[index..];
        if left.len() > 1 && dearest.saturating_mul(left.len() as u64) > WORTH {
            found.par_extend(left.par_iter().map_init(Buffers::default, &work));
            break;
        }
        let next = work(&mut buffers, item);
        dearest = dearest.max(took(&next));
        found.push(next);
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::Mutex;
    use std::thread::{self, ThreadId};

    /// What comes of some items that take so many evaluations each, and the threads that worked on it.
    fn squares(items: &[u64], likely: u64, each: u64) -> (Vec<u64>, Vec<ThreadId>) {
        let threads = Mutex::new(Vec::new());
        let work = |(): &mut (), item: &u64| {
            let mut threads = threads.lock().expect("no test panics");
            threads.push(thread::current().id());
            item * item
        };
        let found = map(items, likely, work, |_| each);
        (found, threads.into_inner().expect("no test panics"))
    }

    #[test]
    fn all_items_are_worked_out_once_and_in_order() {
        for count in [0, 1, 2, 7, 100] {
            let items: Vec<u64> = (0..count).collect();
            let expected: Vec<u64> = items.iter().map(|item| item * item).collect();
            for (likely, each) in [(0, 0), (0, WORTH), (WORTH, 0), (u64::MAX, u64::MAX)] {
                assert_eq!(
                    squares(&items, likely, each).0,
                    expected,
                    "{count} {likely} {each}"
                );
            }
        }
    }

    /// This thread is none of the pool's, so what it did not do itself the pool did.
    #[test]
    fn other_threads_help_where_it_is_worth_it() {
        let items: Vec<u64> = (0..10).collect();
        let mine = |likely, each| {
            let (_, threads) = squares(&items, likely, each);
            threads
                .iter()
                .filter(|id| **id == thread::current().id())
                .count()
        };
        assert_eq!(mine(0, 0), 10);
        assert_eq!(mine(0, WORTH / 10), 10);
        assert_eq!(mine(0, WORTH), 1);
        assert_eq!(mine(WORTH, 0), 0);
        assert_eq!(squares(&[3], WORTH, WORTH).1, [thread::current().id()]);
    }
}
