//! Pages for a browser: a farm at work, and a dataset to look at.
//!
//! ```text
//! command -> Site (what is shown) -> server (connections, TLS) -> router (addresses)
//!                                                                    | access (who may)
//!                                                                    | pages, plots (HTML, SVG)
//!                                                                    | catalogue, images (the store)
//!                                                                    | live (the farm, as it happens)
//! ```
//!
//! Pages are rendered here. One script adds what a browser alone can: values under the pointer,
//! exposure without a reload, and what happens as it happens. Without it every page works.
//!
//! Acts only through the coordinator's `Control` service, as `brdfarm jobs` does; reads the store as
//! `brdfarm dataset` does. Never writes either by itself.

mod access;
mod catalogue;
mod images;
mod live;
pub mod outside;
mod pages;
mod plots;
mod problem;
mod router;
mod sending;
mod server;
mod site;
mod threads;

pub use server::{Options, RunningServer, ServeError, serve};
pub use site::Site;
