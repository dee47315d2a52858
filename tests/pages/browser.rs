//! A client of pages: HTTP/1.1 over plain or encrypted connections, with a cookie.

use rustls::pki_types::{CertificateDer, ServerName, pem::PemObject};
use rustls::{ClientConfig, ClientConnection, RootCertStore, StreamOwned};
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

const PATIENCE: Duration = Duration::from_secs(60);

/// What a browser keeps of a server.
pub struct Browser {
    authority: String,
    scheme: String,
    trusted: Option<Arc<ClientConfig>>,
    pub cookie: Option<String>,
}

/// An answer.
pub struct Answer {
    pub status: u16,
    pub headers: Vec<(String, String)>,
    pub body: Vec<u8>,
}

trait Stream: Read + Write {}
impl<T: Read + Write> Stream for T {}

impl Browser {
    /// At the first page of a server, such as `http://127.0.0.1:7118/`.
    pub fn new(url: &str) -> Self {
        let (scheme, rest) = url.split_once("://").expect("a URL");
        Self {
            authority: rest.trim_end_matches('/').to_owned(),
            scheme: scheme.to_owned(),
            trusted: None,
            cookie: None,
        }
    }

    /// Trusts the authority of a folder of credentials.
    pub fn trusting(mut self, credentials: &Path) -> Self {
        let authority = CertificateDer::from_pem_file(credentials.join("authority.pem"));
        let mut roots = RootCertStore::empty();
        roots
            .add(authority.expect("a certificate"))
            .expect("a root");
        let provider = Arc::new(rustls::crypto::ring::default_provider());
        let config = ClientConfig::builder_with_provider(provider)
            .with_safe_default_protocol_versions()
            .expect("versions")
            .with_root_certificates(roots)
            .with_no_client_auth();
        self.trusted = Some(Arc::new(config));
        self
    }

    pub fn origin(&self) -> String {
        format!("{}://{}", self.scheme, self.authority)
    }

    pub fn authority(&self) -> &str {
        &self.authority
    }

    pub fn get(&self, path: &str) -> Answer {
        self.get_with(path, &[("Accept", "text/html")])
    }

    pub fn get_with(&self, path: &str, headers: &[(&str, &str)]) -> Answer {
        self.ask("GET", path, headers, "")
    }

    /// Sends a form as a page of the server does.
    pub fn post(&self, path: &str, form: &str) -> Answer {
        let origin = self.origin();
        self.ask("POST", path, &[("Origin", &origin)], form)
    }

    pub fn ask(&self, method: &str, path: &str, headers: &[(&str, &str)], body: &str) -> Answer {
        let mut stream = self.open(method, path, headers, body);
        let (status, headers) = head(&mut stream);
        let length = headers.iter().find(|(name, _)| name == "content-length");
        let mut answer = Vec::new();
        match length {
            Some((_, length)) => {
                answer.resize(length.parse().expect("a length"), 0);
                stream.read_exact(&mut answer).expect("a body");
            }
            // Without one the connection's end is the body's.
            None => drop(stream.read_to_end(&mut answer)),
        }
        Answer {
            status,
            headers,
            body: answer,
        }
    }

    /// Reads what the server tells as it happens, until `until` is satisfied by all of it.
    pub fn listen(&self, path: &str, until: impl Fn(&str) -> bool) -> String {
        let mut stream = self.open("GET", path, &[("Accept", "text/event-stream")], "");
        let (status, _) = head(&mut stream);
        assert_eq!(status, 200, "{path}");
        let mut told = String::new();
        while !until(&told) {
            let mut line = String::new();
            let read = stream.read_line(&mut line).expect("a line in time");
            assert!(read > 0, "the stream ended: {told}");
            told.push_str(&line);
        }
        told
    }

    fn open(
        &self,
        method: &str,
        path: &str,
        headers: &[(&str, &str)],
        body: &str,
    ) -> BufReader<Box<dyn Stream>> {
        let stream = TcpStream::connect(&self.authority).expect("a connection");
        stream.set_read_timeout(Some(PATIENCE)).expect("a timeout");
        let mut stream: Box<dyn Stream> = match &self.trusted {
            None => Box::new(stream),
            Some(config) => {
                let host = self.authority.rsplit_once(':').expect("a port").0;
                let name = ServerName::try_from(host.to_owned()).expect("a name");
                let client = ClientConnection::new(Arc::clone(config), name).expect("TLS");
                Box::new(StreamOwned::new(client, stream))
            }
        };
        let mut request = format!("{method} {path} HTTP/1.1\r\nConnection: close\r\n");
        let host = ("Host", &*self.authority);
        let own = headers.iter().any(|(name, _)| *name == "Host");
        let hosts = (!own).then_some(host).into_iter();
        for (name, value) in hosts.chain(headers.iter().copied()) {
            request.push_str(&format!("{name}: {value}\r\n"));
        }
        if let Some(cookie) = &self.cookie {
            request.push_str(&format!("Cookie: {cookie}\r\n"));
        }
        request.push_str(&format!("Content-Length: {}\r\n\r\n{body}", body.len()));
        stream.write_all(request.as_bytes()).expect("sent");
        BufReader::new(stream)
    }
}

fn head(stream: &mut impl BufRead) -> (u16, Vec<(String, String)>) {
    let mut lines = Vec::new();
    loop {
        let mut line = String::new();
        stream.read_line(&mut line).expect("a line in time");
        if line.trim().is_empty() {
            break;
        }
        lines.push(line);
    }
    let status = lines.first().and_then(|line| line.split(' ').nth(1));
    let status = status.expect("a status").parse().expect("a number");
    let headers = lines.iter().skip(1).filter_map(|line| {
        let (name, value) = line.split_once(':')?;
        Some((name.to_lowercase(), value.trim().to_owned()))
    });
    (status, headers.collect())
}

impl Answer {
    pub fn text(&self) -> String {
        String::from_utf8(self.body.clone()).expect("UTF-8")
    }

    pub fn header(&self, name: &str) -> &str {
        let found = self.headers.iter().find(|(other, _)| other == name);
        found.map_or("", |(_, value)| value)
    }

    /// The page, which has to be one.
    pub fn page(&self) -> String {
        assert_eq!(self.status, 200, "{}", self.text());
        self.text()
    }
}

impl Browser {
    /// Opens a page until it says something.
    pub fn wait_for_page(&self, path: &str, what: &str) -> String {
        let deadline = std::time::Instant::now() + PATIENCE;
        loop {
            let page = self.get(path).page();
            if page.contains(what) {
                return page;
            }
            assert!(std::time::Instant::now() < deadline, "{page}");
            std::thread::sleep(Duration::from_millis(100));
        }
    }
}
