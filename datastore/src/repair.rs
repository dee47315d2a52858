//! Mending a store: what `verify` finds is rendered again.
//!
//! An image that is missing or damaged must come out with the digest that is recorded. Where the
//! record itself is at fault it is corrected: when the file that it names is intact and no image of
//! the dataset, or, of a store in a folder, when log and ledger disagree and the renderer settles
//! it, or when an intact image of the dataset renders again to another: what this machine renders is
//! the truth of its renderer version, and whoever delivered something else is named. Nothing else is
//! changed; what cannot be mended is reported.

use crate::{
    StoreError, WritableStore,
    verify::{Checks, Fault, FaultKind, Rerender, Rerendered, verify},
};
use dataset::{CompletedView, Digest, Specification};
use imagestore::validation;
use jobqueue::Completion;
use serde::Serialize;
use std::collections::BTreeMap;

/// What became of a fault.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case", tag = "outcome", content = "why")]
pub enum Outcome {
    /// The image is there again, with the digest that was recorded.
    Restored,
    /// The image is there, and the record, which was wrong, names it.
    Corrected,
    /// Nothing was changed.
    Failed(String),
}

/// A fault and what became of it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Repair {
    /// What was wrong.
    pub fault: Fault,
    /// What became of it.
    #[serde(flatten)]
    pub outcome: Outcome,
    /// The full name of the worker that delivered what renders to something else, images or
    /// statistics. All that it delivered is in doubt.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub delivered_by: Option<String>,
}

/// Checks a store and mends what can be mended; `checks` has to have a renderer. `progress` is told
/// how many images have been looked at, and `mending` how many faults were dealt with, of how many.
///
/// # Errors
/// When the store cannot be written. What was mended before stays so.
pub fn repair(
    store: &mut WritableStore,
    checks: &Checks<'_>,
    renderer: &dyn Rerender,
    progress: &(dyn Fn(u64) + Sync),
    mending: &dyn Fn(usize, usize),
) -> Result<Vec<Repair>, StoreError> {
    let reader = store.read()?;
    let report = verify(&reader, checks, progress)?;
    let faults = report.faults.len();
    let mut by_material: BTreeMap<u32, Vec<Fault>> = BTreeMap::new();
    for fault in report.faults {
        by_material.entry(fault.material).or_default().push(fault);
    }
    let mut repairs = Vec::new();
    for (material, faults_there) in by_material {
        match reader.completion(material)? {
            Some(completion) => {
                let material = Material {
                    renderer,
                    specification: reader.specification(),
                    before: completion,
                };
                mend_material(store, material, faults_there, &mut repairs)?;
            }
            None => repairs.extend(faults_there.into_iter().map(|fault| Repair {
                fault,
                outcome: Outcome::Failed(
                    "nothing is recorded of it: `brdfarm run` renders it".to_owned(),
                ),
                delivered_by: None,
            })),
        }
        mending(repairs.len(), faults);
    }
    Ok(repairs)
}

/// A material with faults, and what it is mended with.
struct Material<'a> {
    renderer: &'a dyn Rerender,
    specification: &'a Specification,
    before: Completion,
}

fn mend_material(
    store: &mut WritableStore,
    material: Material<'_>,
    faults: Vec<Fault>,
    repairs: &mut Vec<Repair>,
) -> Result<(), StoreError> {
    let Material {
        renderer,
        specification,
        before,
    } = material;
    // A second record, which a store in a database does not have.
    let in_ledger = match store {
        WritableStore::Folder(store) => store.completion_in_ledger(before.material)?,
        WritableStore::Database(_) => None,
    };
    let mut completion = before.clone();
    let mut images: Vec<(Digest, Vec<u8>)> = Vec::new();
    let mut mended = Vec::new();
    for fault in faults {
        let outcome = match fault.view {
            Some(view) => {
                let other = in_ledger.as_ref().and_then(|c| c.views.get(view as usize));
                let recorded = &mut completion.views[view as usize];
                match renderer.render(completion.material, view) {
                    Ok(again) => match is_image(&again.bytes, fault.kind, specification) {
                        Ok(()) => settle(fault.kind, recorded, other, again, &mut images),
                        Err(why) => Outcome::Failed(why),
                    },
                    Err(error) => Outcome::Failed(format!("it cannot be rendered: {error}")),
                }
            }
            None => Outcome::Failed("its record fits another specification".to_owned()),
        };
        let lied = matches!(fault.kind, FaultKind::Rerender | FaultKind::Statistics)
            && outcome == Outcome::Corrected;
        mended.push(Repair {
            delivered_by: lied.then(|| before.worker.clone()),
            fault,
            outcome,
        });
    }
    if !store.mend(&before, &completion, &images)? {
        for repair in &mut mended {
            if repair.outcome == Outcome::Corrected {
                let why = "it was completed anew meanwhile: verify again";
                repair.outcome = Outcome::Failed(why.to_owned());
            }
        }
    }
    repairs.extend(mended);
    Ok(())
}

/// That what was rendered again can take the place of an intact image.
fn is_image(bytes: &[u8], kind: FaultKind, specification: &Specification) -> Result<(), String> {
    if kind != FaultKind::Rerender {
        return Ok(());
    }
    let decoded = validation::decode(bytes, specification);
    let why =
        |rejection| format!("what it renders again to is no image of this dataset: {rejection}");
    decoded.map(|_| ()).map_err(why)
}

/// Compares an image that was rendered again with its record, and decides.
fn settle(
    kind: FaultKind,
    recorded: &mut CompletedView,
    in_ledger: Option<&CompletedView>,
    again: Rerendered,
    images: &mut Vec<(Digest, Vec<u8>)>,
) -> Outcome {
    let true_view = CompletedView {
        digest: Digest::of(&again.bytes),
        bytes: again.bytes.len() as u64,
        statistics: again.statistics,
        pixels: Some(again.pixels),
    };
    let as_recorded = true_view.digest == recorded.digest;
    let in_ledger = in_ledger.is_some_and(|view| view.digest == true_view.digest);
    if kind == FaultKind::Black && as_recorded {
        return Outcome::Failed("it renders again to the same black image".to_owned());
    }
    if !(as_recorded || in_ledger || kind.condemns_the_record()) {
        return Outcome::Failed(format!(
            "it renders again to the digest {}, and {} is recorded",
            true_view.digest, recorded.digest
        ));
    }
    images.push((true_view.digest, again.bytes));
    if *recorded == true_view {
        return Outcome::Restored;
    }
    *recorded = true_view;
    Outcome::Corrected
}
