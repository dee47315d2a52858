//! Materials on their way into a store: checked together, made durable together.

use super::{ImportError, Imported, Wanted};
use dataset::{Digest, PixelStatistics, Specification};
use datastore::WritableStore;
use imagestore::validation::{check_digest, check_identity, decode, expected_headers};
use jobqueue::Completion;
use std::{
    sync::{Mutex, PoisonError},
    thread,
};

/// Who imported materials are recorded as rendered by: the manifest does not say.
const WORKER: &str = "import";

/// An image with its file.
type Image = (Wanted, Vec<u8>);

/// Materials that are checked and stored together.
#[derive(Default)]
pub(super) struct Batch {
    pub materials: Vec<(u32, Vec<Image>)>,
    pub bytes: u64,
}

impl Batch {
    pub fn images(&self) -> u64 {
        self.materials
            .iter()
            .map(|(_, images)| images.len() as u64)
            .sum()
    }

    pub fn add(&mut self, material: u32, wanted: &[Wanted], files: Vec<Vec<u8>>) {
        self.bytes += files.iter().map(|file| file.len() as u64).sum::<u64>();
        let images = wanted.iter().cloned().zip(files).collect();
        self.materials.push((material, images));
    }

    /// Checks all images, notes their brightness, and makes them durable. Leaves the batch empty. What
    /// somebody else completed meanwhile counts as having been there.
    pub fn store(
        &mut self,
        specification: &Specification,
        store: &mut WritableStore,
        threads: usize,
    ) -> Result<Imported, ImportError> {
        self.check(specification, threads)?;
        let mut completions = Vec::with_capacity(self.materials.len());
        let mut images: Vec<(Digest, Vec<u8>)> = Vec::new();
        for (material, views) in self.materials.drain(..) {
            completions.push(Completion {
                material,
                views: views
                    .iter()
                    .map(|(wanted, _)| wanted.done.clone())
                    .collect(),
                seconds: 0.0,
                worker: WORKER.to_owned(),
            });
            images.extend(
                views
                    .into_iter()
                    .map(|(wanted, file)| (wanted.done.digest, file)),
            );
        }
        self.bytes = 0;
        let added = store.add(&completions, &images)?;
        let mut imported = Imported::default();
        for (completion, added) in completions.iter().zip(added) {
            if added {
                imported.materials += 1;
                imported.images += completion.views.len() as u64;
            } else {
                imported.materials_there += 1;
            }
        }
        Ok(imported)
    }

    fn check(&mut self, specification: &Specification, threads: usize) -> Result<(), ImportError> {
        let share = self.materials.len().div_ceil(threads.max(1)).max(1);
        let failure: Mutex<Option<ImportError>> = Mutex::new(None);
        thread::scope(|scope| {
            for part in self.materials.chunks_mut(share) {
                let failure = &failure;
                scope.spawn(move || {
                    let checked = part
                        .iter_mut()
                        .try_for_each(|(material, images)| check(specification, *material, images));
                    if let Err(error) = checked {
                        let mut failure = failure.lock().unwrap_or_else(PoisonError::into_inner);
                        failure.get_or_insert(error);
                    }
                });
            }
        });
        let failure = failure.into_inner().unwrap_or_else(PoisonError::into_inner);
        failure.map_or(Ok(()), Err)
    }
}

fn check(
    specification: &Specification,
    material: u32,
    images: &mut [Image],
) -> Result<(), ImportError> {
    let expected = expected_headers(specification, specification.hash(), material);
    for ((wanted, file), header) in images.iter_mut().zip(&expected) {
        let wrong = |what: String| ImportError::Image {
            path: wanted.path.clone(),
            material,
            view: header.view,
            what,
        };
        if file.len() as u64 != wanted.done.bytes {
            return Err(wrong(format!("it has not {} bytes", wanted.done.bytes)));
        }
        let decoded = check_digest(file, wanted.done.digest)
            .and_then(|()| decode(file, specification))
            .and_then(|found| check_identity(&found.header, header).map(|()| found))
            .map_err(|rejection| wrong(rejection.to_string()))?;
        let found = PixelStatistics::of(specification, header.view, decoded.pixels.iter().copied());
        if let (Some(told), Some(found)) = (wanted.done.pixels, found)
            && told != found
        {
            let what = format!("its brightness is {found}; its row says {told}");
            return Err(wrong(what));
        }
        wanted.done.pixels = found;
    }
    Ok(())
}
