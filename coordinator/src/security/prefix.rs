//! How long a message says that it will be.
//!
//! A call's body begins with a byte that tells whether the message is compressed, and four bytes with
//! its length, the highest first ("Length-Prefixed-Message" in gRPC over HTTP/2). They may arrive in
//! pieces.

use limits::MESSAGE_PREFIX_BYTES as BYTES;

/// What has arrived of them.
#[derive(Default)]
pub(super) struct Prefix {
    bytes: [u8; BYTES],
    arrived: usize,
}

impl Prefix {
    /// Reads what arrives next of the body. Once the prefix is whole, returns the length of prefix and
    /// message in bytes; after that none.
    pub fn read(&mut self, data: &[u8]) -> Option<usize> {
        let missing = BYTES - self.arrived;
        let new = missing.min(data.len());
        self.bytes[self.arrived..][..new].copy_from_slice(&data[..new]);
        self.arrived += new;
        let [_, length @ ..] = self.bytes;
        let is_new = new > 0 && self.arrived == BYTES;
        is_new.then(|| BYTES.saturating_add(u32::from_be_bytes(length) as usize))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::{collection::vec, prelude::*};

    proptest! {
        /// In whatever pieces a body arrives, its length is told once, with the fifth byte.
        #[test]
        fn the_length_is_told_once(length: u32, compressed: bool, pieces in vec(0_usize..9, 0..40)) {
            let mut body = vec![u8::from(compressed)];
            body.extend(length.to_be_bytes());
            body.extend([0xff; 400]);
            let (mut prefix, mut at) = (Prefix::default(), 0);
            for piece in pieces {
                let told = prefix.read(&body[at..at + piece]);
                let is_whole = at < BYTES && at + piece >= BYTES;
                prop_assert_eq!(told, is_whole.then(|| BYTES + length as usize));
                at += piece;
            }
        }
    }
}
