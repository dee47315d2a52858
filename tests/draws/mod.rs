//! What tests draw at random, so that a run that failed can be repeated.

use std::time::{SystemTime, UNIX_EPOCH};

/// The run's seed, from `BRDFARM_SEED` or else from the time; printed.
pub fn seed() -> u64 {
    let given = std::env::var("BRDFARM_SEED").ok();
    let now = || {
        SystemTime::now()
            .duration_since(UNIX_EPOCH)
            .map_or(0, |now| now.as_nanos() as u64)
    };
    let seed = given.map_or_else(now, |seed| seed.parse().expect("BRDFARM_SEED is a number"));
    println!("BRDFARM_SEED={seed}");
    seed
}

/// Numbers drawn at random from a seed: SplitMix64 (Steele, Lea and Flood 2014).
pub struct Draws(pub u64);

impl Draws {
    pub fn below(&mut self, end: u64) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut bits = self.0;
        bits = (bits ^ (bits >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        bits = (bits ^ (bits >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        (bits ^ (bits >> 31)) % end
    }
}
