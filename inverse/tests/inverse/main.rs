//! Derivatives, information and refinement over the renderer.

#![allow(
    clippy::print_stdout,
    reason = "figures are for whoever runs with --nocapture"
)]

mod bounds;
mod campaign;
mod derivatives;
mod differences;
mod refine;
mod scene;
mod starts;
