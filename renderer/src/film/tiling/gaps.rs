//! Points in the gaps between a tile's nodes.

use crate::numerics::polygon::Rectangle;
use std::f64::consts::PI;

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
