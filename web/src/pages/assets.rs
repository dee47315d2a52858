//! The one script, the one style sheet and the icon. They are part of the program.

use axum::response::{IntoResponse, Response};
use http::{HeaderName, HeaderValue, StatusCode, header};
use std::sync::LazyLock;

const STYLE: &str = include_str!("../assets/style.css");
const SCRIPT: &str = include_str!("../assets/script.js");
const ICON: &str = include_str!("../assets/icon.svg");

/// Addresses with the begin of the content's digest, so that a browser keeps no older version.
static STYLE_ADDRESS: LazyLock<String> = LazyLock::new(|| address("/style.css", STYLE));
static SCRIPT_ADDRESS: LazyLock<String> = LazyLock::new(|| address("/script.js", SCRIPT));

/// Where pages find the style sheet.
pub fn style_address() -> &'static str {
    &STYLE_ADDRESS
}

/// Where pages find the script.
pub fn script_address() -> &'static str {
    &SCRIPT_ADDRESS
}

fn address(path: &str, content: &str) -> String {
    format!("{path}?{:.12}", blake3::hash(content.as_bytes()).to_hex())
}

/// The style sheet.
pub async fn style() -> Response {
    answer("text/css; charset=utf-8", STYLE)
}

/// The script.
pub async fn script() -> Response {
    answer("text/javascript; charset=utf-8", SCRIPT)
}

/// The icon.
pub async fn icon() -> Response {
    answer("image/svg+xml", ICON)
}

fn answer(kind: &'static str, content: &'static str) -> Response {
    let about: [(HeaderName, HeaderValue); 2] = [
        (header::CONTENT_TYPE, HeaderValue::from_static(kind)),
        (
            header::CACHE_CONTROL,
            HeaderValue::from_static("public, max-age=86400"),
        ),
    ];
    (StatusCode::OK, about, content).into_response()
}
