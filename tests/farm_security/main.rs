//! Strangers at the door of a real coordinator: each is refused, and the farm goes on.

#[allow(
    dead_code,
    clippy::unwrap_used,
    reason = "other tests use the rest, and a panic there is a failed test"
)]
#[path = "../../datastore/tests/store/cheap_image.rs"]
mod cheap_image;

mod admission;
mod credentials;
#[allow(clippy::print_stdout, reason = "the long runs tell their figures")]
mod floods;
#[allow(dead_code, reason = "other tests use the rest")]
#[path = "../folder/mod.rs"]
mod folder;
mod images;
mod place;
#[allow(dead_code, reason = "other tests use the rest")]
#[path = "../process/mod.rs"]
mod process;
#[allow(clippy::print_stdout, reason = "it tells its figures")]
mod unread;
mod windows;
