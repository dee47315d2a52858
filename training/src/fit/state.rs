//! What a checkpoint says of itself, and the log.

use crate::labels::PARAMETERS;
use serde::{Deserialize, Serialize};
use std::fmt::Write;

/// How far a stage has come.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct StageState {
    /// Epochs done.
    pub epoch: u32,
    /// Steps done.
    pub step: u64,
    /// The least mean excess on the validation split.
    pub best_excess: f64,
    /// After which epoch that was.
    pub best_epoch: u32,
}

/// A line of the log: an epoch.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct EpochLine {
    /// Which network.
    pub stage: String,
    /// Counted from 1.
    pub epoch: u32,
    /// Steps done.
    pub step: u64,
    /// The learning rate after them.
    pub rate: f64,
    /// Mean training loss of the epoch, with dropout, in nats.
    pub loss: f64,
    /// Mean over parameters of loss less entropy on the validation split, in nats.
    pub excess: f64,
    /// Parameters that the network tells.
    pub parameters: Vec<usize>,
    /// The excess of each of them.
    pub excesses: Vec<f64>,
}

/// The log as CSV. It has no times: two runs with the same options write the same bytes.
pub fn csv(lines: &[EpochLine], names: [&str; PARAMETERS]) -> String {
    let mut text = "stage,epoch,step,rate,loss,excess".to_owned();
    for name in names {
        text.push_str(",excess_");
        text.push_str(name);
    }
    text.push('\n');
    for line in lines {
        let EpochLine {
            stage,
            epoch,
            step,
            rate,
            loss,
            excess,
            ..
        } = line;
        // Writing to a string cannot fail.
        let _ = write!(
            text,
            "{stage},{epoch},{step},{rate:e},{loss:.6},{excess:.6}"
        );
        for parameter in 0..PARAMETERS {
            text.push(',');
            let place = line.parameters.iter().position(|&told| told == parameter);
            if let Some(excess) = place.and_then(|place| line.excesses.get(place)) {
                let _ = write!(text, "{excess:.6}");
            }
        }
        text.push('\n');
    }
    text
}
