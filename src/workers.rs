//! `brdfarm workers`: shows the workers and their failures, and blocks them.

use crate::connection::CoordinatorOptions;
use crate::plural::count;
use clap::{Args, Subcommand};
use jobqueue::identity;
use proto::{
    BarWorkerRequest, ControlClient, ListWorkersRequest, ListWorkersResponse, UnbarWorkerRequest,
    WorkerDetail,
};
use serde_json::{Value, json};
use std::io::{self, Write};
use tonic::{Request, Response, Status};

/// What can be done with workers.
#[derive(Debug, Subcommand)]
pub enum Command {
    List(List),
    // The names of earlier versions go on working.
    #[command(alias = "bar")]
    Block(Block),
    #[command(alias = "unbar")]
    Unblock(Unblock),
}

/// List workers by name: those that are present, and those with failures or a block
#[derive(Debug, Args)]
pub struct List {
    #[command(flatten)]
    coordinator: CoordinatorOptions,
    /// Print JSON, one object a line
    #[arg(long)]
    json: bool,
}

/// Give a worker no more work, and take back what it holds
#[derive(Debug, Args)]
pub struct Block {
    #[command(flatten)]
    coordinator: CoordinatorOptions,
    /// A worker as `workers list` shows it, CREDENTIAL/NAME; or a credential, for all workers that use it
    name: String,
    /// The reason, which the worker logs
    #[arg(long, default_value = "blocked by an operator")]
    reason: String,
}

/// Let a blocked worker work again
#[derive(Debug, Args)]
pub struct Unblock {
    #[command(flatten)]
    coordinator: CoordinatorOptions,
    name: String,
}

/// Does it.
pub fn execute(command: &Command) -> anyhow::Result<()> {
    match command {
        Command::List(options) => list(options),
        Command::Block(options) => block(options),
        Command::Unblock(options) => unblock(options),
    }
}

fn list(options: &List) -> anyhow::Result<()> {
    let answer = options
        .coordinator
        .call(ListWorkersRequest {}, list_workers)?;
    let mut out = io::stdout();
    for worker in &answer.workers {
        if options.json {
            writeln!(out, "{}", as_json(worker))?;
        } else {
            show(worker, &mut out)?;
        }
    }
    Ok(())
}

fn block(options: &Block) -> anyhow::Result<()> {
    let message = BarWorkerRequest {
        name: options.name.clone(),
        reason: options.reason.clone(),
    };
    let method = async |mut client: ControlClient, request: Request<BarWorkerRequest>| {
        client.bar_worker(request).await
    };
    let known = options
        .coordinator
        .call(ListWorkersRequest {}, list_workers)?;
    let mut known = known.workers.iter();
    let is_known = known.any(|worker| means(&options.name, &worker.name));
    let answer = options.coordinator.call(message, method)?;
    let mut out = io::stdout();
    if is_known {
        let leases = count(answer.leases_taken_back, "lease");
        writeln!(out, "{} is blocked; {leases} taken back", options.name)?;
    } else {
        let name = &options.name;
        writeln!(
            out,
            "{name} is blocked; no worker of that name is known: check the spelling"
        )?;
    }
    Ok(())
}

/// Whether an operator who says `said` means the worker of a full name.
fn means(said: &str, full_name: &str) -> bool {
    said == full_name || identity::credential(full_name) == Some(said)
}

async fn list_workers(
    mut client: ControlClient,
    request: Request<ListWorkersRequest>,
) -> Result<Response<ListWorkersResponse>, Status> {
    client.list_workers(request).await
}

fn unblock(options: &Unblock) -> anyhow::Result<()> {
    let message = UnbarWorkerRequest {
        name: options.name.clone(),
    };
    let method = async |mut client: ControlClient, request: Request<UnbarWorkerRequest>| {
        client.unbar_worker(request).await
    };
    options.coordinator.call(message, method)?;
    writeln!(io::stdout(), "{} works again", options.name)?;
    Ok(())
}

fn show(worker: &WorkerDetail, out: &mut impl Write) -> io::Result<()> {
    let presence = match worker.sessions {
        0 => "absent".to_owned(),
        1 => "present".to_owned(),
        sessions => format!("present {sessions} times"),
    };
    writeln!(
        out,
        "{:24}  {presence}, {}, {} completed, {}, {} lost",
        worker.name,
        count(worker.leases, "lease"),
        worker.materials_completed,
        count(worker.failures, "failure"),
        worker.leases_lost
    )?;
    if !worker.barred.is_empty() {
        writeln!(out, "  blocked: {}", worker.barred)?;
    }
    for failure in &worker.failures_in_a_row {
        writeln!(
            out,
            "  failed material {}: {}",
            failure.material, failure.error
        )?;
    }
    Ok(())
}

fn as_json(worker: &WorkerDetail) -> Value {
    let failures = worker.failures_in_a_row.iter();
    let failures =
        failures.map(|failure| json!({"material": failure.material, "error": failure.error}));
    json!({
        "name": worker.name,
        "sessions": worker.sessions,
        "leases": worker.leases,
        "materials_completed": worker.materials_completed,
        "failures": worker.failures,
        "leases_lost": worker.leases_lost,
        "failures_in_a_row": failures.collect::<Vec<_>>(),
        "barred": worker.barred,
        "silent_seconds": worker.silent_ms as f64 / 1e3,
    })
}
