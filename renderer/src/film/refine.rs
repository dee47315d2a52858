//! Tiles halved until each is fine enough.

use super::canvas::Canvas;
use crate::numerics::polygon::Rectangle;
use crate::parallel;

/// A rectangle cut into parts whose sides are at most `side_max`.
pub fn roots(rectangle: Rectangle, side_max: f64) -> Vec<Rectangle> {
    let (mut open, mut roots) = (vec![rectangle], Vec::new());
    while let Some(rectangle) = open.pop() {
        let sides = rectangle.sides();
        let longest = usize::from(sides[1] > sides[0]);
        if sides[longest] > side_max {
            open.extend(rectangle.halves(longest));
        } else {
            roots.push(rectangle);
        }
    }
    roots
}

/// A rectangle cut along the sides of a feature, along each axis on which that is shorter than
/// `side_max`.
pub fn cut_out(rectangle: Rectangle, feature: &Rectangle, side_max: f64) -> Vec<Rectangle> {
    let mut parts = vec![rectangle];
    for axis in 0..2 {
        if feature.sides()[axis] < side_max {
            for at in [feature.low[axis], feature.high[axis]] {
                parts = parts.iter().flat_map(|part| part.cut(axis, at)).collect();
            }
        }
    }
    parts
}

/// Tiles of a size that are worked out before the others: they may be dearer than larger ones were. Chosen.
const FIRST_OF_A_SIZE: usize = 4;

/// How many tiles are worked out between two looks at the film and at the evaluations spent.
pub struct Rounds {
    pub tiles_max: usize,
    /// No more tiles than take so many evaluations, if each takes what the dearest of the round before did.
    pub evaluations: u64,
}

impl Rounds {
    /// After a round whose dearest tile took `dearest` evaluations.
    fn next(&self, dearest: u64) -> usize {
        let affordable = self.evaluations / dearest.max(1);
        self.tiles_max.min(affordable as usize).max(1)
    }
}

/// Works out tiles, and the halves of those that were too coarse, until none are left. Returns how many
/// evaluations it took.
///
/// `grow` works out a tile from the film so far, the evaluations spent so far and a thread's buffers,
/// and also counts evaluations. `add` adds what came of a tile to the film, or returns the tile's halves.
///
/// All tiles of a size come before any smaller one, so that evaluations run out everywhere at once.
/// They are worked out in rounds, between which the film and the evaluations are looked at. How many tiles
/// a round has follows from the rounds before: the result does not depend on the schedule of threads.
pub fn refine<B: Default, G: Send>(
    canvas: &mut Canvas<'_>,
    mut open: Vec<Rectangle>,
    rounds: &Rounds,
    grow: impl Fn(&Canvas<'_>, u64, &Rectangle, &mut B) -> (G, u64) + Sync,
    mut add: impl FnMut(&mut Canvas<'_>, G) -> Option<[Rectangle; 2]>,
) -> u64 {
    let (mut evaluations, mut dearest) = (0, 0);
    let mut round = rounds.next(dearest);
    while !open.is_empty() {
        let mut smaller = Vec::new();
        let mut rest = open.as_slice();
        round = round.min(FIRST_OF_A_SIZE);
        while !rest.is_empty() {
            let (tiles, after) = rest.split_at(round.min(rest.len()));
            let (so_far, spent_so_far) = (&*canvas, evaluations);
            let work = |buffers: &mut B, rectangle: &Rectangle| {
                grow(so_far, spent_so_far, rectangle, buffers)
            };
            let grown = parallel::map(tiles, dearest, work, |(_, spent)| *spent);
            dearest = grown.iter().map(|(_, spent)| *spent).max().unwrap_or(0);
            for (growth, spent) in grown {
                evaluations += spent;
                smaller.extend(add(canvas, growth).into_iter().flatten());
            }
            round = rounds.next(dearest);
            rest = after;
        }
        open = smaller;
    }
    evaluations
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::film::FilmPixel;
    use std::sync::atomic::{AtomicU64, Ordering};

    const LIMIT: u64 = 100_000;
    const DEAR: u64 = 50_000;

    /// What it takes to work out `count` tiles that cost nothing and their halves, which are dear until the limit is
    /// spent, and how many of those were worked out before.
    fn spent(count: usize) -> (u64, u64) {
        let mut pixels = [FilmPixel::default(); 1];
        let mut canvas = Canvas {
            width: 1,
            height: 1,
            pixels: &mut pixels,
        };
        let root = Rectangle {
            low: [0.0; 2],
            high: [1.0; 2],
        };
        let rounds = Rounds {
            tiles_max: 32,
            evaluations: LIMIT / 4,
        };
        let dear = AtomicU64::new(0);
        let grow = |_: &Canvas<'_>, so_far: u64, tile: &Rectangle, (): &mut ()| {
            let is_root = *tile == root;
            let spent = if !is_root && so_far < LIMIT { DEAR } else { 0 };
            dear.fetch_add(u64::from(spent > 0), Ordering::Relaxed);
            (is_root.then(|| tile.halves(0)), spent)
        };
        let open = vec![root; count];
        let spent = refine(&mut canvas, open, &rounds, grow, |_, halves| halves);
        (spent, dear.into_inner())
    }

    /// Tiles of one size were cheap, the next ones take half the limit each.
    #[test]
    fn a_round_of_dear_tiles_is_short() {
        for count in [1, 2, 16, 1_000] {
            let (spent, dear) = spent(count);
            assert!(
                spent <= LIMIT + FIRST_OF_A_SIZE as u64 * DEAR,
                "{count}: {spent}"
            );
            assert!(dear >= 2, "{count}: {dear}");
        }
    }
}
