//! Connections, and TLS over them.

use crate::{
    access::Access,
    pages::farm::fragments,
    router::{self, App},
    sending::Sending,
    site::Site,
};
use axum::Router;
use coordinator::security::{
    Security, Tls,
    admission::{self, Connection, Peer},
};
use datastore::StoreName;
use futures_util::FutureExt;
use http::Request;
use hyper::{body::Incoming, server::conn::http1, service::service_fn};
use hyper_util::rt::{TokioIo, TokioTimer};
use limits::{
    SILENCE_MAX, STOP_GRACE,
    web::{
        CATALOGUE_PAUSE, CATALOGUE_PAUSE_DATABASE, CATALOGUE_PAUSE_TIMES, CONNECTION_SPAN,
        HEAD_DEADLINE,
    },
};
use std::{io, net::SocketAddr, panic::AssertUnwindSafe, sync::Arc, time::Instant};
use thiserror::Error;
use tokio::{
    io::{AsyncRead, AsyncWrite},
    sync::watch,
    task::{JoinSet, spawn_blocking},
    time::{sleep, timeout},
};
use tokio_rustls::{
    TlsAcceptor,
    rustls::{
        self, ServerConfig,
        pki_types::{CertificateDer, PrivateKeyDer, pem::PemObject},
    },
};
use tokio_stream::{StreamExt, wrappers::ReceiverStream};
use tower::ServiceExt;

/// Where and how pages are served.
#[derive(Clone, Debug)]
pub struct Options {
    /// The address to listen on; port 0 takes a free one.
    pub listen: SocketAddr,
    /// The certificate that pages are served under, and the tokens that let somebody in. No client's
    /// certificate is asked for: browsers have none.
    pub security: Security,
    /// Whether an address that other machines reach may be served without them.
    pub insecure: bool,
}

impl Options {
    /// Whether pages may be served so; asked before a store is read.
    ///
    /// # Errors
    /// When the address is exposed without consent.
    pub fn check(&self) -> Result<(), ServeError> {
        if self.listen.ip().is_loopback() || self.security.is_closed() || self.insecure {
            Ok(())
        } else {
            Err(ServeError::Exposed(self.listen))
        }
    }
}

/// Why pages are not served.
#[derive(Debug, Error)]
pub enum ServeError {
    /// The address is for others to reach, and nothing protects it.
    #[error(
        "pages at {0} can be reached from other machines, and nothing protects them: pass \
         --credentials, which `brdfarm credentials` makes, or listen on a loopback address, or pass \
         --insecure where the network itself is trusted"
    )]
    Exposed(SocketAddr),
    /// The address cannot be listened on.
    #[error("cannot listen on {address}: {source}")]
    Listen {
        /// The address.
        address: SocketAddr,
        /// What the system said.
        source: io::Error,
    },
    /// The certificate or its key cannot be used.
    #[error("the certificate or its key cannot be used: {0}")]
    Certificate(String),
}

/// Pages being served. Dropping it ends them at once.
pub struct RunningServer {
    address: SocketAddr,
    scheme: &'static str,
    stop: watch::Sender<bool>,
    failure: watch::Sender<Option<String>>,
    tasks: JoinSet<()>,
}

impl RunningServer {
    /// The first page.
    pub fn url(&self) -> String {
        format!("{}://{}/", self.scheme, self.address)
    }

    /// Waits until a part of it stops working, which takes a fault; says which and why.
    pub async fn failed(&self) -> String {
        let mut failure = self.failure.subscribe();
        let failed = failure.wait_for(Option::is_some).await;
        failed.map_or_else(|_| String::new(), |why| why.clone().unwrap_or_default())
    }

    /// Takes no more requests, and lets those under way end.
    pub async fn shutdown(mut self) {
        self.stop.send_replace(true);
        let ended = async { while self.tasks.join_next().await.is_some() {} };
        if timeout(STOP_GRACE, ended).await.is_err() {
            tracing::warn!("pages under way were cut off");
        }
    }
}

/// Serves the pages of a site. Has to be called inside a runtime.
///
/// # Errors
/// When the address is exposed without consent or cannot be listened on, or the certificate cannot be
/// used.
pub async fn serve(site: Site, options: Options) -> Result<RunningServer, ServeError> {
    options.check()?;
    let Options {
        listen, security, ..
    } = options;
    let tls = security.tls.as_ref().map(acceptor).transpose()?;
    let unable = |source| ServeError::Listen {
        address: listen,
        source,
    };
    let listener = admission::listen(listen).map_err(unable)?;
    let address = listener.local_addr().map_err(unable)?;
    let (stop, stopping) = watch::channel(false);
    let app = Arc::new(App {
        site,
        access: Access::new(security.tokens),
        is_encrypted: tls.is_some(),
        sending: Sending::default(),
        stopping: stopping.clone(),
    });
    let failure = watch::channel(None).0;
    let mut tasks = JoinSet::new();
    let fresh = keep_fresh(Arc::clone(&app), stopping.clone());
    tasks.spawn(watched("catalogue", fresh, failure.clone()));
    let live = follow_farm(Arc::clone(&app), stopping.clone());
    tasks.spawn(watched("live", live, failure.clone()));
    let scheme = if tls.is_some() { "https" } else { "http" };
    let connections = admission::open(listener, false);
    let accepting = accept(connections, tls, router::router(app), stopping);
    tasks.spawn(watched("connections", accepting, failure.clone()));
    tracing::info!(%address, "pages are served");
    Ok(RunningServer {
        address,
        scheme,
        stop,
        failure,
        tasks,
    })
}

/// Runs a task, and tells if it panics.
async fn watched(
    name: &'static str,
    task: impl Future<Output = ()>,
    failure: watch::Sender<Option<String>>,
) {
    if AssertUnwindSafe(task).catch_unwind().await.is_err() {
        let why = format!("the pages cannot go on: {name}: it panicked");
        tracing::error!("{why}");
        failure.send_replace(Some(why));
    }
}

fn acceptor(tls: &Tls) -> Result<TlsAcceptor, ServeError> {
    let unusable = |error: &dyn std::fmt::Display| ServeError::Certificate(error.to_string());
    let certificates = CertificateDer::pem_slice_iter(&tls.certificate)
        .collect::<Result<Vec<_>, _>>()
        .map_err(|error| unusable(&error))?;
    let key = PrivateKeyDer::from_pem_slice(&tls.key).map_err(|error| unusable(&error))?;
    let provider = Arc::new(rustls::crypto::ring::default_provider());
    let config = ServerConfig::builder_with_provider(provider)
        .with_safe_default_protocol_versions()
        .map_err(|error| unusable(&error))?
        .with_no_client_auth()
        .with_single_cert(certificates, key);
    let mut config = config.map_err(|error| unusable(&error))?;
    config.alpn_protocols = vec![b"http/1.1".to_vec()];
    Ok(TlsAcceptor::from(Arc::new(config)))
}

async fn accept(
    mut connections: ReceiverStream<Result<Connection, io::Error>>,
    tls: Option<TlsAcceptor>,
    router: Router,
    mut stopping: watch::Receiver<bool>,
) {
    let mut visits = JoinSet::new();
    loop {
        let connection = tokio::select! {
            connection = connections.next() => connection,
            Some(_) = visits.join_next() => continue,
            () = asked_to_stop(&mut stopping) => break,
        };
        let Some(Ok(connection)) = connection else {
            break;
        };
        let (tls, router, stopping) = (tls.clone(), router.clone(), stopping.clone());
        let peer = Some(connection.peer());
        visits.spawn(async move {
            match tls {
                None => converse(connection, peer, router, stopping).await,
                Some(tls) => {
                    // Whoever is too slow, or speaks no TLS, is put out without a word.
                    if let Ok(Ok(stream)) = timeout(SILENCE_MAX, tls.accept(connection)).await {
                        converse(stream, peer, router, stopping).await;
                    }
                }
            }
        });
    }
    drop(connections);
    while visits.join_next().await.is_some() {}
}

/// Answers one connection's requests until it ends, its time is over, or the server is asked to stop.
async fn converse(
    stream: impl AsyncRead + AsyncWrite + Unpin,
    peer: Option<Peer>,
    router: Router,
    mut stopping: watch::Receiver<bool>,
) {
    let service = service_fn(move |mut request: Request<Incoming>| {
        if let Some(peer) = peer.clone() {
            request.extensions_mut().insert(peer);
        }
        router.clone().oneshot(request)
    });
    let connection = http1::Builder::new()
        .timer(TokioTimer::new())
        .header_read_timeout(HEAD_DEADLINE)
        .max_buf_size(limits::HEADER_BYTES_MAX as usize)
        .serve_connection(TokioIo::new(stream), service);
    let mut connection = std::pin::pin!(connection);
    let ended = tokio::select! {
        ended = connection.as_mut() => Some(ended),
        () = asked_to_stop(&mut stopping) => None,
        // Nothing asks an answer that nobody reads to end: it goes with its connection.
        () = sleep(CONNECTION_SPAN) => return,
    };
    let ended = match ended {
        Some(ended) => ended,
        None => {
            connection.as_mut().graceful_shutdown();
            connection.await
        }
    };
    if let Err(error) = ended {
        tracing::debug!(%error, "a browser's connection broke off");
    }
}

/// Ends when the server is asked to stop, or dropped.
async fn asked_to_stop(stopping: &mut watch::Receiver<bool>) {
    drop(stopping.wait_for(|stopping| *stopping).await);
}

/// Renders what the farm's page shows for everybody who looks.
async fn follow_farm(app: Arc<App>, stopping: watch::Receiver<bool>) {
    if let Some(farm) = &app.site.farm {
        let render = |seen: &_, visitor| fragments(&app.site, seen, visitor);
        farm.follow(render, stopping).await;
    }
}

/// Looks for materials that were completed since, as long as pages are served.
async fn keep_fresh(app: Arc<App>, mut stopping: watch::Receiver<bool>) {
    let least = match app.site.store {
        StoreName::Folder(_) => CATALOGUE_PAUSE,
        StoreName::Database(_) => CATALOGUE_PAUSE_DATABASE,
    };
    let mut pause = least;
    loop {
        tokio::select! {
            () = sleep(pause) => {}
            () = asked_to_stop(&mut stopping) => return,
        }
        let looking = Arc::clone(&app);
        let began = Instant::now();
        let looked = spawn_blocking(move || looking.site.catalogue.refresh()).await;
        match looked {
            Ok(Ok(_)) => {}
            Ok(Err(error)) => tracing::warn!(%error, "the pages do not show what is new"),
            Err(error) => tracing::error!(%error, "looking for what is new was interrupted"),
        }
        pause = least.max(began.elapsed() * CATALOGUE_PAUSE_TIMES);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sending::Sending;
    use axum::routing::get;
    use limits::web::SENDING_BYTES_MAX;
    use tokio::io::{AsyncWriteExt, duplex};

    /// A reader asks for all that may be under way, and reads none of it: others get their answers
    /// when its connection's time is over.
    #[tokio::test(start_paused = true)]
    async fn an_answer_that_nobody_reads_ends_with_its_connection() {
        let sending = Arc::new(Sending::default());
        let under_way = Arc::clone(&sending);
        let answer = move || async move { under_way.body(vec![0; SENDING_BYTES_MAX]) };
        let router = Router::new().route("/", get(answer));
        let (mut reader, stream) = duplex(1024);
        let (_stop, stopping) = watch::channel(false);
        let connection = tokio::spawn(converse(stream, None, router, stopping));
        let request = b"GET / HTTP/1.1\r\nHost: localhost\r\n\r\n";
        reader.write_all(request).await.unwrap();
        sleep(CONNECTION_SPAN / 2).await;
        assert!(sending.body(vec![0]).is_err());
        connection.await.unwrap();
        assert!(sending.body(vec![0]).is_ok());
        drop(reader);
    }
}
