//! Points in the gaps between a tile's nodes.

use crate::film::tile_nodes::layout;
use crate::numerics::polygon::Rectangle;
use std::f64::consts::PI;

/// The radius in pixels of the most curved edge that may hide between the nodes of a thin tile. Derived: a bulb's
/// image is at least four pixels across where tiles hold its light (`hybrid::direct`).
const ROUND: f64 = 2.0;

/// The most points that are looked at on a side of a thin tile. A limit on work.
const LONG_SIDE_MAX: f64 = 100.0;

/// How far from a tile's middle the points lie across the axis along which they follow each other, of half its side.
/// Chosen.
const BESIDE: f64 = 0.4;

/// Points in every gap between nodes along either side, where a series that ends too early is off by most: at the
/// extremes of the first Chebyshev polynomial that it leaves out.
pub fn in_gaps<const TERMS: usize>(
    rectangle: &Rectangle,
) -> impl Iterator<Item = [f64; 2]> + use<TERMS> {
    let rectangle = *rectangle;
    let points = (0..2).flat_map(|axis| (1..TERMS).map(move |gap| (axis, gap)));
    points.map(move |(axis, gap)| {
        let mut at = [if gap.is_multiple_of(2) {
            BESIDE
        } else {
            -BESIDE
        }; 2];
        at[axis] = libm::cos(PI * gap as f64 / TERMS as f64);
        rectangle.point(at)
    })
}

/// Points on the long sides of a tile that is so thin that a round edge could reach across it between two nodes: there
/// it is as wide as the points lie apart.
pub fn on_long_sides<const TERMS: usize>(
    rectangle: &Rectangle,
) -> impl Iterator<Item = [f64; 2]> + use<TERMS> {
    let (rectangle, sides) = (*rectangle, rectangle.sides());
    let long = usize::from(sides[1] > sides[0]);
    let (length, depth) = (sides[long], sides[1 - long]);
    // A circle that reaches in by so much less than its radius.
    let chord = 0.9 * (8.0 * ROUND * depth).sqrt();
    let is_thin = depth < ROUND && chord < layout(TERMS).widest_gap * length;
    let count = if is_thin {
        (length / chord).min(LONG_SIDE_MAX) as u32 + 1
    } else {
        0
    };
    (0..count).flat_map(move |index| {
        let along = (2.0 * f64::from(index) + 1.0) / f64::from(count) - 1.0;
        [-1.0, 1.0].map(|side| {
            let mut at = [side; 2];
            at[long] = along;
            rectangle.point(at)
        })
    })
}
