//! Tokens and their roles.

use dataset::Digest;
use limits::{TOKEN_BYTES_MAX, TOKEN_BYTES_MIN, TOKENS_MAX};
use std::{fmt, str::FromStr};
use subtle::{Choice, ConditionallySelectable, ConstantTimeEq};
use thiserror::Error;

/// What a token is good for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Role {
    /// Leases, renders, delivers.
    Worker,
    /// Steers the farm, and sees what readers see.
    Operator,
    /// Sees how the farm is, and its images.
    Reader,
}

/// What is wrong with a file of tokens. The tokens themselves are not told.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum TokenError {
    /// A line is not `ROLE TOKEN`.
    #[error("line {0}: write a role (worker, operator or reader), a space and a token")]
    Line(usize),
    /// A token is too short to be a secret, or too long, or has characters that no header can.
    #[error(
        "line {0}: a token has {TOKEN_BYTES_MIN} to {TOKEN_BYTES_MAX} letters, digits, - and _"
    )]
    Token(usize),
    /// There are too many.
    #[error("there are more than {TOKENS_MAX} tokens")]
    TooMany,
    /// There is none.
    #[error("there is no token")]
    None,
}

/// The tokens that a coordinator knows, as digests.
#[derive(Clone)]
pub struct Tokens(Vec<(Role, Digest)>);

impl FromStr for Tokens {
    type Err = TokenError;

    /// Reads `ROLE TOKEN` lines; empty lines and those that begin with # are passed over.
    fn from_str(text: &str) -> Result<Self, TokenError> {
        let mut tokens = Vec::new();
        for (number, line) in (1..).zip(text.lines()) {
            let line = line.trim();
            if line.is_empty() || line.starts_with('#') {
                continue;
            }
            let (role, token) = line.split_once(' ').ok_or(TokenError::Line(number))?;
            let role = match role {
                "worker" => Role::Worker,
                "operator" => Role::Operator,
                "reader" => Role::Reader,
                _ => return Err(TokenError::Line(number)),
            };
            let token = token.trim();
            if !is_token(token) {
                return Err(TokenError::Token(number));
            }
            if tokens.len() == TOKENS_MAX {
                return Err(TokenError::TooMany);
            }
            tokens.push((role, Digest::of(token.as_bytes())));
        }
        if tokens.is_empty() {
            return Err(TokenError::None);
        }
        Ok(Self(tokens))
    }
}

impl Tokens {
    /// The role of a token, if it is known. Takes as long for a wrong one as for a right one:
    /// digests are compared, all of them, each without an early end.
    pub fn role(&self, token: &[u8]) -> Option<Role> {
        if token.len() > TOKEN_BYTES_MAX {
            return None;
        }
        let shown = Digest::of(token);
        let mut found = 0;
        for (number, (_, known)) in (1u32..).zip(&self.0) {
            let same: Choice = known.as_bytes().ct_eq(shown.as_bytes());
            found.conditional_assign(&number, same);
        }
        let index = found.checked_sub(1)?;
        Some(self.0[index as usize].0)
    }
}

/// Tokens are not printed.
impl fmt::Debug for Tokens {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} tokens", self.0.len())
    }
}

fn is_token(token: &str) -> bool {
    let of_a_token = |byte: u8| byte.is_ascii_alphanumeric() || byte == b'-' || byte == b'_';
    (TOKEN_BYTES_MIN..=TOKEN_BYTES_MAX).contains(&token.len()) && token.bytes().all(of_a_token)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn a_known_token_has_its_role_and_no_other_has_one() {
        let [a, b] = ["a".repeat(32), "b".repeat(256)];
        let text = format!("# the farm's\nworker {a}\n\n  reader   {b} \n");
        let tokens: Tokens = text.parse().unwrap();
        assert_eq!(tokens.role(a.as_bytes()), Some(Role::Worker));
        assert_eq!(tokens.role(b.as_bytes()), Some(Role::Reader));
        for wrong in [&a[1..], "", &"a".repeat(33), &"b".repeat(257)] {
            assert_eq!(tokens.role(wrong.as_bytes()), None);
        }
        let printed = format!("{tokens:?}");
        assert_eq!(printed, "2 tokens");
    }

    #[test]
    fn what_is_no_file_of_tokens_is_refused_with_its_line() {
        let good = "x".repeat(40);
        for (text, error) in [
            (String::new(), TokenError::None),
            ("# none".to_owned(), TokenError::None),
            (format!("worker {good}\nking {good}"), TokenError::Line(2)),
            (good.clone(), TokenError::Line(1)),
            ("worker short".to_owned(), TokenError::Token(1)),
            (format!("worker {good} {good}"), TokenError::Token(1)),
            (format!("worker {}", "x".repeat(257)), TokenError::Token(1)),
            (format!("worker {good}\n").repeat(300), TokenError::TooMany),
        ] {
            assert_eq!(text.parse::<Tokens>().unwrap_err(), error);
        }
    }

    proptest! {
        #[test]
        fn no_text_makes_it_panic(text in "(worker |reader |#|\n| |[a-z_é]{0,40}){0,20}") {
            if let Ok(tokens) = text.parse::<Tokens>() {
                prop_assert_eq!(tokens.role(text.as_bytes()), None);
            }
        }
    }
}
