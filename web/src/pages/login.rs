//! Signing in: a token is exchanged for a cookie.

use super::layout;
use crate::problem::Problem;
use axum::body::Body;
use limits::{TOKEN_BYTES_MAX, web::FORM_BYTES_MAX};
use maud::{Markup, html};
use url::form_urlencoded;

/// What the form sends.
pub struct Form {
    /// The token.
    pub token: String,
    /// The page to go on to.
    pub to: String,
}

/// The page, which leads on to `to`; with what was wrong the last time.
pub fn page(to: &str, problem: Option<&str>) -> Markup {
    layout::bare(
        "Sign in",
        html! {
            @if let Some(problem) = problem {
                p.problem role="alert" { (problem) }
            }
            form.login method="post" action="/login" {
                input type="hidden" name="to" value=(to);
                label for="token" { "Token of a reader or an operator" }
                input #token type="password" name="token" autocomplete="current-password"
                    maxlength=(TOKEN_BYTES_MAX) required autofocus;
                button type="submit" { "Sign in" }
            }
            p.note {
                code { "brdfarm credentials" } " makes tokens. The token is sent once; the browser then \
                keeps a cookie for " (limits::web::SESSION.as_secs() / 3600) " hours or until you sign \
                out."
            }
        },
    )
}

/// The address of the page, to be led on from.
pub fn address(to: &str) -> String {
    let mut query = form_urlencoded::Serializer::new(String::new());
    query.append_pair("to", to);
    format!("/login?{}", query.finish())
}

/// Where the query of an address leads on to.
pub fn target(query: &str) -> String {
    let mut pairs = form_urlencoded::parse(query.as_bytes());
    let to = pairs.find(|(key, _)| key == "to").map(|(_, to)| to);
    here(&to.unwrap_or_default())
}

/// Reads the form.
pub async fn read(body: Body) -> Result<Form, Problem> {
    let bytes = axum::body::to_bytes(body, FORM_BYTES_MAX).await;
    let bytes = bytes.map_err(|_| {
        Problem::bad(format!(
            "the form is larger than {FORM_BYTES_MAX} bytes, or broke off"
        ))
    })?;
    let (mut token, mut to) = (String::new(), String::new());
    for (key, value) in form_urlencoded::parse(&bytes) {
        match &*key {
            "token" => token = value.trim().to_owned(),
            "to" => to = value.into_owned(),
            _ => {}
        }
    }
    Ok(Form {
        token,
        to: here(&to),
    })
}

/// A page of this server, or its first: whoever sends a link decides where signing in leads.
fn here(to: &str) -> String {
    let mut bytes = to.bytes();
    let is_here = bytes.next() == Some(b'/') && !matches!(bytes.next(), Some(b'/' | b'\\'));
    if is_here && to.bytes().all(|byte| byte.is_ascii_graphic()) {
        to.to_owned()
    } else {
        "/".to_owned()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn signing_in_leads_to_no_other_site() {
        for to in [
            "/",
            "/materials?roughness_max=3&where=ior+%3E+2",
            "/materials/7?view=2",
        ] {
            let address = address(to);
            let query = address.split_once('?').unwrap().1;
            assert_eq!(target(query), to);
        }
        for to in [
            "https://evil.example/",
            "//evil.example/",
            "/\\evil.example/",
            "javascript:alert(1)",
            "/\t/evil.example",
            "/\r\nSet-Cookie: a=b",
            "",
        ] {
            assert_eq!(here(to), "/", "{to:?}");
        }
    }
}
