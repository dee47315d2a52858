//! `brdfarm pause`, `resume` and `drain`: whether the farm hands out work.

use crate::connection::CoordinatorOptions;
use clap::Args;
use proto::{ControlClient, DrainRequest, ModeChanged, PauseRequest, ResumeRequest};
use std::io::{self, Write};
use tonic::Request;

/// Hand out no more jobs: workers finish what they hold and wait
#[derive(Debug, Args)]
pub struct Pause {
    #[command(flatten)]
    coordinator: CoordinatorOptions,
}

/// Hand out jobs again
#[derive(Debug, Args)]
pub struct Resume {
    #[command(flatten)]
    coordinator: CoordinatorOptions,
}

/// Hand out no more jobs: workers finish what they hold and leave
#[derive(Debug, Args)]
pub struct Drain {
    #[command(flatten)]
    coordinator: CoordinatorOptions,
}

/// Pauses.
pub fn pause(options: &Pause) -> anyhow::Result<()> {
    let method = async |mut client: ControlClient, request: Request<PauseRequest>| {
        client.pause(request).await
    };
    say("paused", options.coordinator.call(PauseRequest {}, method)?)
}

/// Resumes.
pub fn resume(options: &Resume) -> anyhow::Result<()> {
    let method = async |mut client: ControlClient, request: Request<ResumeRequest>| {
        client.resume(request).await
    };
    say(
        "running",
        options.coordinator.call(ResumeRequest {}, method)?,
    )
}

/// Drains.
pub fn drain(options: &Drain) -> anyhow::Result<()> {
    let method = async |mut client: ControlClient, request: Request<DrainRequest>| {
        client.drain(request).await
    };
    say(
        "draining",
        options.coordinator.call(DrainRequest {}, method)?,
    )
}

fn say(mode: &str, changed: ModeChanged) -> anyhow::Result<()> {
    let before = if changed.repeated { ", as before" } else { "" };
    writeln!(io::stdout(), "{mode}{before}")?;
    Ok(())
}
