//! Logs.

use clap::{Args, ValueEnum};
use std::io;
use tracing_subscriber::EnvFilter;

/// Where logs go and what they say.
#[derive(Debug, Args)]
pub struct LogOptions {
    /// What to log, as in `info` or `coordinator=debug,warn`
    #[arg(
        long,
        global = true,
        env = "BRDFARM_LOG",
        default_value = "warn",
        value_name = "FILTER",
        hide_env_values = true
    )]
    log: String,
    /// How logs are written to standard error
    #[arg(long, global = true, value_enum, default_value_t = Format::Human)]
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
        .map_err(|error| crate::failure::BadInput(format!("--log {}: {error}", options.log)))?;
    let subscriber = tracing_subscriber::fmt()
        .with_env_filter(filter)
        .with_writer(io::stderr);
    match options.log_format {
        Format::Human => subscriber.init(),
        Format::Json => subscriber.json().init(),
    }
    Ok(())
}
