//! The farm as a discrete-event simulation: jobs a second, latencies and the bottleneck of farms
//! that nobody here can build.
//!
//! What decides is the real queue, `jobqueue`, told the simulated time. Around it stand models of
//! what takes time: machines whose threads share cores, upload slots, group commit, the tasks and
//! transactions of PostgreSQL, workers that render, renew, die and come back. What everything costs
//! was measured with few clients and is in [`costs`]; nothing is fitted to what comes out.
//!
//! | module | what |
//! | --- | --- |
//! | [`farm`] | what is simulated |
//! | [`costs`] | every service time, and where it was measured |
//! | [`machine`] | cores that threads share |
//! | [`events`] | what happens when |
//! | [`figures`] | what came of it |
//!
//! Not simulated: registrations, the end of a long poll that found no work, liars, probation and
//! audits, vacuums and checkpoints, a disk or a bucket that slows down under load.

pub mod costs;
mod draws;
pub mod events;
pub mod farm;
pub mod figures;
pub mod machine;
mod world;

use anyhow::Result;
use farm::Farm;
use figures::Figures;
use jobqueue::Queue;

/// Simulates a farm; returns what came of it, and the queue as it stood in the end.
///
/// # Errors
/// When there can be no such farm.
pub fn simulate(farm: Farm) -> Result<(Figures, Queue)> {
    farm.check()?;
    Ok(world::World::new(farm).run())
}
