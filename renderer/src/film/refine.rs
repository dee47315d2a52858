//! Tiles halved until each is fine enough.

use super::canvas::Canvas;
use crate::numerics::polygon::Rectangle;
use rayon::prelude::*;

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

/// Works out tiles, and the halves of those that were too coarse, until none are left. Returns how many
/// evaluations it took.
///
/// `grow` works out a tile from the film so far, the evaluations spent so far and a thread's buffers,
/// and also counts evaluations. `add` adds what came of a tile to the film, or returns the tile's halves.
///
/// All tiles of a size come before any smaller one, so that evaluations run out everywhere at once.
/// They are worked out in rounds of a fixed number of tiles, between which the film and the
/// evaluations are looked at: the result does not depend on the schedule of threads.
pub fn refine<B: Default, G: Send>(
    canvas: &mut Canvas<'_>,
    mut open: Vec<Rectangle>,
    tiles_a_round: usize,
    grow: impl Fn(&Canvas<'_>, u64, &Rectangle, &mut B) -> (G, u64) + Sync,
    mut add: impl FnMut(&mut Canvas<'_>, G) -> Option<[Rectangle; 2]>,
) -> u64 {
    let mut evaluations = 0;
    while !open.is_empty() {
        let mut smaller = Vec::new();
        for tiles in open.chunks(tiles_a_round) {
            let (so_far, spent_so_far) = (&*canvas, evaluations);
            let grown: Vec<(G, u64)> = tiles
                .par_iter()
                .map_init(B::default, |buffers, rectangle| {
                    grow(so_far, spent_so_far, rectangle, buffers)
                })
                .collect();
            for (growth, spent) in grown {
                evaluations += spent;
                smaller.extend(add(canvas, growth).into_iter().flatten());
            }
        }
        open = smaller;
    }
    evaluations
}
