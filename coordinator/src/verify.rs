//! Checking a store: every material complete, every image present, intact, and what it says it is.
//!
//! Reads only, and reads everything: digests are computed anew and every pixel is decoded.

use crate::{
    acceptance::{check_identity, expected_headers, inspect},
    store::ReadOnlyStore,
};
use dataset::{CompletedView, ImageHeader};
use std::{
    fmt,
    path::PathBuf,
    sync::{
        Mutex, PoisonError,
        atomic::{AtomicU32, AtomicU64, Ordering},
    },
    thread,
};

/// Something that is not as it should be.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Fault {
    /// The material's index.
    pub material: u32,
    /// The view's index; `None` where it is the whole material.
    pub view: Option<u32>,
    /// The file, where it is one.
    pub path: Option<PathBuf>,
    /// What is wrong.
    pub what: String,
}

/// What a check found.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Report {
    /// Materials that were to be checked.
    pub materials: u32,
    /// Images without a fault.
    pub images_sound: u64,
    /// Bytes of them.
    pub bytes_sound: u64,
    /// All faults, by material and view.
    pub faults: Vec<Fault>,
    /// Damaged lines of the completion log.
    pub log_lines_damaged: u64,
}

impl Report {
    /// Whether all of it is there, without a fault.
    pub fn is_sound(&self) -> bool {
        self.faults.is_empty()
    }
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "material {}", self.material)?;
        if let Some(view) = self.view {
            write!(f, ", view {view}")?;
        }
        if let Some(path) = &self.path {
            write!(f, ", {}", path.display())?;
        }
        write!(f, ": {}", self.what)
    }
}

/// Checks the first `materials` of a store with `threads` threads, at least one. `progress` is
/// told, from any of them, how many images have been looked at.
pub fn verify(
    store: &ReadOnlyStore,
    materials: u32,
    threads: usize,
    progress: &(dyn Fn(u64) + Sync),
) -> Report {
    let next = AtomicU32::new(0);
    let looked_at = AtomicU64::new(0);
    let report = Mutex::new(Report {
        materials,
        log_lines_damaged: store.log_lines_damaged(),
        ..Report::default()
    });
    let work = || {
        loop {
            let material = next.fetch_add(1, Ordering::Relaxed);
            if material >= materials {
                return;
            }
            let found = verify_material(store, material);
            let views = store.specification().views.len() as u64;
            progress(looked_at.fetch_add(views, Ordering::Relaxed) + views);
            let mut report = report.lock().unwrap_or_else(PoisonError::into_inner);
            report.images_sound += found.images_sound;
            report.bytes_sound += found.bytes_sound;
            report.faults.extend(found.faults);
        }
    };
    thread::scope(|scope| {
        for _ in 1..threads {
            scope.spawn(work);
        }
        work();
    });
    let mut report = report.into_inner().unwrap_or_else(PoisonError::into_inner);
    report.faults.sort();
    report
}

fn verify_material(store: &ReadOnlyStore, material: u32) -> Report {
    let mut report = Report::default();
    let completion = match store.completion(material) {
        Ok(Some(completion)) => completion,
        Ok(None) => {
            report.faults.push(whole(material, "it is not complete"));
            return report;
        }
        Err(error) => {
            report.faults.push(whole(material, error));
            return report;
        }
    };
    let specification = store.specification();
    let expected = expected_headers(specification, store.specification_hash(), material);
    if completion.views.len() != expected.len() {
        let (found, expected) = (completion.views.len(), expected.len());
        let what = format!("it was completed with {found} views, and has {expected}");
        report.faults.push(whole(material, what));
        return report;
    }
    for (view, header) in completion.views.iter().zip(&expected) {
        match verify_image(store, view, header) {
            Ok(()) => {
                report.images_sound += 1;
                report.bytes_sound += view.bytes;
            }
            Err(what) => report.faults.push(Fault {
                material,
                view: Some(header.view),
                path: Some(store.image_path(&view.digest)),
                what,
            }),
        }
    }
    report
}

fn verify_image(
    store: &ReadOnlyStore,
    view: &CompletedView,
    expected: &ImageHeader,
) -> Result<(), String> {
    let bytes = store.read_image(view)?;
    inspect(&bytes, &store.specification().image)
        .and_then(|header| check_identity(&header, expected))
        .map_err(|rejection| rejection.to_string())
}

fn whole(material: u32, what: impl ToString) -> Fault {
    Fault {
        material,
        view: None,
        path: None,
        what: what.to_string(),
    }
}
