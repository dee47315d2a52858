//! One case: rendered, compared with itself and with the reference.

use crate::case::Case;
use crate::draw::Random;
use crate::reference::{Estimate, Reference};
use dataset::Specification;
use rayon::prelude::*;
use renderer::{
    RenderError, Renderer, Rendering,
    film::{Film, FilmPixel, target},
    geometry::BackendChoice,
    reflectance::Reflectance,
    scene::Scene,
    vector::Vec3,
};
use rustix::time::{ClockId, clock_gettime};
use std::fmt;

/// By which comparison a pixel failed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Kind {
    /// Against the sampled reference.
    Reference,
    /// Against the mean of the pixels of a finer film.
    Resolution,
    /// Against a rendering to a smaller tolerance.
    Accuracy,
    /// The path tracer's rendering against the reference: its bound is statistical.
    Path,
    /// The renderer gave no image, or panicked.
    Broken,
}

/// A pixel beyond its bound.
#[derive(Clone, Debug)]
pub struct Finding {
    pub kind: Kind,
    pub pixel: [u32; 2],
    pub found: [f64; 3],
    pub expected: [f64; 3],
    /// The reference's standard error, or what the other rendering states.
    pub spread: f64,
    pub stated: f64,
    /// What the difference had to stay below, without the spread.
    pub limit: f64,
    /// How many limits it is off by, beyond the spread.
    pub excess: f64,
    pub note: String,
}

impl fmt::Display for Finding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{:?}: pixel {:?}: {:?} against {:?} +- {:.1e}; stated {:.1e}, limit {:.1e}, beyond it \
             by a factor of {:.1}{}",
            self.kind,
            self.pixel,
            self.found,
            self.expected,
            self.spread,
            self.stated,
            self.limit,
            self.excess,
            self.note
        )
    }
}

/// What came of a case.
#[derive(Clone, Debug, Default)]
pub struct Outcome {
    /// Whether the hybrid integrator made the image.
    pub hybrid: bool,
    /// Pixels compared with the reference.
    pub compared: usize,
    /// Of these, pixels whose reference is coarser than their limit.
    pub coarse: usize,
    /// Processor seconds of the rendering.
    pub seconds: f64,
    pub findings: Vec<Finding>,
}

/// How far a case is looked into.
#[derive(Clone, Copy, Debug)]
pub struct Effort {
    /// Pixels compared with the reference.
    pub pixels_max: usize,
    /// The most samples in a replicate of the reference.
    pub samples_max: u32,
    /// The finer renderings that are made: [`Kind::Resolution`], [`Kind::Accuracy`].
    pub finer: &'static [Kind],
}

/// Samples in a replicate to begin with, and by how many times they grow.
const SAMPLES_MIN: u32 = 64;
const SAMPLES_GROW: u32 = 4;

/// A difference is real from this many standard errors on.
const SURE: f64 = 5.0;

/// Within this many it may be none.
const UNSURE: f64 = 2.0;

/// A pixel that the rendering found brighter gets up to this many samples a replicate: the reference may
/// have missed what few paths carry.
const SAMPLES_FOR_RARE: u32 = 1 << 18;

/// Images that took longer are not rendered any finer, processor seconds.
const SECONDS_FOR_FINER: f64 = 2.0;

/// Pixels of a finer film, at most.
const FINER_PIXELS_MAX: u32 = 1 << 12;

/// The tolerance of the finer rendering.
const TIGHTER: f64 = 30.0;

/// Stated errors of the path tracer hold in 95 of 100 pixels. Three times as much holds in all but 1
/// in 5,000.
const SAMPLED_SLACK: f64 = 3.0;

/// A pixel beyond that is traced again by other paths, so many times. It counts if so many of these are beyond what
/// they state, too: where 95 of 100 are not, 1.4 percent of such pixels do.
const TRACED_AGAIN: u64 = 4;
const BEYOND_AGAIN: usize = 2;

/// Renders and compares.
pub fn examine(case: &Case, effort: Effort) -> Outcome {
    let (rendering, seconds) = timed(|| render(&case.specification, case));
    let mut outcome = Outcome {
        seconds,
        ..Outcome::default()
    };
    let rendering = match rendering {
        Ok(rendering) => rendering,
        Err(error) => {
            outcome.findings.push(broken(&error));
            return outcome;
        }
    };
    outcome.hybrid = rendering.statistics.samples == 0;
    let reflectance = Reflectance::new(
        &case.material,
        case.specification.views[0].rotation_deg,
        case.specification.tint,
    );
    let film = &rendering.film;
    if outcome.hybrid && seconds < SECONDS_FOR_FINER {
        let limit = limit(1.0);
        for &kind in effort.finer {
            match finer(case, film, kind, &limit) {
                Ok(Some(finding)) => outcome.findings.push(finding),
                Ok(None) => {}
                Err(error) => outcome.findings.push(broken(&error)),
            }
        }
    }
    let reference = Reference::new(&case.specification, reflectance);
    let limit = limit(if outcome.hybrid { 1.0 } else { SAMPLED_SLACK });
    compare_pixels(case, film, &reference, &limit, effort, &mut outcome);
    if !outcome.hybrid {
        let again = |finding: &Finding| is_beyond_again(case, finding);
        outcome.findings.retain(again);
    }
    outcome
}

/// Whether a pixel of the path tracer's is beyond what it states by other paths, too.
fn is_beyond_again(case: &Case, finding: &Finding) -> bool {
    let is_beyond = |again: &u64| {
        let mut specification = case.specification.clone();
        specification.seed ^= again;
        let rendering = render(&specification, case).expect("it was rendered before");
        let pixel = at(&rendering.film, finding.pixel);
        let allowed = limit(1.0)(&specification, &pixel) + SURE * finding.spread;
        let pairs = pixel.value.into_iter().zip(finding.expected);
        pairs.fold(0.0, |most: f64, (found, expected)| {
            most.max((found - expected).abs())
        }) > allowed
    };
    (1..=TRACED_AGAIN).filter(is_beyond).count() >= BEYOND_AGAIN
}

/// What a pixel may be off by: its target, or `slack` times its stated error where that is more.
fn limit(slack: f64) -> impl Fn(&Specification, &FilmPixel) -> f64 + Sync {
    move |specification, pixel| {
        let stated = slack * pixel.error;
        target(&specification.accuracy, pixel.value).max(stated)
    }
}

/// Compares some pixels with the reference, among them those in which the finer renderings found
/// something.
fn compare_pixels(
    case: &Case,
    film: &Film,
    reference: &Reference,
    limit: &(impl Fn(&Specification, &FilmPixel) -> f64 + Sync),
    effort: Effort,
    outcome: &mut Outcome,
) {
    let mut pixels = chosen(case, film, &reference.scene, effort.pixels_max);
    for finding in &outcome.findings {
        if !pixels.contains(&finding.pixel) {
            pixels.push(finding.pixel);
        }
    }
    let compared: Vec<(Option<Finding>, bool)> = pixels
        .par_iter()
        .map(|&index| {
            let pixel = at(film, index);
            let limit = limit(&case.specification, &pixel);
            let suspect = outcome.findings.iter().any(|one| one.pixel == index);
            let samples_max = effort.samples_max;
            compare(reference, index, &pixel, limit, samples_max, suspect)
        })
        .collect();
    outcome.compared = pixels.len();
    for finding in &mut outcome.findings {
        let order = pixels.iter().position(|index| *index == finding.pixel);
        finding.note += match order.map(|order| &compared[order]) {
            Some((None, false)) => "; the reference agrees with this rendering, not the finer one",
            Some((None, true)) => "; the reference is too coarse to tell which is off",
            _ => "",
        };
    }
    let kind = if outcome.hybrid {
        Kind::Reference
    } else {
        Kind::Path
    };
    for (finding, coarse) in compared {
        outcome.coarse += usize::from(coarse);
        let finding = finding.map(|finding| Finding { kind, ..finding });
        outcome.findings.extend(finding);
    }
}

/// The image, as `brdfarm render` makes it.
pub fn render(specification: &Specification, case: &Case) -> Result<Rendering, RenderError> {
    Renderer::new(specification, BackendChoice::Native)?.render(&case.material, None, 0)
}

/// What a function gives, and the processor seconds of this thread: all there are where rayon's pool
/// has it alone.
pub fn timed<T>(work: impl FnOnce() -> T) -> (T, f64) {
    let start = seconds(ClockId::ThreadCPUTime);
    let result = work();
    (result, seconds(ClockId::ThreadCPUTime) - start)
}

/// What a clock shows.
pub fn seconds(clock: ClockId) -> f64 {
    let time = clock_gettime(clock);
    time.tv_sec as f64 + 1e-9 * time.tv_nsec as f64
}

fn broken(error: &RenderError) -> Finding {
    Finding {
        kind: Kind::Broken,
        pixel: [0; 2],
        found: [0.0; 3],
        expected: [0.0; 3],
        spread: 0.0,
        stated: 0.0,
        limit: 0.0,
        excess: 0.0,
        note: format!(": {error}"),
    }
}

fn at(film: &Film, [column, row]: [u32; 2]) -> FilmPixel {
    film.pixels[(row * film.width + column) as usize]
}

fn indices(film: &Film) -> impl Iterator<Item = [u32; 2]> + use<> {
    let (width, height) = (film.width, film.height);
    (0..height).flat_map(move |row| (0..width).map(move |column| [column, row]))
}

/// A finer specification of this kind, how many times finer its film is, and what to say of it;
/// `None` where it would take too long.
fn finer_specification(
    case: &Case,
    film: &Film,
    kind: Kind,
) -> Option<(Specification, u32, String)> {
    let count = film.width * film.height;
    if kind == Kind::Resolution {
        let fits = |factor: &u32| {
            count * factor * factor <= FINER_PIXELS_MAX && film.width.max(film.height) <= 256
        };
        let factor = [16, 8, 4, 2].into_iter().find(fits)?;
        let note = format!("; a film {factor} times finer");
        return Some((case.magnified(factor), factor, note));
    }
    let tolerance = &case.specification.accuracy;
    let fine = tolerance.absolute.max(tolerance.relative) < 1e-4;
    if count > FINER_PIXELS_MAX / if fine { 64 } else { 2 } {
        return None;
    }
    let specification = case.tightened(TIGHTER);
    let tolerance = &specification.accuracy;
    let (absolute, relative) = (tolerance.absolute, tolerance.relative);
    let note = format!("; accuracy.absolute {absolute}, relative {relative}");
    Some((specification, 1, note))
}

/// The pixel that is the most limits away from a finer rendering, if any is beyond both errors.
fn finer(
    case: &Case,
    film: &Film,
    kind: Kind,
    limit: &impl Fn(&Specification, &FilmPixel) -> f64,
) -> Result<Option<Finding>, RenderError> {
    let Some((specification, factor, note)) = finer_specification(case, film, kind) else {
        return Ok(None);
    };
    let other = render(&specification, case)?;
    // Stated errors of the path tracer hold in most pixels, not in all.
    if other.statistics.samples > 0 {
        return Ok(None);
    }
    let other = other.film;
    let mut worst: Option<Finding> = None;
    for index in indices(film) {
        let pixel = at(film, index);
        let (mut expected, mut spread) = ([0.0; 3], 0.0);
        let share = 1.0 / f64::from(factor * factor);
        for row in 0..factor {
            for column in 0..factor {
                let part = [column, row];
                let part = at(&other, [0, 1].map(|axis| index[axis] * factor + part[axis]));
                for (sum, value) in expected.iter_mut().zip(part.value) {
                    *sum += share * value;
                }
                spread += share * limit(&specification, &part);
            }
        }
        let limit = limit(&case.specification, &pixel);
        let off = (0..3)
            .map(|i| (pixel.value[i] - expected[i]).abs())
            .fold(0.0, f64::max);
        let excess = (off - spread) / limit;
        if excess > 1.0 && worst.as_ref().is_none_or(|worst| excess > worst.excess) {
            worst = Some(Finding {
                kind,
                pixel: index,
                found: pixel.value,
                expected,
                spread,
                stated: pixel.error,
                limit,
                excess,
                note: note.clone(),
            });
        }
    }
    Ok(worst)
}

/// The pixels to compare: all of a small film; of a larger one the brightest, those that see the
/// bulb's mirror image, and some on outlines and anywhere.
fn chosen(case: &Case, film: &Film, scene: &Scene, most: usize) -> Vec<[u32; 2]> {
    let all: Vec<[u32; 2]> = indices(film).collect();
    if all.len() <= most {
        return all;
    }
    let mut random = Random::of_variation(u64::from(film.width) << 16 | u64::from(film.height));
    let mut chosen: Vec<[u32; 2]> = Vec::new();
    let take = |chosen: &mut Vec<[u32; 2]>, index: [u32; 2]| {
        if !chosen.contains(&index) && chosen.len() < most {
            chosen.push(index);
        }
    };
    let sees = |point: Vec3| {
        let film_point = scene.camera.project(point)?;
        let [width, height] = [film.width, film.height].map(f64::from);
        let [column, row] = film_point;
        ((0.0..width).contains(&column) && (0.0..height).contains(&row))
            .then_some([column as u32, row as u32])
    };
    let (camera, bulb) = (scene.camera.position, scene.bulb.centre);
    let mut mirrored = camera + (bulb - camera) * (camera.z / (camera.z + bulb.z));
    mirrored.z = 0.0;
    if let Some(index) = sees(mirrored) {
        take(&mut chosen, index);
    }
    let brightness = |index: &[u32; 2]| at(film, *index).value.into_iter().fold(0.0, f64::max);
    let brightest = all
        .iter()
        .max_by(|a, b| brightness(a).total_cmp(&brightness(b)));
    if let Some(&index) = brightest {
        take(&mut chosen, index);
    }
    let half = 0.5 * case.specification.sample.side_m;
    let mut outlines = vec![[
        Vec3::new(-half, -half, 0.0),
        Vec3::new(half, -half, 0.0),
        Vec3::new(half, half, 0.0),
        Vec3::new(-half, half, 0.0),
    ]];
    if let Some(chart) = &scene.chart {
        let plane = chart.plane();
        let [width, height] = plane.size();
        let corners = [[0.0, 0.0], [width, 0.0], [width, height], [0.0, height]];
        outlines.push(corners.map(|[a, b]| plane.point(a, b)));
    }
    for _ in 0..4 * most {
        if 2 * chosen.len() >= most {
            break;
        }
        for corners in &outlines {
            let edge = (random.uniform(0.0, 4.0) as usize).min(3);
            let (from, to) = (corners[edge], corners[(edge + 1) % 4]);
            if let Some(index) = sees(from + (to - from) * random.uniform(0.0, 1.0)) {
                take(&mut chosen, index);
            }
        }
    }
    for attempt in 0..8 * most {
        let index = random.one_of(&all);
        // Most of a film may be black: after some attempts anything will do.
        if brightness(&index) > 0.0 || attempt > 4 * most {
            take(&mut chosen, index);
        }
    }
    chosen
}

/// Compares a pixel with the reference, whose samples grow while it is undecided. A difference
/// counts when other scrambles of more samples confirm it, and no sample can have missed the light
/// that only the rendering has. Also whether the reference stayed coarser than the limit, which is
/// put up with unless the pixel is `suspect`.
fn compare(
    reference: &Reference,
    index: [u32; 2],
    pixel: &FilmPixel,
    limit: f64,
    samples_max: u32,
    suspect: bool,
) -> (Option<Finding>, bool) {
    let mut samples = SAMPLES_MIN;
    let mut seen_before = false;
    loop {
        let estimate = reference.pixel(index, samples, u64::from(samples));
        let (above, spread, expected) = worst_channel(pixel, &estimate, limit);
        let off = above.abs();
        let beyond = off > limit + SURE * spread;
        let unseen = above - limit - SURE * spread < reference.unseen(samples);
        if beyond && above > 0.0 && unseen {
            if samples >= SAMPLES_FOR_RARE {
                return (None, true);
            }
            seen_before = true;
            samples *= SAMPLES_GROW;
            continue;
        }
        if beyond && (seen_before || samples >= samples_max) {
            let finding = Finding {
                kind: Kind::Reference,
                pixel: index,
                found: pixel.value,
                expected,
                spread,
                stated: pixel.error,
                limit,
                excess: (off - SURE * spread) / limit,
                note: format!("; {samples} samples a replicate"),
            };
            return (Some(finding), false);
        }
        let undecided = beyond || off > limit + UNSURE * spread;
        let blunt = SURE * spread > limit;
        let sharper = blunt && (suspect || samples < SAMPLES_GROW * SAMPLES_MIN);
        if samples >= samples_max || !(undecided || sharper) {
            return (None, blunt);
        }
        seen_before = beyond;
        samples *= SAMPLES_GROW;
    }
}

/// The channel that is farthest beyond its limit: how far above the reference, the standard error,
/// and the means.
fn worst_channel(pixel: &FilmPixel, estimate: &Estimate, limit: f64) -> (f64, f64, [f64; 3]) {
    let expected = estimate.map(|(mean, _)| mean);
    let (mut worst, mut most) = ((0.0, 0.0), f64::NEG_INFINITY);
    for (found, (mean, spread)) in pixel.value.into_iter().zip(estimate) {
        let above = found - mean;
        let beyond = above.abs() - limit - SURE * spread;
        if beyond > most {
            (worst, most) = ((above, *spread), beyond);
        }
    }
    (worst.0, worst.1, expected)
}
