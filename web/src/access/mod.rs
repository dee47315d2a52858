//! Who sees the pages, and who may act.
//!
//! | module | what |
//! | --- | --- |
//! | `session` | a token exchanged once for a cookie |
//! | `origin` | requests that pages of other sites make |
//! | `headers` | what browsers are told to refuse |
//!
//! Roles are those of gRPC: readers see, operators also act. Without tokens everybody who reaches the
//! address is an operator, as in gRPC.

pub mod headers;
mod origin;
mod session;

pub use origin::{check_host, check_origin};
pub use session::{COOKIE, Sessions};

use crate::problem::Problem;
use coordinator::security::{Role, Tokens};
use http::{HeaderMap, header};

/// Who a request comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Visitor {
    /// Sees.
    Reader,
    /// Sees and acts.
    Operator,
}

/// Knows who a request comes from.
pub struct Access {
    tokens: Option<Tokens>,
    sessions: Sessions,
}

impl Access {
    /// Lets in whoever has one of these tokens, or everybody where there are none.
    pub fn new(tokens: Option<Tokens>) -> Self {
        Self {
            tokens,
            sessions: Sessions::default(),
        }
    }

    /// Whether tokens are asked for.
    pub fn has_tokens(&self) -> bool {
        self.tokens.is_some()
    }

    /// Who sent a request; none where that is nobody known.
    pub fn visitor(&self, headers: &HeaderMap) -> Option<Visitor> {
        let Some(tokens) = &self.tokens else {
            return Some(Visitor::Operator);
        };
        let cookie = cookie(headers)?;
        let role = self.sessions.role(tokens, cookie)?;
        visitor(role)
    }

    /// The cookie for a token, if it is known.
    ///
    /// # Errors
    /// Says what is wrong with the token.
    pub fn sign_in(&self, token: &str) -> Result<String, Problem> {
        let Some(tokens) = &self.tokens else {
            return Err(Problem::bad("no token is needed here"));
        };
        let Some(caller) = tokens.caller(token.as_bytes()) else {
            return Err(Problem::forbidden("this token is not known"));
        };
        if visitor(caller.role).is_none() {
            return Err(Problem::forbidden(
                "a worker's token is not for these pages: sign in with a reader's or an operator's",
            ));
        }
        self.sessions.begin(token.as_bytes(), tokens)
    }

    /// Ends the session of a request.
    pub fn sign_out(&self, headers: &HeaderMap) {
        if let (Some(tokens), Some(cookie)) = (&self.tokens, cookie(headers)) {
            self.sessions.end(tokens, cookie);
        }
    }
}

fn visitor(role: Role) -> Option<Visitor> {
    match role {
        Role::Reader => Some(Visitor::Reader),
        Role::Operator => Some(Visitor::Operator),
        Role::Worker => None,
    }
}

/// The value of our cookie. With two of the name nobody is believed: one may be planted.
fn cookie(headers: &HeaderMap) -> Option<&str> {
    let cookies = headers.get_all(header::COOKIE).iter();
    let cookies = cookies.filter_map(|value| value.to_str().ok());
    let mut ours = cookies
        .flat_map(|value| value.split(';'))
        .filter_map(|pair| pair.trim().split_once('='))
        .filter(|(name, _)| *name == COOKIE)
        .map(|(_, value)| value);
    let value = ours.next()?;
    ours.next().is_none().then_some(value)
}

#[cfg(test)]
mod tests {
    use super::*;
    use http::HeaderValue;

    fn access() -> Access {
        let [worker, operator, reader] = ["w", "o", "r"].map(|letter| letter.repeat(32));
        let text = format!("worker {worker}\noperator {operator}\nreader {reader}");
        Access::new(Some(text.parse().unwrap()))
    }

    fn with(cookies: &[&str]) -> HeaderMap {
        let mut headers = HeaderMap::new();
        for cookie in cookies {
            headers.append(header::COOKIE, HeaderValue::from_str(cookie).unwrap());
        }
        headers
    }

    #[test]
    fn a_cookie_has_the_role_of_its_token() {
        let access = access();
        for (letter, role) in [("o", Visitor::Operator), ("r", Visitor::Reader)] {
            let cookie = access.sign_in(&letter.repeat(32)).unwrap();
            let pair = format!("{COOKIE}={cookie}");
            assert_eq!(access.visitor(&with(&[&pair])), Some(role));
            let among_others = format!("a=b; {pair}; c=d");
            assert_eq!(access.visitor(&with(&[&among_others])), Some(role));
            assert_eq!(access.visitor(&with(&[&pair, &pair])), None);
            assert_eq!(access.visitor(&with(&[&format!("x{pair}")])), None);
        }
        let worker = access.sign_in(&"w".repeat(32)).unwrap_err();
        assert!(worker.sentence.starts_with("a worker's token"));
        for unknown in ["", "x", &"x".repeat(32), &"x".repeat(1000)] {
            let refused = access.sign_in(unknown).unwrap_err();
            assert_eq!(refused.sentence, "this token is not known");
        }
        assert_eq!(access.visitor(&HeaderMap::new()), None);
    }

    #[test]
    fn without_tokens_everybody_is_an_operator() {
        let access = Access::new(None);
        assert_eq!(access.visitor(&HeaderMap::new()), Some(Visitor::Operator));
    }

    #[test]
    fn a_cookie_is_worth_nothing_after_its_session() {
        let access = access();
        let cookie = access.sign_in(&"o".repeat(32)).unwrap();
        let headers = with(&[&format!("{COOKIE}={cookie}")]);
        let another = access.sign_in(&"o".repeat(32)).unwrap();
        access.sign_out(&headers);
        assert_eq!(access.visitor(&headers), None);
        let headers = with(&[&format!("{COOKIE}={another}")]);
        assert_eq!(access.visitor(&headers), Some(Visitor::Operator));
    }
}
