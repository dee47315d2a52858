//! Logs.

use crate::failure::BadInput;
use crate::progress::AboveBars;
use clap::{Args, ValueEnum};
use std::io::{self, IsTerminal};
use tracing_subscriber::{filter::Targets, layer::SubscriberExt, util::SubscriberInitExt};

/// Where logs go and what they say.
#[derive(Debug, Args)]
pub struct LogOptions {
    /// What to log to standard error: error, warn, info, debug or trace; also for a part of the
    /// program, as in coordinator=debug,warn
    #[arg(
        long,
        global = true,
        help_heading = "Logs",
        display_order = 900,
        env = "BRDFARM_LOG",
        default_value = "warn",
        value_name = "FILTER",
        hide_env_values = true
    )]
    log: String,
    /// The format of the logs
    #[arg(
        long,
        global = true,
        help_heading = "Logs",
        display_order = 901,
        value_enum,
        value_name = "FORMAT",
        default_value_t = Format::Human
    )]
    log_format: Format,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum Format {
    /// For people
    Human,
    /// One JSON object a line
    Json,
}

/// Starts logging.
pub fn start(options: &LogOptions) -> anyhow::Result<()> {
    let filter: Targets = options
        .log
        .parse()
        .map_err(|error| BadInput(format!("--log {}: {error}", options.log)))?;
    let lines = tracing_subscriber::fmt::layer()
        .with_ansi(io::stderr().is_terminal())
        .with_writer(|| AboveBars);
    let filtered = tracing_subscriber::registry().with(filter);
    match options.log_format {
        Format::Human => filtered.with(lines).init(),
        Format::Json => filtered.with(lines.json()).init(),
    }
    Ok(())
}
