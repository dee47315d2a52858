//! Requests that pages of other sites make in the browser of somebody who is let in here.

use crate::problem::Problem;
use http::{HeaderMap, Uri, header, uri::Authority};
use std::net::IpAddr;

/// Refuses a request that changes something unless its page came from here: its Origin has to be the
/// host that it was sent to. Browsers always send one with a POST.
///
/// # Errors
/// Says that the origin is another, or none.
pub fn check_origin(headers: &HeaderMap) -> Result<(), Problem> {
    let refused = || {
        Problem::forbidden(
            "this was not sent by a page of this server: open the page here and try again",
        )
    };
    let host = host(headers).ok_or_else(refused)?;
    let mut origins = headers.get_all(header::ORIGIN).iter();
    let origin = origins.next().and_then(|origin| origin.to_str().ok());
    let origin: Uri = origin
        .and_then(|origin| origin.parse().ok())
        .ok_or_else(refused)?;
    let is_ours = matches!(origin.scheme_str(), Some("http" | "https"))
        && origin
            .authority()
            .is_some_and(|authority| authority.as_str().eq_ignore_ascii_case(host.as_str()));
    if is_ours && origins.next().is_none() {
        Ok(())
    } else {
        Err(refused())
    }
}

/// Where no token protects the pages, refuses names that somebody on the internet can own: a page of
/// theirs could have its name point to this machine, and read as if it were ours. An address, a name
/// without a dot and `localhost` nobody can own.
///
/// # Errors
/// Says which names are taken.
pub fn check_host(headers: &HeaderMap) -> Result<(), Problem> {
    let host = host(headers);
    let is_ours = host.as_ref().is_some_and(|host| {
        let name = host.host();
        let bare = name
            .strip_prefix('[')
            .and_then(|name| name.strip_suffix(']'));
        bare.unwrap_or(name).parse::<IpAddr>().is_ok() || !name.contains('.')
    });
    if is_ours {
        Ok(())
    } else {
        Err(Problem::forbidden(
            "without credentials these pages answer only to an address or a name without a dot, such \
             as localhost",
        ))
    }
}

fn host(headers: &HeaderMap) -> Option<Authority> {
    let mut hosts = headers.get_all(header::HOST).iter();
    let host = hosts.next()?.to_str().ok()?.parse().ok()?;
    hosts.next().is_none().then_some(host)
}

#[cfg(test)]
mod tests {
    use super::*;
    use http::HeaderValue;

    fn headers(host: &str, origins: &[&str]) -> HeaderMap {
        let mut headers = HeaderMap::new();
        headers.insert(header::HOST, HeaderValue::from_str(host).unwrap());
        for origin in origins {
            headers.append(header::ORIGIN, HeaderValue::from_str(origin).unwrap());
        }
        headers
    }

    #[test]
    fn only_pages_of_this_host_change_anything() {
        let host = "farm.example:7118";
        for ours in ["https://farm.example:7118", "http://FARM.example:7118"] {
            assert_eq!(check_origin(&headers(host, &[ours])), Ok(()));
        }
        for others in [
            &["https://evil.example"][..],
            &["https://farm.example"],
            &["https://farm.example:7118.evil.example"],
            &["https://farm.example:7118@evil.example"],
            &["null"],
            &[""],
            &["file://farm.example:7118"],
            &[],
            &["https://farm.example:7118", "https://evil.example"],
        ] {
            assert!(check_origin(&headers(host, others)).is_err(), "{others:?}");
        }
        assert!(check_origin(&HeaderMap::new()).is_err());
    }

    #[test]
    fn a_name_that_somebody_can_own_is_refused_where_no_token_is_asked_for() {
        for ours in [
            "localhost:7118",
            "127.0.0.1:80",
            "[::1]:7118",
            "node7:1",
            "10.0.0.3",
        ] {
            assert_eq!(check_host(&headers(ours, &[])), Ok(()), "{ours}");
        }
        for others in [
            "evil.example:7118",
            "127.0.0.1.evil.example",
            "a.b",
            "localhost.",
            "",
        ] {
            assert!(check_host(&headers(others, &[])).is_err(), "{others}");
        }
    }
}
