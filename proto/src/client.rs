//! Connecting to a coordinator, with the deadlines, limits and credentials of every client.

use crate::{ControlClient, FarmClient, HealthClient};
use limits::protocol;
use std::{fmt, net::IpAddr, time::Duration};
use tonic::{
    Request, Status,
    metadata::{Ascii, MetadataValue},
    service::{Interceptor, interceptor::InterceptedService},
    transport::{Certificate, ClientTlsConfig, Endpoint, Identity},
};

/// A connection that shows a client's token with every call.
pub type Channel = InterceptedService<tonic::transport::Channel, Bearer>;

/// What a client has to show, and whom it believes. Without anything it can speak to a coordinator
/// on its own machine, or to an insecure one.
#[derive(Clone, Default)]
pub struct Credentials {
    /// The token of the client's role.
    pub token: Option<String>,
    /// Certificates, PEM, of the authorities whose word about the coordinator counts.
    pub authority: Option<Vec<u8>>,
    /// The client's certificate and key, PEM, where the coordinator asks for one.
    pub identity: Option<(Vec<u8>, Vec<u8>)>,
}

/// Puts the token on calls.
#[derive(Clone)]
pub struct Bearer(Option<MetadataValue<Ascii>>);

/// Secrets are not printed.
impl fmt::Debug for Credentials {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Credentials")
            .field("token", &self.token.as_ref().map(|_| ".."))
            .field("authority", &self.authority.is_some())
            .field("identity", &self.identity.as_ref().map(|_| ".."))
            .finish()
    }
}

impl Interceptor for Bearer {
    fn call(&mut self, mut request: Request<()>) -> Result<Request<()>, Status> {
        if let Some(token) = &self.0 {
            let metadata = request.metadata_mut();
            metadata.insert("authorization", token.clone());
        }
        Ok(request)
    }
}

/// A worker's client for the coordinator at `url`, such as `http://127.0.0.1:7117`. Connects at
/// the first call, and again whenever the connection is lost; nothing here waits for the network.
///
/// # Errors
/// The sentence that says what is wrong with the URL or the credentials.
pub fn farm(url: &str, credentials: &Credentials) -> Result<FarmClient, String> {
    Ok(FarmClient::new(channel(url, credentials)?)
        .max_decoding_message_size(protocol::MESSAGE_BYTES_MAX)
        .max_encoding_message_size(protocol::MESSAGE_BYTES_MAX))
}

/// A person's client; otherwise as [`farm`].
///
/// # Errors
/// The sentence that says what is wrong with the URL or the credentials.
pub fn control(url: &str, credentials: &Credentials) -> Result<ControlClient, String> {
    Ok(ControlClient::new(channel(url, credentials)?)
        .max_decoding_message_size(protocol::MESSAGE_BYTES_MAX)
        .max_encoding_message_size(protocol::CONTROL_MESSAGE_BYTES_MAX))
}

/// A client of the standard health service, which asks for no token; otherwise as [`farm`].
///
/// # Errors
/// The sentence that says what is wrong with the URL or the credentials.
pub fn health(url: &str, credentials: &Credentials) -> Result<HealthClient, String> {
    Ok(HealthClient::new(channel(url, credentials)?))
}

fn channel(url: &str, credentials: &Credentials) -> Result<Channel, String> {
    let wrong = || format!("{url:?} is no URL of a coordinator: write http(s)://HOST:PORT");
    let endpoint = Endpoint::from_shared(url.to_owned()).map_err(|_| wrong())?;
    let uri = endpoint.uri().clone();
    let bare = matches!(uri.path(), "" | "/") && uri.query().is_none();
    let place = uri
        .authority()
        .filter(|place| !place.as_str().contains('@'));
    let (true, Some(place)) = (bare, place) else {
        return Err(wrong());
    };
    let mut endpoint = endpoint
        .connect_timeout(protocol::CONNECT_DEADLINE)
        .http2_keep_alive_interval(protocol::KEEPALIVE_INTERVAL)
        .keep_alive_timeout(protocol::KEEPALIVE_TIMEOUT)
        .keep_alive_while_idle(true)
        .tcp_nodelay(true);
    match uri.scheme_str() {
        Some("http") if credentials.token.is_some() && !is_loopback(place.host()) => {
            return Err(format!(
                "a token would cross the network in the clear to {url}: write https://"
            ));
        }
        Some("http") if credentials.authority.is_some() || credentials.identity.is_some() => {
            return Err(format!(
                "certificates are given, and {url} speaks no TLS: write https://"
            ));
        }
        Some("http") => {}
        Some("https") => {
            let tls = tls(credentials, url)?;
            endpoint = endpoint
                .tls_config(tls)
                .map_err(|error| format!("the certificates for {url} cannot be used: {error}"))?;
        }
        _ => return Err(wrong()),
    }
    let token = credentials.token.as_ref().map(|token| {
        let mut value: MetadataValue<Ascii> = format!("Bearer {token}")
            .parse()
            .map_err(|_| "the token has characters that no token has".to_owned())?;
        value.set_sensitive(true);
        Ok::<_, String>(value)
    });
    let bearer = Bearer(token.transpose()?);
    Ok(InterceptedService::new(endpoint.connect_lazy(), bearer))
}

fn tls(credentials: &Credentials, url: &str) -> Result<ClientTlsConfig, String> {
    let Some(authority) = &credentials.authority else {
        return Err(format!(
            "{url} needs the certificate of the authority that vouches for it: pass --credentials with its authority.pem"
        ));
    };
    let mut tls = ClientTlsConfig::new().ca_certificate(Certificate::from_pem(authority));
    if let Some((certificate, key)) = &credentials.identity {
        tls = tls.identity(Identity::from_pem(certificate, key));
    }
    Ok(tls)
}

fn is_loopback(host: &str) -> bool {
    let bare = host.trim_start_matches('[').trim_end_matches(']');
    host == "localhost" || bare.parse().is_ok_and(|ip: IpAddr| ip.is_loopback())
}

/// `message` as a request that both sides give up after [`protocol::CALL_DEADLINE`].
pub fn with_deadline<M>(message: M) -> Request<M> {
    with_deadline_after(message, Duration::ZERO)
}

/// The same for a call that asks to wait: the deadline comes that much later.
pub fn with_deadline_after<M>(message: M, wait: Duration) -> Request<M> {
    let mut request = Request::new(message);
    request.set_timeout(protocol::CALL_DEADLINE + wait);
    request
}

#[cfg(test)]
mod tests {
    use super::*;

    fn with_token() -> Credentials {
        Credentials {
            token: Some("secret".to_owned()),
            ..Credentials::default()
        }
    }

    #[tokio::test]
    async fn urls_that_name_no_coordinator_are_refused() {
        let none = Credentials::default();
        assert!(farm("http://127.0.0.1:7117", &none).is_ok());
        for url in [
            "",
            "127.0.0.1:7117",
            "ftp://host:1",
            "http://",
            "http://host:1/path",
            "http://user@host:1",
            "nonsense url",
        ] {
            let message = farm(url, &none).unwrap_err();
            assert!(message.contains("http(s)://HOST:PORT"), "{url}: {message}");
        }
    }

    #[tokio::test]
    async fn a_token_does_not_cross_the_network_in_the_clear() {
        for url in ["http://127.0.0.1:1", "http://[::1]:1", "http://localhost:1"] {
            assert!(farm(url, &with_token()).is_ok(), "{url}");
        }
        let message = farm("http://192.0.2.1:1", &with_token()).unwrap_err();
        assert!(message.contains("in the clear"), "{message}");
        let message = farm("https://192.0.2.1:1", &with_token()).unwrap_err();
        assert!(message.contains("authority.pem"), "{message}");
    }

    #[test]
    fn credentials_print_without_their_secrets() {
        let printed = format!("{:?}", with_token());
        assert!(!printed.contains("secret"), "{printed}");
    }
}
