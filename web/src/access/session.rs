//! A token exchanged once for a cookie.
//!
//! ```text
//! cookie = TAG . NUMBER . END . MAC        (hexadecimal digits)
//! ```
//!
//! TAG names the token by the begin of its digest, NUMBER is random, END is when the session ends in
//! seconds since 1970, and MAC is the keyed BLAKE3 hash of what stands before it. The key is derived
//! from the token. So a coordinator that starts again, or another over the same store, knows the
//! cookie, nobody makes one without a token, and a token that is taken out of the file ends its
//! sessions. Which sessions were ended early each process remembers for itself: after it starts again,
//! such a cookie counts until END, unless its token goes.

use crate::problem::Problem;
use coordinator::security::{Role, Tokens};
use dataset::Digest;
use limits::web::{SESSION, SESSIONS_ENDED_MAX};
use std::{
    collections::BTreeMap,
    sync::{Mutex, PoisonError},
    time::{SystemTime, UNIX_EPOCH},
};
use subtle::ConstantTimeEq;

/// The name of the cookie.
pub const COOKIE: &str = "brdfarm_session";

/// What keys are derived for.
const PURPOSE: &str = "brdfarm 2026-11-25 sessions of pages in a browser";

/// Digits of a token's tag: enough that no two tokens of a file have the same.
const TAG_DIGITS: usize = 16;

/// Bytes of a session's number.
const NUMBER_BYTES: usize = 16;

/// The sessions that were ended before their time.
#[derive(Default)]
pub struct Sessions {
    ended: Mutex<Ended>,
}

#[derive(Default)]
struct Ended {
    // By tag and number: when each would have ended.
    sessions: BTreeMap<(String, String), u64>,
    // By tag: sessions that would end by then are over, all of them.
    up_to: BTreeMap<String, u64>,
}

impl Ended {
    fn holds(&self, parts: &Parts<'_>) -> bool {
        let session = (parts.tag.to_owned(), parts.number.to_owned());
        let up_to = self.up_to.get(parts.tag);
        self.sessions.contains_key(&session) || up_to.is_some_and(|up_to| parts.end <= *up_to)
    }

    /// Notes that a session is over. Where that is one too many to remember, all sessions of its token
    /// are: whoever ends thousands signs in again, and no session that was ended counts again.
    fn note(&mut self, parts: &Parts<'_>, now: u64) {
        self.sessions.retain(|_, end| *end > now);
        let session = (parts.tag.to_owned(), parts.number.to_owned());
        self.sessions.insert(session, parts.end);
        if self.sessions.len() > SESSIONS_ENDED_MAX {
            self.sessions.retain(|(tag, _), _| tag != parts.tag);
            self.up_to
                .insert(parts.tag.to_owned(), now + SESSION.as_secs());
        }
    }
}

/// A cookie taken apart.
struct Parts<'a> {
    tag: &'a str,
    number: &'a str,
    end: u64,
    mac: &'a str,
    // What the MAC is of.
    signed: &'a str,
}

impl Sessions {
    /// Begins a session of a token that is known; returns its cookie.
    ///
    /// # Errors
    /// When the system gives no random bytes.
    pub fn begin(&self, token: &[u8], tokens: &Tokens) -> Result<String, Problem> {
        let mut number = [0; NUMBER_BYTES];
        getrandom::fill(&mut number)
            .map_err(|error| Problem::broken(format!("no random number: {error}")))?;
        let digest = Digest::of(token);
        let tag = tag(&digest);
        let end = now() + SESSION.as_secs();
        let signed = format!("{tag}.{:x}.{end:x}", u128::from_be_bytes(number));
        let Some((key, _)) = key(tokens, &tag) else {
            return Err(Problem::forbidden("this token is not known"));
        };
        Ok(format!("{signed}.{}", mac(&key, &signed)))
    }

    /// The role of whoever has this cookie, if it is one of ours and its session goes on.
    pub fn role(&self, tokens: &Tokens, cookie: &str) -> Option<Role> {
        let parts = Parts::of(cookie)?;
        let role = parts.verified(tokens)?;
        let ended = self.ended.lock().unwrap_or_else(PoisonError::into_inner);
        (parts.end > now() && !ended.holds(&parts)).then_some(role)
    }

    /// Ends a session.
    pub fn end(&self, tokens: &Tokens, cookie: &str) {
        let Some(parts) = Parts::of(cookie) else {
            return;
        };
        // Whoever has no token fills no memory.
        if parts.verified(tokens).is_some() {
            let mut ended = self.ended.lock().unwrap_or_else(PoisonError::into_inner);
            ended.note(&parts, now());
        }
    }
}

impl<'a> Parts<'a> {
    fn of(cookie: &'a str) -> Option<Self> {
        // Nothing of ours is longer.
        if cookie.len() > 256 {
            return None;
        }
        let (signed, mac) = cookie.rsplit_once('.')?;
        let mut parts = signed.split('.');
        let (tag, number, end) = (parts.next()?, parts.next()?, parts.next()?);
        if parts.next().is_some() || number.is_empty() {
            return None;
        }
        Some(Self {
            tag,
            number,
            end: u64::from_str_radix(end, 16).ok()?,
            mac,
            signed,
        })
    }

    fn verified(&self, tokens: &Tokens) -> Option<Role> {
        let (key, role) = key(tokens, self.tag)?;
        let expected = mac(&key, self.signed);
        let is_ours: bool = expected.as_bytes().ct_eq(self.mac.as_bytes()).into();
        is_ours.then_some(role)
    }
}

/// The key of the token with this tag, and its role.
fn key(tokens: &Tokens, wanted: &str) -> Option<([u8; 32], Role)> {
    let mut known = tokens.digests();
    let (role, digest) = known.find(|(_, digest)| tag(digest) == wanted)?;
    Some((blake3::derive_key(PURPOSE, digest.as_bytes()), role))
}

/// The tag tells nothing of the token, and only little of its digest: it is of the digest's digest.
fn tag(digest: &Digest) -> String {
    let mut tag = Digest::of(digest.as_bytes()).to_string();
    tag.truncate(TAG_DIGITS);
    tag
}

fn mac(key: &[u8; 32], signed: &str) -> String {
    blake3::keyed_hash(key, signed.as_bytes())
        .to_hex()
        .to_string()
}

fn now() -> u64 {
    let now = SystemTime::now().duration_since(UNIX_EPOCH);
    now.map_or(0, |now| now.as_secs())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn tokens(letters: &[&str]) -> Tokens {
        let lines = letters
            .iter()
            .map(|letter| format!("operator {}\n", letter.repeat(32)));
        lines.collect::<String>().parse().unwrap()
    }

    #[test]
    fn a_changed_cookie_counts_for_nothing() {
        let tokens = tokens(&["a", "b"]);
        let sessions = Sessions::default();
        let cookie = sessions.begin("a".repeat(32).as_bytes(), &tokens).unwrap();
        assert_eq!(sessions.role(&tokens, &cookie), Some(Role::Operator));
        // Another process knows it; one that does not know the token does not.
        assert_eq!(
            Sessions::default().role(&tokens, &cookie),
            Some(Role::Operator)
        );
        assert_eq!(sessions.role(&self::tokens(&["b"]), &cookie), None);
        for index in 0..cookie.len() {
            let mut bytes = cookie.clone().into_bytes();
            bytes[index] = if bytes[index] == b'1' { b'2' } else { b'1' };
            let changed = String::from_utf8(bytes).unwrap();
            assert_eq!(sessions.role(&tokens, &changed), None, "{changed}");
        }
        // A session's end can neither be moved nor be passed.
        let parts = Parts::of(&cookie).unwrap();
        let (key, _) = key(&tokens, parts.tag).unwrap();
        let past = format!("{}.{}.{:x}", parts.tag, parts.number, now() - 1);
        let past = format!("{past}.{}", mac(&key, &past));
        assert_eq!(sessions.role(&tokens, &past), None);
    }

    #[test]
    fn no_ended_session_counts_again_however_many_are_ended() {
        let tokens = tokens(&["a", "b"]);
        let sessions = Sessions::default();
        let begin = |letter: &str| {
            let token = letter.repeat(32);
            sessions.begin(token.as_bytes(), &tokens).unwrap()
        };
        let (first, other) = (begin("a"), begin("b"));
        sessions.end(&tokens, &first);
        for _ in 0..SESSIONS_ENDED_MAX + 5 {
            sessions.end(&tokens, &begin("a"));
        }
        assert!(sessions.ended.lock().unwrap().sessions.len() <= SESSIONS_ENDED_MAX);
        assert_eq!(sessions.role(&tokens, &first), None);
        assert_eq!(sessions.role(&tokens, &other), Some(Role::Operator));
    }

    proptest! {
        #[test]
        fn no_text_is_a_cookie(text in "[0-9a-f.]{0,120}|\\PC{0,300}") {
            let sessions = Sessions::default();
            prop_assert_eq!(sessions.role(&tokens(&["a"]), &text), None);
            sessions.end(&tokens(&["a"]), &text);
            prop_assert!(sessions.ended.lock().unwrap().sessions.is_empty());
        }
    }
}
