//! Checking a store: every material complete, every image present, intact, and what it says it is.
//!
//! Reads only, and reads everything: digests are computed anew, every pixel is decoded, every
//! material's parameters are worked out from the seed. With a renderer a share of the images is
//! rendered again, byte for byte, and a black image is a fault where light must arrive.

use crate::{ImageFault, ReadOnlyStore, garbage};
use dataset::{CompletedView, Digest, ErrorStatistics, ImageHeader, PixelStatistics};
use imagestore::{
    FileError,
    validation::{Rejection, check_identity, decode, expected_headers},
};
use serde::Serialize;
use std::{
    fmt,
    path::PathBuf,
    sync::{
        Mutex, PoisonError,
        atomic::{AtomicU32, AtomicU64, Ordering},
    },
    thread,
};

/// Unnamed files that a report lists.
const UNNAMED_LISTED_MAX: usize = 1000;

/// Whoever can render the images of the store's specification again. A coordinator has no renderer;
/// the command lends one.
pub trait Rerender: Sync {
    /// Renders a view of a material of the set.
    ///
    /// # Errors
    /// Says why it cannot.
    fn render(&self, material: u32, view: u32) -> Result<Rerendered, String>;

    /// Whether some pixel of an image cannot be black. False where it may be, or is not known.
    fn must_be_lit(&self, material: u32, view: u32) -> bool;
}

/// An image that was rendered again.
#[derive(Clone, Debug, PartialEq)]
pub struct Rerendered {
    /// The EXR file.
    pub bytes: Vec<u8>,
    /// Its error and cost.
    pub statistics: ErrorStatistics,
    /// How bright it is.
    pub pixels: PixelStatistics,
}

/// What is checked, and how.
#[derive(Clone, Copy)]
pub struct Checks<'a> {
    /// Materials from 0 to one less.
    pub materials: u32,
    /// Threads that read, at least one.
    pub threads: usize,
    /// Who renders again, and knows where light must arrive.
    pub renderer: Option<&'a dyn Rerender>,
    /// The share of images that is rendered again, 0 to 1.
    pub rerender_share: f64,
    /// Chooses which: the same seed, the same images.
    pub rerender_seed: u64,
}

impl Checks<'_> {
    /// The checks of the first `materials` that need no renderer, with this many threads.
    pub fn without_renderer(materials: u32, threads: usize) -> Self {
        Self {
            materials,
            threads,
            renderer: None,
            rerender_share: 0.0,
            rerender_seed: 0,
        }
    }
}

/// In which way something is not as it should be.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum FaultKind {
    /// The material is not complete, or its record cannot be read.
    Incomplete,
    /// The material has another number of views than the specification.
    Views,
    /// The image's file is absent.
    Missing,
    /// The image's file cannot be read.
    Unreadable,
    /// The file has another size than is recorded.
    Size,
    /// The file has another digest than is recorded.
    Digest,
    /// The file is what is recorded, but no image of the dataset.
    Format,
    /// A pixel is not finite, or negative.
    Pixel,
    /// It is another image of this dataset or of another.
    Identity,
    /// It is black, and light must arrive.
    Black,
    /// It renders again to other bytes.
    Rerender,
    /// Its pixels have another brightness than is recorded, or it renders again to the same bytes, but
    /// with another error.
    Statistics,
}

impl FaultKind {
    /// Whether the recorded file itself is not the image that it should be, so that the record is
    /// wrong.
    pub fn condemns_the_record(self) -> bool {
        matches!(
            self,
            Self::Format
                | Self::Pixel
                | Self::Identity
                | Self::Black
                | Self::Rerender
                | Self::Statistics
        )
    }
}

/// Something that is not as it should be.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
pub struct Fault {
    /// The material's index.
    pub material: u32,
    /// The view's index; `None` where it is the whole material.
    pub view: Option<u32>,
    /// The file, where it is one.
    pub path: Option<PathBuf>,
    /// In which way.
    pub kind: FaultKind,
    /// What is wrong.
    pub what: String,
}

/// What a check found.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Report {
    /// Materials that were to be checked.
    pub materials: u32,
    /// Images without a fault.
    pub images_sound: u64,
    /// Bytes of them.
    pub bytes_sound: u64,
    /// Images that were rendered again.
    pub images_rerendered: u64,
    /// All faults, by material and view.
    pub faults: Vec<Fault>,
    /// Damaged lines of the completion log, or rows of the database.
    pub records_damaged: u64,
    /// Files among the images that no completed material names, the first of them. A coordinator at
    /// work may be about to name them; they are no fault.
    pub unnamed: Vec<PathBuf>,
    /// How many of those there are.
    pub unnamed_count: u64,
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

/// Checks a store. `progress` is told, from any thread, how many images have been looked at.
///
/// # Errors
/// When the folders of images cannot be listed; what is wrong with single images is reported.
pub fn verify(
    store: &ReadOnlyStore,
    checks: &Checks<'_>,
    progress: &(dyn Fn(u64) + Sync),
) -> Result<Report, FileError> {
    let next = AtomicU32::new(0);
    let looked_at = AtomicU64::new(0);
    let unnamed = garbage::unnamed(store)?;
    let report = Mutex::new(Report {
        materials: checks.materials,
        records_damaged: store.records_damaged(),
        unnamed_count: unnamed.len() as u64,
        unnamed: unnamed
            .into_iter()
            .take(UNNAMED_LISTED_MAX)
            .map(|file| file.path)
            .collect(),
        ..Report::default()
    });
    let work = || {
        loop {
            let material = next.fetch_add(1, Ordering::Relaxed);
            if material >= checks.materials {
                return;
            }
            let found = verify_material(store, material, checks);
            let views = store.specification().views.len() as u64;
            progress(looked_at.fetch_add(views, Ordering::Relaxed) + views);
            let mut report = report.lock().unwrap_or_else(PoisonError::into_inner);
            report.images_sound += found.images_sound;
            report.bytes_sound += found.bytes_sound;
            report.images_rerendered += found.images_rerendered;
            report.faults.extend(found.faults);
        }
    };
    thread::scope(|scope| {
        for _ in 1..checks.threads {
            scope.spawn(work);
        }
        work();
    });
    let mut report = report.into_inner().unwrap_or_else(PoisonError::into_inner);
    report.faults.sort();
    Ok(report)
}

fn verify_material(store: &ReadOnlyStore, material: u32, checks: &Checks<'_>) -> Report {
    let mut report = Report::default();
    let whole = |kind, what: String| Fault {
        material,
        view: None,
        path: None,
        kind,
        what,
    };
    let completion = match store.completion(material) {
        Ok(Some(completion)) => completion,
        Ok(None) => {
            let what = "it is not complete".to_owned();
            report.faults.push(whole(FaultKind::Incomplete, what));
            return report;
        }
        Err(error) => {
            let what = error.to_string();
            report.faults.push(whole(FaultKind::Incomplete, what));
            return report;
        }
    };
    let specification = store.specification();
    let expected = expected_headers(specification, store.specification_hash(), material);
    if completion.views.len() != expected.len() {
        let (found, expected) = (completion.views.len(), expected.len());
        let what = format!("it was completed with {found} views, and has {expected}");
        report.faults.push(whole(FaultKind::Views, what));
        return report;
    }
    let read = store.read_images(&completion.views);
    for ((view, header), read) in completion.views.iter().zip(&expected).zip(read) {
        let again = is_chosen(checks, material, header.view);
        report.images_rerendered += u64::from(again);
        let checked = verify_image(store, read, header).and_then(|pixels| {
            let lit = pixels.iter().any(|pixel| *pixel != [0.0; 3]);
            check_light(checks, material, header.view, lit)?;
            check_brightness(store, view, header.view, &pixels)?;
            match checks.renderer {
                Some(renderer) if again => render_again(renderer, material, header.view, view),
                _ => Ok(()),
            }
        });
        match checked {
            Ok(()) => {
                report.images_sound += 1;
                report.bytes_sound += view.bytes;
            }
            Err((kind, what)) => report.faults.push(Fault {
                material,
                view: Some(header.view),
                path: Some(store.image_path(&view.digest)),
                kind,
                what,
            }),
        }
    }
    report
}

/// Checks an image without a renderer and returns its pixels.
fn verify_image(
    store: &ReadOnlyStore,
    read: Result<Vec<u8>, ImageFault>,
    expected: &ImageHeader,
) -> Result<Vec<[f32; 3]>, (FaultKind, String)> {
    let bytes = read.map_err(|fault| {
        let kind = match fault {
            ImageFault::Missing => FaultKind::Missing,
            ImageFault::Unreadable(_) => FaultKind::Unreadable,
            ImageFault::Size { .. } => FaultKind::Size,
            ImageFault::Digest(_) => FaultKind::Digest,
        };
        (kind, fault.to_string())
    })?;
    let decoded = decode(&bytes, store.specification())
        .and_then(|decoded| check_identity(&decoded.header, expected).map(|()| decoded))
        .map_err(|rejection| {
            let kind = match rejection {
                Rejection::Pixel { .. } => FaultKind::Pixel,
                Rejection::Identity { .. } => FaultKind::Identity,
                _ => FaultKind::Format,
            };
            (kind, rejection.to_string())
        })?;
    Ok(decoded.pixels)
}

/// That what is recorded of an image's brightness is what its pixels say.
fn check_brightness(
    store: &ReadOnlyStore,
    done: &CompletedView,
    view: u32,
    pixels: &[[f32; 3]],
) -> Result<(), (FaultKind, String)> {
    let found = PixelStatistics::of(store.specification(), view, pixels.iter().copied());
    match (done.pixels, found) {
        (Some(recorded), Some(found)) if recorded != found => {
            let what = format!("its brightness is {found}; recorded is {recorded}");
            Err((FaultKind::Statistics, what))
        }
        _ => Ok(()),
    }
}

fn check_light(
    checks: &Checks<'_>,
    material: u32,
    view: u32,
    lit: bool,
) -> Result<(), (FaultKind, String)> {
    let must_be = |renderer: &dyn Rerender| renderer.must_be_lit(material, view);
    if lit || !checks.renderer.is_some_and(must_be) {
        return Ok(());
    }
    let what = "all of it is black, and light must arrive".to_owned();
    Err((FaultKind::Black, what))
}

/// Whether an image is of the share that is rendered again.
fn is_chosen(checks: &Checks<'_>, material: u32, view: u32) -> bool {
    if checks.renderer.is_none() || checks.rerender_share <= 0.0 {
        return false;
    }
    let mut key = checks.rerender_seed.to_le_bytes().to_vec();
    key.extend(material.to_le_bytes());
    key.extend(view.to_le_bytes());
    let digest = Digest::of(&key);
    let [a, b, c, d, ..] = *digest.as_bytes();
    let place = f64::from(u32::from_le_bytes([a, b, c, d])) / f64::from(u32::MAX);
    place <= checks.rerender_share
}

fn render_again(
    renderer: &dyn Rerender,
    material: u32,
    view: u32,
    done: &CompletedView,
) -> Result<(), (FaultKind, String)> {
    let again = renderer.render(material, view).map_err(|error| {
        (
            FaultKind::Rerender,
            format!("it cannot be rendered: {error}"),
        )
    })?;
    let digest = Digest::of(&again.bytes);
    if digest != done.digest {
        let what = format!("it renders again to the digest {digest}");
        return Err((FaultKind::Rerender, what));
    }
    if again.statistics != done.statistics {
        let what = format!(
            "its recorded error is {:?}, and it renders again with {:?}",
            done.statistics, again.statistics
        );
        return Err((FaultKind::Statistics, what));
    }
    Ok(())
}
