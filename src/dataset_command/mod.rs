//! `brdfarm dataset`: what is done with a store once it is there.

mod browse;
mod diff;
mod export;
mod gc;
mod import;
mod manifest;
#[cfg(feature = "training")]
mod observability;
mod repair;
mod rerender;
pub mod show;
mod specification;
mod stats;
pub mod verify;

use crate::store_name;
use clap::{Args, Subcommand};
use datastore::StoreName;

/// What can be done with a dataset.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Write the labels, one row for each image
    #[command(subcommand)]
    Manifest(manifest::Command),
    Export(export::Options),
    Verify(verify::Options),
    Repair(repair::Options),
    Gc(gc::Options),
    Import(import::Options),
    Diff(diff::Options),
    Stats(stats::Options),
    Show(show::Options),
    Browse(browse::Options),
    #[cfg(feature = "training")]
    Observability(observability::Options),
    Specification(specification::Options),
}

/// The store that a command works on.
#[derive(Debug, Args)]
pub struct StoreOptions {
    /// The store: its folder, or the PostgreSQL database with its labels and ledger. The password of
    /// the database comes from PGPASSWORD or a password file
    #[arg(long, default_value = "store", value_name = store_name::VALUE,
          value_parser = store_name::parser())]
    store: StoreName,
}

/// Does it.
pub fn execute(command: &Command) -> anyhow::Result<()> {
    match command {
        Command::Manifest(command) => manifest::execute(command),
        Command::Export(options) => export::execute(options),
        Command::Verify(options) => verify::execute(options),
        Command::Repair(options) => repair::execute(options),
        Command::Gc(options) => gc::execute(options),
        Command::Import(options) => import::execute(options),
        Command::Diff(options) => diff::execute(options),
        Command::Stats(options) => stats::execute(options),
        Command::Show(options) => show::execute(options),
        Command::Browse(options) => browse::execute(options),
        #[cfg(feature = "training")]
        Command::Observability(options) => observability::execute(options),
        Command::Specification(options) => specification::execute(options),
    }
}
