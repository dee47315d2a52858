//! Logs.

use crate::failure::BadInput;
use crate::progress::AboveBars;
use clap::{Args, ValueEnum};
use std::io::{self, IsTerminal};
use tracing_subscriber::EnvFilter;

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
    let filter = EnvFilter::try_new(&options.log)
        .map_err(|error| BadInput(format!("--log {}: {error}", options.log)))?;
    let subscriber = tracing_subscriber::fmt()
        .with_env_filter(filter)
        .with_ansi(io::stderr().is_terminal())
        .with_writer(|| AboveBars);
    match options.log_format {
        Format::Human => subscriber.init(),
        Format::Json => subscriber.json().init(),
    }
    Ok(())
}
