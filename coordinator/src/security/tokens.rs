//! Tokens: the role of each, and the name of the credential that it is.

use dataset::Digest;
use jobqueue::identity::{OPERATOR, is_credential_name};
use limits::{TOKEN_BYTES_MAX, TOKEN_BYTES_MIN, TOKENS_MAX};
use std::{collections::BTreeSet, fmt, str::FromStr, sync::Arc};
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
    /// A line is not `ROLE TOKEN` or `ROLE TOKEN NAME`.
    #[error(
        "line {0}: write a role (worker, operator or reader), a space, a token, and for a worker's a \
         space and a name if you like"
    )]
    Line(usize),
    /// A name is none that a credential can have.
    #[error(
        "line {0}: a credential's name has 1 to 64 letters, digits, dots, hyphens and underscores, and \
         is not \"operator\""
    )]
    Name(usize),
    /// Two credentials have one name: who did what could not be told.
    #[error("line {0}: another credential has this name")]
    NameTwice(usize),
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

/// Who a token lets in.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Caller {
    /// What it may do.
    pub role: Role,
    /// The name of its credential: whoever has the token answers for all that is done with it.
    pub credential: Arc<str>,
}

/// The tokens that a coordinator knows, as digests.
#[derive(Clone)]
pub struct Tokens(Vec<(Caller, Digest)>);

impl FromStr for Tokens {
    type Err = TokenError;

    /// Reads `ROLE TOKEN NAME` lines; empty lines and those that begin with # are passed over. A
    /// worker's token without a name is called after the begin of its digest.
    fn from_str(text: &str) -> Result<Self, TokenError> {
        let mut tokens: Vec<(Caller, Digest)> = Vec::new();
        for (number, line) in (1..).zip(text.lines()) {
            let line = line.trim();
            if line.is_empty() || line.starts_with('#') {
                continue;
            }
            let read = read_line(line, number)?;
            if tokens.len() == TOKENS_MAX {
                return Err(TokenError::TooMany);
            }
            let twice = |(caller, digest): &(Caller, Digest)| {
                let workers = caller.role == Role::Worker && read.0.role == Role::Worker;
                workers && caller.credential == read.0.credential && *digest != read.1
            };
            if tokens.iter().any(twice) {
                return Err(TokenError::NameTwice(number));
            }
            tokens.push(read);
        }
        if tokens.is_empty() {
            return Err(TokenError::None);
        }
        Ok(Self(tokens))
    }
}

fn read_line(line: &str, number: usize) -> Result<(Caller, Digest), TokenError> {
    let mut words = line.split_ascii_whitespace();
    let (Some(role), Some(token)) = (words.next(), words.next()) else {
        return Err(TokenError::Line(number));
    };
    let (name, more) = (words.next(), words.next());
    let role = match role {
        "worker" => Role::Worker,
        "operator" => Role::Operator,
        "reader" => Role::Reader,
        _ => return Err(TokenError::Line(number)),
    };
    if more.is_some() || (name.is_some() && role != Role::Worker) {
        return Err(TokenError::Line(number));
    }
    if !is_token(token) {
        return Err(TokenError::Token(number));
    }
    let digest = Digest::of(token.as_bytes());
    let credential = match (role, name) {
        (Role::Operator, _) => OPERATOR.into(),
        (Role::Reader, _) => "reader".into(),
        (Role::Worker, Some(name)) if is_credential_name(name) && name != OPERATOR => name.into(),
        (Role::Worker, Some(_)) => return Err(TokenError::Name(number)),
        // Of a token that nobody can guess, some digits of its digest tell nothing.
        (Role::Worker, None) => format!("worker-{:.8}", digest.to_string()).into(),
    };
    Ok((Caller { role, credential }, digest))
}

impl Tokens {
    /// Who a token lets in, if it is known. Takes as long for a wrong one as for a right one:
    /// digests are compared, all of them, each without an early end.
    pub fn caller(&self, token: &[u8]) -> Option<&Caller> {
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
        Some(&self.0[index as usize].0)
    }

    /// The role and the digest of each token.
    pub fn digests(&self) -> impl Iterator<Item = (Role, &Digest)> {
        self.0.iter().map(|(caller, digest)| (caller.role, digest))
    }

    /// How many workers' credentials there are.
    pub fn worker_credentials(&self) -> usize {
        let callers = self.0.iter().map(|(caller, _)| caller);
        let workers = callers.filter(|caller| caller.role == Role::Worker);
        let names: BTreeSet<&str> = workers.map(|caller| &*caller.credential).collect();
        names.len()
    }

    /// Whether a worker's credential has this name.
    pub fn knows_worker(&self, name: &str) -> bool {
        let mut callers = self.0.iter().map(|(caller, _)| caller);
        callers.any(|caller| caller.role == Role::Worker && *caller.credential == *name)
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

    fn role(tokens: &Tokens, token: &[u8]) -> Option<Role> {
        tokens.caller(token).map(|caller| caller.role)
    }

    #[test]
    fn a_worker_is_called_by_its_credential() {
        let [a, b, c] = ["a", "b", "c"].map(|letter| letter.repeat(32));
        let text = format!("worker {a} alice\nworker {b}\noperator {c}");
        let tokens: Tokens = text.parse().unwrap();
        let name = |token: &str| tokens.caller(token.as_bytes()).unwrap().credential.clone();
        assert_eq!(&*name(&a), "alice");
        let digest = Digest::of(b.as_bytes()).to_string();
        assert_eq!(*name(&b), format!("worker-{}", &digest[..8]));
        assert_eq!(&*name(&c), OPERATOR);
        assert!(tokens.knows_worker("alice") && !tokens.knows_worker(OPERATOR));
        // No name lets a worker speak for another.
        for (text, error) in [
            (format!("worker {a} operator"), TokenError::Name(1)),
            (format!("worker {a} a/b"), TokenError::Name(1)),
            (
                format!("worker {a} x\nworker {b} x"),
                TokenError::NameTwice(2),
            ),
            (format!("reader {a} alice"), TokenError::Line(1)),
        ] {
            assert_eq!(text.parse::<Tokens>().unwrap_err(), error);
        }
    }

    #[test]
    fn a_known_token_has_its_role_and_no_other_has_one() {
        let [a, b] = ["a".repeat(32), "b".repeat(256)];
        let text = format!("# the farm's\nworker {a}\n\n  reader   {b} \n");
        let tokens: Tokens = text.parse().unwrap();
        assert_eq!(role(&tokens, a.as_bytes()), Some(Role::Worker));
        assert_eq!(role(&tokens, b.as_bytes()), Some(Role::Reader));
        for wrong in [&a[1..], "", &"a".repeat(33), &"b".repeat(257)] {
            assert_eq!(role(&tokens, wrong.as_bytes()), None);
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
            (format!("worker {good} {good} {good}"), TokenError::Line(1)),
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
                prop_assert_eq!(tokens.caller(text.as_bytes()), None);
            }
        }
    }
}
