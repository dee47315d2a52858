//! Server-sent events: fragments of a page, each when it changed.

use axum::{body::Body, response::Response};
use bytes::Bytes;
use futures_util::stream;
use http::{HeaderValue, header};
use limits::web::LIVE_SPAN;
use std::{collections::BTreeMap, convert::Infallible, sync::Arc, time::Duration};
use tokio::{
    sync::watch,
    time::{Instant, sleep_until, timeout},
};

/// A page's sections by name, as HTML.
pub type Fragments = BTreeMap<&'static str, String>;

/// How often a stream says that it is still there, so that neither side takes it for broken.
const SIGN_OF_LIFE: Duration = Duration::from_secs(15);

/// What a page was told last.
struct Told {
    news: watch::Receiver<Arc<[Fragments; 2]>>,
    stopping: watch::Receiver<bool>,
    variant: usize,
    last: Fragments,
    is_first: bool,
    end: Instant,
}

/// The answer that goes on for as long as the page is open, up to [`LIVE_SPAN`]; then the browser asks
/// again. Ends at once when pages are served no longer.
pub fn stream(
    news: watch::Receiver<Arc<[Fragments; 2]>>,
    variant: usize,
    stopping: watch::Receiver<bool>,
) -> Response {
    let told = Told {
        news,
        stopping,
        variant,
        last: Fragments::default(),
        is_first: true,
        end: Instant::now() + LIVE_SPAN,
    };
    let events = stream::unfold(told, |mut told| async move {
        let bytes = told.next().await?;
        Some((Ok::<_, Infallible>(bytes), told))
    });
    let mut answer = Response::new(Body::from_stream(events));
    let headers = answer.headers_mut();
    let kind = HeaderValue::from_static("text/event-stream");
    headers.insert(header::CONTENT_TYPE, kind);
    answer
}

impl Told {
    /// The next event; none when pages are served no longer, and at the end of its span.
    async fn next(&mut self) -> Option<Bytes> {
        if self.is_first {
            self.is_first = false;
            self.news.mark_changed();
            // How soon a browser tries again, milliseconds.
            return Some(Bytes::from_static(b"retry: 2000\n\n"));
        }
        tokio::select! {
            changed = timeout(SIGN_OF_LIFE, self.news.changed()) => match changed {
                Err(_) => Some(Bytes::from_static(b": still here\n\n")),
                Ok(Err(_)) => None,
                Ok(Ok(())) => {
                    let now = self.news.borrow_and_update()[self.variant].clone();
                    let events = events(&self.last, &now);
                    self.last = now;
                    Some(events)
                }
            },
            _ = self.stopping.wait_for(|stopping| *stopping) => None,
            () = sleep_until(self.end) => None,
        }
    }
}

/// The fragments that changed, as events; something even if none did.
fn events(before: &Fragments, now: &Fragments) -> Bytes {
    let mut events = String::from(": \n\n");
    for (name, html) in now.iter() {
        if before.get(name) != Some(html) {
            // A line's end would end the event's line.
            let html = html.replace(['\r', '\n'], " ");
            events.push_str(&format!("event: {name}\ndata: {html}\n\n"));
        }
    }
    events.into()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_changed_is_told_and_no_text_ends_its_line() {
        let fragments = |progress: &str, last: &str| {
            let texts = [("progress", progress), ("last", last)];
            Fragments::from(texts.map(|(name, text)| (name, text.to_owned())))
        };
        let (before, now) = (fragments("1", "a"), fragments("2", "a"));
        let told = events(&before, &now);
        assert_eq!(told, ": \n\nevent: progress\ndata: 2\n\n");
        assert_eq!(events(&now, &now), ": \n\n");
        let hostile = fragments("2", "x\r\n\r\nevent: progress\rdata: lie\n");
        let told = String::from_utf8(events(&now, &hostile).to_vec()).unwrap();
        assert_eq!(
            told,
            ": \n\nevent: last\ndata: x    event: progress data: lie \n\n"
        );
    }
}
