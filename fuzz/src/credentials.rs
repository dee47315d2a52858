//! Who somebody is: token files, tokens, and what a client is configured with.

use coordinator::security::Tokens;
use dataset::Digest;
use jobqueue::token::Token;
use proto::client::{self, Credentials};
use std::{collections::HashSet, sync::LazyLock};
use tokio::runtime::Runtime;

/// Reads a file of tokens, and each as a lease's or as a digest. Of a token that stands there twice
/// the later role counts.
pub fn tokens(bytes: &[u8]) -> bool {
    let Ok(text) = str::from_utf8(bytes) else {
        return false;
    };
    if let Ok(token) = serde_json::from_str::<Token>(text) {
        let json = serde_json::to_string(&token).unwrap();
        assert_eq!(serde_json::from_str::<Token>(&json).unwrap(), token);
        return true;
    }
    if let Ok(digest) = text.parse::<Digest>() {
        assert_eq!(digest.to_string(), text);
        return true;
    }
    let Ok(tokens) = text.parse::<Tokens>() else {
        return false;
    };
    let lines = text.lines().map(str::trim);
    let lines = lines.filter(|line| !line.starts_with('#'));
    let known: HashSet<&str> = lines
        .filter_map(|line| line.split_ascii_whitespace().nth(1))
        .collect();
    for token in &known {
        assert!(tokens.caller(token.as_bytes()).is_some());
        let shorter = &token[1..];
        assert_eq!(
            tokens.caller(shorter.as_bytes()).is_some(),
            known.contains(shorter)
        );
    }
    assert_eq!(tokens.caller(b""), None);
    true
}

static RUNTIME: LazyLock<Runtime> = LazyLock::new(|| Runtime::new().unwrap());

/// Configures a client with a URL, a token and certificates, parted by zero bytes.
pub fn credentials(bytes: &[u8]) -> bool {
    let mut parts = bytes.split(|byte| *byte == 0);
    let mut part = || parts.next().filter(|part| !part.is_empty());
    let text = |part: &[u8]| String::from_utf8_lossy(part).into_owned();
    let url = part().map(text).unwrap_or_default();
    let token = part().map(text);
    let authority = part().map(<[u8]>::to_vec);
    let certificate = part().map(<[u8]>::to_vec);
    let identity = certificate.zip(part().map(<[u8]>::to_vec));
    let credentials = Credentials {
        token,
        authority,
        identity,
    };
    let _inside = RUNTIME.enter();
    match client::farm(&url, &credentials) {
        Ok(_) => true,
        Err(sentence) => {
            // A sentence quotes the URL, with its escapes, and that may look like any token.
            let rest = sentence.replace(&format!("{url:?}"), "").replace(&url, "");
            let secret = credentials.token.filter(|token| token.len() > 8);
            assert!(
                secret.is_none_or(|secret| url.contains(&secret) || !rest.contains(&secret)),
                "{sentence}"
            );
            false
        }
    }
}
