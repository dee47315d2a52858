//! The CNNs of another training, taken instead of trained again.
//!
//! A CNN depends on no block and on no other CNN, so variants that have the same one train it to the
//! same bytes.

use super::checkpoint::{Checkpoints, State, difference};
use super::options::Options;
use super::stage_name::CNN_NAMES;
use crate::error::{TrainingError, bad_input};
use std::path::Path;

/// The CNNs of a training in the order of its stages.
fn cnns(options: &Options) -> Vec<&'static str> {
    let there = CNN_NAMES.into_iter().zip(options.variant.trunks());
    there
        .filter_map(|(name, there)| there.then_some(name))
        .collect()
}

/// Takes the CNNs that a new training, `state`, begins with from the training in the folder `from`.
pub(super) fn take_cnns(
    from: &Path,
    to: &Checkpoints,
    state: &mut State,
) -> Result<(), TrainingError> {
    let refuse = |reason: String| bad_input(from, reason);
    let from = Checkpoints::of(from);
    let theirs = from
        .read_state()?
        .ok_or_else(|| refuse("there is no training in this folder".to_owned()))?;
    if theirs.options.variant.weights() != state.options.variant.weights() {
        let variant = theirs.options.variant.name();
        return Err(refuse(format!(
            "the CNNs of {variant} learn with other weights"
        )));
    }
    let mut same = theirs.clone();
    same.options.variant = state.options.variant;
    same.options.block_epochs = state.options.block_epochs;
    if let Some(difference) = difference(&same, state)? {
        return Err(refuse(format!("its CNNs are other ones, {difference}")));
    }
    // All or none: what is taken is written at once.
    let finished = cnns(&theirs.options);
    let places = cnns(&state.options).into_iter().map(|name| {
        let place = finished.iter().position(|other| *other == name);
        let place = place.map(|place| place as u32);
        let place = place.filter(|place| *place < theirs.finished);
        let place = place.ok_or_else(|| refuse(format!("the training has not finished {name}")));
        place.map(|place| (name, place))
    });
    for (name, place) in places.collect::<Result<Vec<_>, _>>()? {
        let lines = theirs.log.iter().filter(|line| line.stage == name);
        state.log.extend(lines.cloned());
        to.finish_stage(state, &from.read_finished(place)?)?;
    }
    Ok(())
}
