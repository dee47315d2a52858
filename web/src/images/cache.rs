//! Bytes that are kept while there is room: those used longest ago go first.

use std::{
    collections::{BTreeMap, HashMap},
    hash::Hash,
    sync::Arc,
};

/// Bytes by key, never more than a stated number of them.
pub struct Cache<K> {
    bytes_max: usize,
    bytes: usize,
    // When each was used last, counted in uses.
    uses: u64,
    kept: HashMap<K, (u64, Arc<[u8]>)>,
    by_use: BTreeMap<u64, K>,
}

impl<K: Clone + Eq + Hash> Cache<K> {
    /// Room for so many bytes.
    pub fn new(bytes_max: usize) -> Self {
        Self {
            bytes_max,
            bytes: 0,
            uses: 0,
            kept: HashMap::new(),
            by_use: BTreeMap::new(),
        }
    }

    /// What is kept under a key.
    pub fn get(&mut self, key: &K) -> Option<Arc<[u8]>> {
        let (used, bytes) = self.kept.get_mut(key)?;
        self.by_use.remove(used);
        self.uses += 1;
        *used = self.uses;
        self.by_use.insert(self.uses, key.clone());
        Some(Arc::clone(bytes))
    }

    /// Keeps bytes, in place of those that were used longest ago. What is larger than all the room is
    /// not kept.
    pub fn put(&mut self, key: K, bytes: Arc<[u8]>) {
        self.remove(&key);
        if bytes.len() > self.bytes_max {
            return;
        }
        while self.bytes + bytes.len() > self.bytes_max
            && let Some((_, oldest)) = self.by_use.first_key_value()
        {
            self.remove(&oldest.clone());
        }
        self.uses += 1;
        self.bytes += bytes.len();
        self.by_use.insert(self.uses, key.clone());
        self.kept.insert(key, (self.uses, bytes));
    }

    fn remove(&mut self, key: &K) {
        if let Some((used, bytes)) = self.kept.remove(key) {
            self.bytes -= bytes.len();
            self.by_use.remove(&used);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn those_used_longest_ago_go_first() {
        let mut cache = Cache::new(10);
        let bytes = |count| Arc::<[u8]>::from(vec![0; count]);
        cache.put('a', bytes(4));
        cache.put('b', bytes(4));
        assert!(cache.get(&'a').is_some());
        cache.put('c', bytes(4));
        assert!(cache.get(&'b').is_none());
        assert!(cache.get(&'a').is_some() && cache.get(&'c').is_some());
        cache.put('d', bytes(11));
        assert!(cache.get(&'d').is_none() && cache.get(&'a').is_some());
    }

    proptest! {
        #[test]
        fn it_never_holds_more_than_its_size(
            steps in proptest::collection::vec((0..12u8, 0..40usize, any::<bool>()), 0..200),
        ) {
            let mut cache = Cache::new(100);
            for (key, length, gets) in steps {
                if gets {
                    cache.get(&key);
                } else {
                    cache.put(key, vec![key; length].into());
                }
                let held: usize = cache.kept.values().map(|(_, bytes)| bytes.len()).sum();
                prop_assert_eq!(held, cache.bytes);
                prop_assert!(held <= 100);
                prop_assert_eq!(cache.kept.len(), cache.by_use.len());
                for (used, key) in &cache.by_use {
                    prop_assert_eq!(cache.kept[key].0, *used);
                }
            }
        }
    }
}
