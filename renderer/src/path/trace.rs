//! Tracing a film, some paths a pixel.

use super::counts::Counts;
use super::interval::{self, REPLICATES};
use super::{Scratch, TracedFilm, Tracer};
use crate::film::{Film, FilmPixel};
use crate::sampler::Sampler;
use dataset::Specification;
use rayon::prelude::*;

/// The film that is traced. `key` names the image.
#[derive(Clone, Copy, Debug)]
pub struct Picture {
    pub width: usize,
    pub height: u32,
    key: u64,
}

impl Picture {
    /// The film of a specification.
    pub fn new(specification: &Specification, key: u64) -> Self {
        Self {
            width: specification.image.width as usize,
            height: specification.image.height,
            key,
        }
    }

    /// How many pixels it has.
    pub fn pixels(&self) -> usize {
        self.width * self.height as usize
    }

    /// Traces all of it.
    pub fn trace(&self, tracer: &Tracer<'_>, counts: &Counts) -> TracedFilm {
        let mut known = Traced::nothing(self.pixels());
        let spent = trace(tracer, self, 0, &mut known, |index| counts.of_pixels[index]);
        TracedFilm {
            film: Film {
                width: self.width as u32,
                height: self.height,
                pixels: known.with_unseen(self.width),
            },
            paths: counts.spent.paths + spent.paths,
            evaluations: counts.spent.evaluations + spent.evaluations,
        }
    }
}

/// What tracing took.
#[derive(Clone, Copy, Debug, Default)]
pub struct Spent {
    pub paths: u64,
    pub evaluations: u64,
}

impl std::ops::Add for Spent {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self {
            paths: self.paths + other.paths,
            evaluations: self.evaluations + other.evaluations,
        }
    }
}

impl std::iter::Sum for Spent {
    fn sum<I: Iterator<Item = Self>>(all: I) -> Self {
        all.fold(Self::default(), |sum, one| sum + one)
    }
}

/// A pixel that was traced.
#[derive(Clone, Copy, Debug, Default)]
struct TracedPixel {
    film: FilmPixel,
    /// What the pixel sees: the number of surfaces.
    parts: u8,
    /// Paths to each of them.
    paths: u32,
}

/// What is known of a film.
pub struct Traced(Vec<TracedPixel>);

impl Traced {
    /// A film of `count` pixels of which nothing is known.
    pub fn nothing(count: usize) -> Self {
        Self(vec![TracedPixel::default(); count])
    }

    /// The pixels, with what they may miss of features that their neighbours show.
    pub fn with_unseen(&self, width: usize) -> Vec<FilmPixel> {
        let mut pixels: Vec<FilmPixel> = self.0.iter().map(|pixel| pixel.film).collect();
        let paths = |index: usize| match self.0[index] {
            TracedPixel { parts: 0, .. } => None,
            TracedPixel { paths, .. } => Some(paths),
        };
        interval::add_unseen(&mut pixels, width, paths);
        pixels
    }
}

/// Traces each pixel by as many paths to each thing it sees as `paths` says of its index, a multiple of
/// the replicates, and leaves those with none as they are. Replicates are counted from `first`: others
/// are independent.
pub fn trace(
    tracer: &Tracer<'_>,
    picture: &Picture,
    first: u32,
    known: &mut Traced,
    paths: impl Fn(usize) -> u32 + Sync,
) -> Spent {
    let lines = known.0.par_chunks_mut(picture.width);
    let of_lines = lines.zip(0..picture.height).map(|(line, row)| {
        let mut spent = Spent::default();
        for (pixel, column) in line.iter_mut().zip(0..) {
            let paths = paths(row as usize * picture.width + column as usize);
            if paths > 0 {
                let (traced, of_pixel) = traced(tracer, picture, [column, row], first, paths);
                *pixel = traced;
                spent = spent + of_pixel;
            }
        }
        spent
    });
    of_lines.sum()
}

fn traced(
    tracer: &Tracer<'_>,
    picture: &Picture,
    [column, row]: [u32; 2],
    first: u32,
    paths: u32,
) -> (TracedPixel, Spent) {
    let footprint = tracer.footprint(column, row);
    let mut means = [[0.0; 3]; REPLICATES as usize];
    let mut scratch = Scratch::default();
    let pixel = row * picture.width as u32 + column;
    for (replicate, mean) in (first..).zip(&mut means) {
        let sampler = Sampler::new(picture.key, pixel, replicate);
        *mean = tracer.trace(&footprint, &sampler, paths / REPLICATES, &mut scratch);
    }
    let unseen = tracer.bulb_gap(&footprint) + tracer.chart_max * scratch.reach.unseen(paths);
    let mut film = interval::estimate(&means, unseen);
    if let Some(worked_out) = &tracer.worked_out {
        let largest = film.value.into_iter().fold(0.0, f64::max);
        film.error += worked_out.stated * largest;
    }
    let parts = footprint.parts.len() as u8;
    let spent = Spent {
        paths: u64::from(parts) * u64::from(paths),
        evaluations: scratch.evaluations,
    };
    (TracedPixel { film, parts, paths }, spent)
}
