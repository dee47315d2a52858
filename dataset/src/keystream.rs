//! Randomness by place: ChaCha20 keystreams keyed by seed and purpose.
//!
//! Nothing is drawn from a global stream. A key is 24 bytes that name the purpose followed by the
//! seed, little-endian; whatever else tells draws apart is ChaCha20's 64-bit stream number or the
//! position in the stream. Keys of different purposes differ, so their streams are independent.

use rand_chacha::{ChaCha20Rng, rand_core::SeedableRng};

/// What randomness is for: the first 24 bytes of a key.
#[derive(Clone, Copy, Debug)]
pub struct Purpose(pub [u8; 24]);

/// The key of a purpose.
pub fn key(seed: u64, purpose: Purpose) -> [u8; 32] {
    let mut key = [0; 32];
    key[..24].copy_from_slice(&purpose.0);
    key[24..].copy_from_slice(&seed.to_le_bytes());
    key
}

/// The keystream of a purpose, at its beginning.
pub(crate) fn keystream(seed: u64, purpose: Purpose, stream: u64) -> ChaCha20Rng {
    let mut rng = ChaCha20Rng::from_seed(key(seed, purpose));
    rng.set_stream(stream);
    rng
}
