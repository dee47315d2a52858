//! The page that says why there is no other.

use super::layout;
use crate::problem::Problem;
use axum::response::{IntoResponse, Response};
use maud::html;

impl IntoResponse for Problem {
    fn into_response(self) -> Response {
        let title = self.status.canonical_reason().unwrap_or("Problem");
        let page = layout::bare(
            title,
            html! {
                p.problem { (self.sentence) }
                p { a href="/" { "Back to the first page" } }
            },
        );
        (self.status, page).into_response()
    }
}
