//! Connecting to a coordinator, with the deadlines and limits that every client keeps.

use crate::{FarmClient, limits};
use std::time::Duration;
use tonic::{Request, transport::Endpoint};

/// A client for the coordinator at `url`, such as `http://127.0.0.1:7117`. Connects at the first
/// call, and again whenever the connection is lost; nothing here waits for the network.
///
/// # Errors
/// The sentence that says what is wrong with the URL.
pub fn connect_lazily(url: &str) -> Result<FarmClient, String> {
    let wrong = || format!("{url:?} is no URL of a coordinator: write http://HOST:PORT");
    let endpoint = Endpoint::from_shared(url.to_owned()).map_err(|_| wrong())?;
    let uri = endpoint.uri();
    let bare = matches!(uri.path(), "" | "/") && uri.query().is_none();
    let anonymous = uri
        .authority()
        .is_some_and(|place| !place.as_str().contains('@'));
    if uri.scheme_str() != Some("http") || !bare || !anonymous {
        return Err(wrong());
    }
    let channel = endpoint
        .connect_timeout(limits::CONNECT_DEADLINE)
        .http2_keep_alive_interval(limits::KEEPALIVE_INTERVAL)
        .keep_alive_timeout(limits::KEEPALIVE_TIMEOUT)
        .keep_alive_while_idle(true)
        .tcp_nodelay(true)
        .connect_lazy();
    Ok(FarmClient::new(channel)
        .max_decoding_message_size(limits::MESSAGE_BYTES_MAX)
        .max_encoding_message_size(limits::MESSAGE_BYTES_MAX))
}

/// `message` as a request that both sides give up after [`limits::CALL_DEADLINE`].
pub fn with_deadline<M>(message: M) -> Request<M> {
    with_deadline_after(message, Duration::ZERO)
}

/// The same for a call that asks to wait: the deadline comes that much later.
pub fn with_deadline_after<M>(message: M, wait: Duration) -> Request<M> {
    let mut request = Request::new(message);
    request.set_timeout(limits::CALL_DEADLINE + wait);
    request
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn urls_that_name_no_coordinator_are_refused() {
        assert!(connect_lazily("http://127.0.0.1:7117").is_ok());
        for url in [
            "",
            "127.0.0.1:7117",
            "ftp://host:1",
            "http://",
            "http://host:1/path",
            "http://user@host:1",
            "nonsense url",
        ] {
            let message = connect_lazily(url).unwrap_err();
            assert!(message.contains("http://HOST:PORT"), "{url}: {message}");
        }
    }
}
