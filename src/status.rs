//! `brdfarm status`: the progress of a farm.

use crate::connection::CoordinatorOptions;
use crate::plural::{count, time};
use crate::store_name;
use clap::Args;
use datastore::{Holder, ReadOnlyStore, StoreName};
use proto::{ControlClient, Mode, StatusRequest, StatusResponse, client::with_deadline};
use serde_json::{Value, json};
use std::io::{self, IsTerminal, Write};
use std::time::Duration;
use tonic::{Request, Response};

/// Show the progress of a farm, of a `brdfarm run`, or of a store
///
/// Exits with 1 if materials are quarantined, if disputes remain at the end, or if the coordinator
/// does not answer.
#[derive(Debug, Args)]
pub struct Options {
    #[command(flatten)]
    coordinator: CoordinatorOptions,
    /// A store. The process that serves it on this machine is asked, and --coordinator is ignored. If
    /// no process serves it, the store itself is read
    #[arg(long, value_name = store_name::VALUE, value_parser = store_name::parser())]
    store: Option<StoreName>,
    /// Repeat until nothing is left to do
    #[arg(long)]
    watch: bool,
    /// Seconds between two updates
    #[arg(long, default_value_t = 1, value_name = "SECONDS", requires = "watch",
          value_parser = clap::value_parser!(u64).range(1..=3600))]
    interval: u64,
    /// Print JSON, one object a line
    #[arg(long)]
    json: bool,
}

/// Shows it.
pub fn execute(options: &Options) -> anyhow::Result<()> {
    let method = async |mut client: ControlClient, request: Request<StatusRequest>| {
        client.status(request).await
    };
    let mut out = io::stdout();
    let coordinator = match &options.store {
        None => options.coordinator.clone(),
        Some(store) => match store.folder().and_then(Holder::of) {
            Some(holder) => options.coordinator.of(holder),
            None => return show_store(store, options.json, &mut out),
        },
    };
    if !options.watch {
        let status = coordinator.call(StatusRequest {}, method)?;
        return show(&status, options.json, &mut out);
    }
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()?;
    runtime.block_on(async {
        let mut client = coordinator.connect()?;
        loop {
            let status = client.status(with_deadline(StatusRequest {})).await;
            let status = status.map(Response::into_inner);
            let status = status.map_err(|status| coordinator.error(&status))?;
            if out.is_terminal() && !options.json {
                // Back to the top left corner, and an empty screen.
                write!(out, "\x1b[H\x1b[2J")?;
            }
            show_only(&status, options.json, &mut out)?;
            if status.finished {
                return trouble(&status);
            }
            tokio::time::sleep(Duration::from_secs(options.interval)).await;
        }
    })
}

/// The progress of a store that no process on this machine serves.
fn show_store(name: &StoreName, json: bool, out: &mut impl Write) -> anyhow::Result<()> {
    let store = ReadOnlyStore::open(name)?;
    let specification = store.specification();
    let completed = specification.materials - store.materials_missing();
    let images = u64::from(completed) * specification.views.len() as u64;
    if json {
        let told = json!({
            "name": specification.name,
            "specification_hash": store.specification_hash().to_string(),
            "mode": "not_served",
            "finished": store.materials_missing() == 0,
            "views": specification.views.len(),
            "materials": specification.materials,
            "completed": completed,
            "images": images,
        });
        writeln!(out, "{told}")?;
        return Ok(());
    }
    let state = match store.materials_missing() {
        0 => "complete",
        _ => "not served: `brdfarm run` or a coordinator resumes it",
    };
    writeln!(out, "{} ({state})", specification.name)?;
    let materials = specification.materials;
    writeln!(out, "materials   {completed} of {materials} complete")?;
    writeln!(out, "images      {images}")?;
    Ok(())
}

fn show(status: &StatusResponse, json: bool, out: &mut impl Write) -> anyhow::Result<()> {
    show_only(status, json, out)?;
    trouble(status)
}

fn show_only(status: &StatusResponse, json: bool, out: &mut impl Write) -> anyhow::Result<()> {
    if json {
        writeln!(out, "{}", as_json(status))?;
    } else {
        write_for_people(status, out)?;
    }
    out.flush()?;
    Ok(())
}

fn trouble(status: &StatusResponse) -> anyhow::Result<()> {
    let counts = status.counts.unwrap_or_default();
    anyhow::ensure!(
        !status.finished || counts.disputed == 0,
        "{} rendered differently by two workers, and no third worker is present to decide: \
         `brdfarm jobs resolve` renders them on this machine",
        count(counts.disputed, "material")
    );
    let set_aside = counts.set_aside;
    anyhow::ensure!(
        set_aside == 0,
        "{} quarantined after repeated failures: `brdfarm jobs show` says why, `brdfarm jobs retry \
         --all` tries again",
        count(set_aside, "material")
    );
    Ok(())
}

fn mode_word(status: &StatusResponse) -> &'static str {
    match status.mode() {
        Mode::Paused => "paused",
        Mode::Draining => "draining",
        Mode::Running | Mode::Unspecified if status.finished => "finished",
        Mode::Running | Mode::Unspecified => "running",
    }
}

fn write_for_people(status: &StatusResponse, out: &mut impl Write) -> io::Result<()> {
    let counts = status.counts.unwrap_or_default();
    writeln!(out, "{} ({})", status.name, mode_word(status))?;
    writeln!(
        out,
        "materials   {} of {} complete, {} with workers, {} waiting",
        counts.completed, counts.materials, counts.leased, counts.pending
    )?;
    for (number, what) in [
        (counts.set_aside, "quarantined after repeated failures"),
        (counts.cancelled, "cancelled"),
        (
            counts.disputed,
            "rendered differently by two workers: a third decides, or `brdfarm jobs resolve`",
        ),
        (counts.checks, "to be rendered again by another worker"),
    ] {
        if number > 0 {
            writeln!(out, "            {number} {what}")?;
        }
    }
    let rate = status.images_per_second;
    write!(out, "images      {}, {rate:.1} a second", counts.images)?;
    let left = u64::from(counts.pending + counts.leased) * u64::from(status.views);
    if rate > 0.0 && left > 0 {
        write!(out, ", {} left", time(left as f64 / rate))?;
    }
    writeln!(out)?;
    write!(out, "workers     {}", counts.workers)?;
    if counts.workers_barred > 0 {
        write!(out, ", {} blocked", counts.workers_barred)?;
    }
    writeln!(out)?;
    writeln!(
        out,
        "up          {}, {}, {} lost",
        time(status.up_ms as f64 / 1e3),
        count(counts.failures, "failure"),
        count(counts.leases_lost, "lease")
    )?;
    for dispute in &status.disputed {
        writeln!(
            out,
            "material {}: {} contradicts {}",
            dispute.material, dispute.contradicted_by, dispute.worker
        )?;
    }
    for set_aside in &status.set_aside {
        let error = set_aside
            .errors
            .last()
            .map_or("its workers vanished", String::as_str);
        writeln!(out, "material {}: {error}", set_aside.material)?;
    }
    Ok(())
}

fn as_json(status: &StatusResponse) -> Value {
    let counts = status.counts.unwrap_or_default();
    let set_aside = status.set_aside.iter();
    let set_aside = set_aside.map(|job| json!({"material": job.material, "errors": job.errors}));
    let disputed = status.disputed.iter().map(|dispute| {
        json!({
            "material": dispute.material,
            "worker": dispute.worker,
            "contradicted_by": dispute.contradicted_by,
        })
    });
    let hash = status.specification_hash.iter();
    json!({
        "name": status.name,
        "specification_hash": hash.map(|byte| format!("{byte:02x}")).collect::<String>(),
        "mode": mode_word(status),
        "finished": status.finished,
        "views": status.views,
        "materials": counts.materials,
        "completed": counts.completed,
        "leased": counts.leased,
        "pending": counts.pending,
        "set_aside": counts.set_aside,
        "cancelled": counts.cancelled,
        "disputed": counts.disputed,
        "checks": counts.checks,
        "images": counts.images,
        "images_per_second": status.images_per_second,
        "bytes_received": counts.bytes_received,
        "workers": counts.workers,
        "workers_barred": counts.workers_barred,
        "failures": counts.failures,
        "leases_lost": counts.leases_lost,
        "up_seconds": status.up_ms as f64 / 1e3,
        "jobs_set_aside": set_aside.collect::<Vec<_>>(),
        "jobs_disputed": disputed.collect::<Vec<_>>(),
    })
}
