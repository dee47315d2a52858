//! The pages, as HTML. What comes from outside (names, errors, addresses) reaches them as text, which
//! maud escapes.

pub mod action;
pub mod assets;
pub mod coverage;
pub mod farm;
pub mod jobs;
pub mod layout;
pub mod login;
pub mod material;
pub mod materials;
pub(crate) mod numbers;
mod problem;
pub mod workers;

use crate::{access::Visitor, site::Site};

/// What surrounds a page: whose it is and who looks.
pub struct Shown<'a> {
    pub site: &'a Site,
    pub can_sign_out: bool,
    pub visitor: Option<Visitor>,
}
