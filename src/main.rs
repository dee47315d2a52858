//! The command: one file a subcommand, no logic of its own.

mod brdf;
mod completions;
mod connection;
mod coordinator_health;
mod coordinator_serve;
mod cores;
mod credentials;
mod dataset_command;
#[cfg(feature = "training")]
mod estimate;
#[cfg(feature = "training")]
mod evaluate;
mod failure;
mod farm_mode;
mod heap;
mod jobs;
mod jobs_resolve;
mod open_files;
mod output;
mod pages;
mod picture;
mod plan;
mod plural;
mod progress;
mod reference;
mod render;
mod report;
mod run;
mod runtime;
mod shutdown;
mod specification;
mod standard_error;
mod status;
mod store_migrate;
mod store_name;
mod telemetry;
#[cfg(feature = "training")]
mod train;
mod worker_connect;
mod workers;

use clap::{Parser, Subcommand};
use std::process::ExitCode;

/// Renders labelled material datasets.
///
/// Materials are sampled from the ten parameters of an anisotropic reflectance model, rendered
/// from fourteen views with a measured error, and kept in a content-addressed store. Any image can
/// be rendered again, byte for byte, from its seed and index.
#[derive(Debug, Parser)]
#[command(
    name = "brdfarm",
    version,
    propagate_version = true,
    max_term_width = 100,
    after_help = "Exit codes: 0 done, 1 failed, 2 the input or the command line is wrong, 130 or 143 stopped \
                  by SIGINT or SIGTERM."
)]
struct Cli {
    #[command(flatten)]
    telemetry: telemetry::LogOptions,
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    Run(run::Options),
    /// Hand out work to workers and keep what they render
    #[command(subcommand)]
    Coordinator(coordinator_serve::Command),
    /// Render for a coordinator
    #[command(subcommand)]
    Worker(worker_connect::Command),
    Status(status::Options),
    /// List, show, retry, cancel and prioritize jobs
    #[command(subcommand)]
    Jobs(jobs::Command),
    /// List workers, block and unblock them
    #[command(subcommand)]
    Workers(workers::Command),
    Pause(farm_mode::Pause),
    Resume(farm_mode::Resume),
    Drain(farm_mode::Drain),
    Credentials(credentials::Options),
    /// Look at a store, check it, repair it, export it
    #[command(subcommand)]
    Dataset(dataset_command::Command),
    /// Copy a store
    #[command(subcommand)]
    Store(store_migrate::Command),
    Render(render::Options),
    Brdf(brdf::Options),
    Report(report::Options),
    #[cfg(feature = "training")]
    Train(train::Options),
    #[cfg(feature = "training")]
    Evaluate(evaluate::Options),
    #[cfg(feature = "training")]
    Estimate(Box<estimate::Options>),
    Completions(completions::Options),
    Reference(reference::Options),
}

fn main() -> ExitCode {
    let cli = Cli::parse();
    heap::configure();
    let outcome = telemetry::start(&cli.telemetry).and_then(|()| match cli.command {
        Command::Run(options) => run::execute(&options),
        Command::Coordinator(command) => coordinator_serve::execute(&command),
        Command::Worker(command) => worker_connect::execute(&command),
        Command::Status(options) => status::execute(&options),
        Command::Jobs(command) => jobs::execute(&command),
        Command::Workers(command) => workers::execute(&command),
        Command::Pause(options) => farm_mode::pause(&options),
        Command::Resume(options) => farm_mode::resume(&options),
        Command::Drain(options) => farm_mode::drain(&options),
        Command::Credentials(options) => credentials::execute(&options),
        Command::Dataset(command) => dataset_command::execute(&command),
        Command::Store(command) => store_migrate::execute(&command),
        Command::Render(options) => render::execute(&options),
        Command::Brdf(options) => brdf::execute(&options),
        Command::Report(options) => report::execute(&options),
        #[cfg(feature = "training")]
        Command::Train(options) => train::execute(&options),
        #[cfg(feature = "training")]
        Command::Evaluate(options) => evaluate::execute(&options),
        #[cfg(feature = "training")]
        Command::Estimate(options) => estimate::execute(&options),
        Command::Completions(options) => completions::execute(&options),
        Command::Reference(options) => reference::execute(&options),
    });
    failure::exit_code(outcome)
}
