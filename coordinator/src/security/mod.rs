//! Who may call, and how much a stranger can cost.
//!
//! | module | what |
//! | --- | --- |
//! | `tokens` | which token has which role, compared in constant time |
//! | `guard` | every call: its role, the memory and the time that its message may take |
//! | `budget` | the memory of all messages under way, and who goes when it is full |
//! | `unread` | every answer: the memory of all that nobody reads, and how long one may wait |
//! | `admission` | every connection: how many, and how long each may keep silent at first |
//! | `strangers` | connections that have shown no token: how many, and how long |

pub mod admission;
mod budget;
pub(crate) mod guard;
mod prefix;
mod strangers;
mod tokens;
pub(crate) mod unread;

pub use tokens::{Caller, Role, TokenError, Tokens};

/// What protects a coordinator's port. Unprotected by default, which is safe on a loopback address.
#[derive(Clone, Debug, Default)]
pub struct Security {
    /// Encryption, and proof that the coordinator is who it says.
    pub tls: Option<Tls>,
    /// Which tokens are known; without, everybody may call everything.
    pub tokens: Option<Tokens>,
}

/// A coordinator's side of TLS.
#[derive(Clone)]
pub struct Tls {
    /// Its certificate, PEM.
    pub certificate: Vec<u8>,
    /// The certificate's key, PEM.
    pub key: Vec<u8>,
    /// Where clients have to show a certificate: whose word about them counts, PEM.
    pub client_authority: Option<Vec<u8>>,
}

impl Security {
    /// Whether an address that other machines reach can be served.
    pub fn is_closed(&self) -> bool {
        self.tls.is_some() && self.tokens.is_some()
    }
}

/// The key is not printed.
impl std::fmt::Debug for Tls {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Tls")
            .field("client_authority", &self.client_authority.is_some())
            .finish_non_exhaustive()
    }
}
