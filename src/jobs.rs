//! `brdfarm jobs`: shows and changes the state of jobs.

use crate::connection::CoordinatorOptions;
use crate::failure::BadInput;
use crate::jobs_resolve::{self, Resolve};
use clap::{Args, Subcommand, ValueEnum};
use dataset::IndexList;
use proto::{
    CancelJobsRequest, Check, ControlClient, JobDetail, JobSelection, JobState, JobsChanged,
    ListJobsRequest, ListJobsResponse, MaterialRange, PrioritizeJobsRequest, RetryJobsRequest,
};
use serde_json::{Value, json};
use std::io::{self, Write};
use tonic::Request;

/// What can be done with jobs.
#[derive(Debug, Subcommand)]
pub enum Command {
    List(List),
    Show(Show),
    Retry(Retry),
    Cancel(Cancel),
    Prioritize(Prioritize),
    Resolve(Resolve),
}

/// List jobs, one a line
#[derive(Debug, Args)]
pub struct List {
    #[command(flatten)]
    coordinator: CoordinatorOptions,
    /// Only jobs in this state
    #[arg(long, value_enum)]
    state: Option<State>,
    /// Only these materials, as in 3,5-9
    #[arg(long, value_name = "LIST")]
    materials: Option<IndexList>,
    /// Print JSON, one object a line
    #[arg(long)]
    json: bool,
}

/// Show everything that is known about one job
#[derive(Debug, Args)]
pub struct Show {
    #[command(flatten)]
    coordinator: CoordinatorOptions,
    material: u32,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

/// Put quarantined or cancelled jobs back into the queue
#[derive(Debug, Args)]
pub struct Retry {
    #[command(flatten)]
    coordinator: CoordinatorOptions,
    /// The materials of the jobs, as in 3,5-9
    #[arg(value_name = "LIST", required_unless_present = "all")]
    materials: Option<IndexList>,
    /// All quarantined jobs
    #[arg(long, conflicts_with = "materials")]
    all: bool,
}

/// Cancel jobs that are not complete
#[derive(Debug, Args)]
pub struct Cancel {
    #[command(flatten)]
    coordinator: CoordinatorOptions,
    /// The materials of the jobs, as in 3,5-9
    #[arg(value_name = "LIST")]
    materials: IndexList,
    /// Only say which jobs would be cancelled
    #[arg(long)]
    dry_run: bool,
}

/// Set the priority of waiting jobs
#[derive(Debug, Args)]
pub struct Prioritize {
    #[command(flatten)]
    coordinator: CoordinatorOptions,
    /// The materials of the jobs, as in 3,5-9
    #[arg(value_name = "LIST")]
    materials: IndexList,
    /// Jobs with a higher priority are handed out first; the default priority is 0
    #[arg(long, allow_negative_numbers = true, value_name = "N",
          value_parser = clap::value_parser!(i32).range(
              -(limits::protocol::PRIORITY_MAX as i64)..=limits::protocol::PRIORITY_MAX as i64))]
    priority: i32,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum State {
    Pending,
    Leased,
    Completed,
    Disputed,
    // The name of earlier versions goes on working.
    #[value(alias = "set-aside")]
    Quarantined,
    Cancelled,
}

impl From<State> for JobState {
    fn from(state: State) -> Self {
        match state {
            State::Pending => Self::Pending,
            State::Leased => Self::Leased,
            State::Completed => Self::Completed,
            State::Disputed => Self::Disputed,
            State::Quarantined => Self::SetAside,
            State::Cancelled => Self::Cancelled,
        }
    }
}

/// Does it.
pub fn execute(command: &Command) -> anyhow::Result<()> {
    match command {
        Command::List(options) => list(options),
        Command::Show(options) => show(options),
        Command::Retry(options) => retry(options),
        Command::Cancel(options) => cancel(options),
        Command::Prioritize(options) => prioritize(options),
        Command::Resolve(options) => jobs_resolve::execute(options),
    }
}

fn list(options: &List) -> anyhow::Result<()> {
    let selection = JobSelection {
        ranges: options.materials.as_ref().map_or_else(Vec::new, ranges),
        states: options
            .state
            .map(|state| JobState::from(state).into())
            .into_iter()
            .collect(),
    };
    let mut out = io::stdout();
    each(&options.coordinator, &selection, |job| {
        if options.json {
            writeln!(out, "{}", as_json(job))
        } else {
            writeln!(out, "{}", line(job))
        }
    })
}

fn show(options: &Show) -> anyhow::Result<()> {
    let material = options.material;
    let range = MaterialRange {
        first: material,
        last: material,
    };
    let selection = JobSelection {
        ranges: vec![range],
        states: Vec::new(),
    };
    let mut out = io::stdout();
    let mut found = false;
    each(&options.coordinator, &selection, |job| {
        found = true;
        if options.json {
            return writeln!(out, "{}", as_json(job));
        }
        writeln!(out, "{}", line(job))?;
        for failure in &job.failures {
            writeln!(out, "  failed on {}: {}", failure.worker, failure.error)?;
        }
        Ok(())
    })?;
    if !found {
        return Err(BadInput(format!("there is no material {material} in this set")).into());
    }
    Ok(())
}

fn retry(options: &Retry) -> anyhow::Result<()> {
    let selection = match &options.materials {
        Some(materials) => JobSelection {
            ranges: ranges(materials),
            states: Vec::new(),
        },
        None => JobSelection {
            ranges: Vec::new(),
            states: vec![JobState::SetAside.into()],
        },
    };
    let message = RetryJobsRequest {
        selection: Some(selection),
    };
    let method = async |mut client: ControlClient, request: Request<RetryJobsRequest>| {
        client.retry_jobs(request).await
    };
    say(
        "back in the queue",
        options.coordinator.call(message, method)?,
    )
}

fn cancel(options: &Cancel) -> anyhow::Result<()> {
    let ranges = ranges(&options.materials);
    if options.dry_run {
        let not_done = [JobState::Pending, JobState::Leased, JobState::SetAside];
        let selection = JobSelection {
            ranges,
            states: not_done.map(Into::into).to_vec(),
        };
        let mut out = io::stdout();
        return each(&options.coordinator, &selection, |job| {
            writeln!(out, "would cancel {}", line(job))
        });
    }
    let selection = JobSelection {
        ranges,
        states: Vec::new(),
    };
    let message = CancelJobsRequest {
        selection: Some(selection),
    };
    let method = async |mut client: ControlClient, request: Request<CancelJobsRequest>| {
        client.cancel_jobs(request).await
    };
    say("cancelled", options.coordinator.call(message, method)?)
}

fn prioritize(options: &Prioritize) -> anyhow::Result<()> {
    let ranges = ranges(&options.materials);
    let selection = JobSelection {
        ranges,
        states: Vec::new(),
    };
    let message = PrioritizeJobsRequest {
        selection: Some(selection),
        priority: options.priority,
    };
    let method = async |mut client: ControlClient, request: Request<PrioritizeJobsRequest>| {
        client.prioritize_jobs(request).await
    };
    say("prioritized", options.coordinator.call(message, method)?)
}

/// Shows jobs page by page.
fn each(
    coordinator: &CoordinatorOptions,
    selection: &JobSelection,
    mut show: impl FnMut(&JobDetail) -> io::Result<()>,
) -> anyhow::Result<()> {
    let mut from = 0;
    loop {
        let message = ListJobsRequest {
            selection: Some(selection.clone()),
            from,
            jobs_max: limits::protocol::JOBS_LISTED_MAX,
        };
        let method = async |mut client: ControlClient, request: Request<ListJobsRequest>| {
            client.list_jobs(request).await
        };
        let page: ListJobsResponse = coordinator.call(message, method)?;
        for job in &page.jobs {
            show(job)?;
        }
        match page.next {
            Some(next) => from = next,
            None => return Ok(()),
        }
    }
}

fn say(done: &str, changed: JobsChanged) -> anyhow::Result<()> {
    let changed = changed.changed.into_iter();
    let changed: IndexList = changed.map(|range| range.first..=range.last).collect();
    writeln!(io::stdout(), "{done}: {changed}")?;
    Ok(())
}

fn ranges(materials: &IndexList) -> Vec<MaterialRange> {
    let ranges = materials.ranges().iter();
    let ranges = ranges.map(|range| MaterialRange {
        first: *range.start(),
        last: *range.end(),
    });
    ranges.collect()
}

fn state_word(job: &JobDetail) -> &'static str {
    match job.state() {
        JobState::Pending => "pending",
        JobState::Leased => "leased",
        JobState::Completed => "completed",
        JobState::Disputed => "disputed",
        JobState::SetAside => "set aside",
        JobState::Cancelled => "cancelled",
        JobState::Unspecified => "unknown",
    }
}

fn check_word(job: &JobDetail) -> &'static str {
    match job.check() {
        Check::None => "none",
        Check::Due => "due",
        Check::UnderWay => "under way",
        Check::Agreed => "agreed",
    }
}

fn line(job: &JobDetail) -> String {
    // In JSON the state keeps the word of earlier versions.
    let state = match job.state() {
        JobState::SetAside => "quarantined",
        _ => state_word(job),
    };
    let mut line = format!("{:6}  {state:9}", job.material);
    let mut add = |text: String| {
        line.push_str("  ");
        line.push_str(&text);
    };
    if !job.worker.is_empty() {
        add(job.worker.clone());
    }
    if !job.lease.is_empty() {
        add(format!("lease {}, {} views", job.lease, job.views_done));
    }
    if job.check() != Check::None {
        add(format!("second rendering {}", check_word(job)));
    }
    if !job.contradicted_by.is_empty() {
        add(format!("contradicted by {}", job.contradicted_by));
    }
    if job.priority != 0 {
        add(format!("priority {}", job.priority));
    }
    if !job.failures.is_empty() {
        add(format!("failed {} times", job.failures.len()));
    }
    if job.leases_lost > 0 {
        add(format!("lost {} times", job.leases_lost));
    }
    line.truncate(line.trim_end().len());
    line
}

fn as_json(job: &JobDetail) -> Value {
    let failures = job.failures.iter();
    let failures =
        failures.map(|failure| json!({"worker": failure.worker, "error": failure.error}));
    json!({
        "material": job.material,
        "state": state_word(job),
        "priority": job.priority,
        "worker": job.worker,
        "lease": job.lease,
        "views_done": job.views_done,
        "second_rendering": check_word(job),
        "contradicted_by": job.contradicted_by,
        "leases_lost": job.leases_lost,
        "failures": failures.collect::<Vec<_>>(),
    })
}
