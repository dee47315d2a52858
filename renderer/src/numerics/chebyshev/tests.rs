use super::*;
use proptest::prelude::*;

/// Over cells in any columns, beginning and ending anywhere in the blocks that are worked out together.
#[test]
fn integrals_in_rows_are_those_of_cells() {
    let rectangle = Rectangle {
        low: [2.25, 5.5],
        high: [24.75, 8.125],
    };
    let values = (0..64).map(|i| [libm::exp(f64::from(i) / 9.0), f64::from(i), -1.0]);
    let (tile, _) = Basis::<8>::new().fit(rectangle, values);
    let [columns, rows] = [0, 1].map(|axis| rectangle.pixel_edges(axis));
    let integrals = tile.cell_integrals(&columns, &rows);
    let mut buffer = Vec::new();
    let ranges = [(0, 23), (0, 0), (3, 7), (7, 9), (8, 16), (15, 23), (16, 16)];
    for (row, instructions) in
        (0..rows.len() - 1).zip(Instructions::available().into_iter().cycle())
    {
        for (start, end) in ranges {
            let found = integrals.in_row(instructions, row, start..end, &mut buffer);
            let expected: Vec<[f64; 3]> = (start..end)
                .map(|column| {
                    tile.integral(&Rectangle {
                        low: [columns[column], rows[row]],
                        high: [columns[column + 1], rows[row + 1]],
                    })
                })
                .collect();
            assert_eq!(found, expected, "{start}..{end} of row {row}");
        }
    }
}

proptest! {
    /// Of any series and wherever on the tile the part lies: at most what is said, and at times a third of it.
    #[test]
    fn a_part_is_nearly_as_bright_as_at_its_centroid(
        values in prop::collection::vec(-1.0..1.0f64, 25),
        corners in prop::array::uniform4(prop::array::uniform2(0.0..1.0f64)),
        pixel in prop::array::uniform2(0u32..20), sides in prop::array::uniform2(0.5..4.0f64),
    ) {
        let rectangle = Rectangle { low: [3.0, 5.0], high: [43.0, 25.0] };
        let (tile, _) = Basis::<5>::new().fit(rectangle, values.iter().map(|v| [*v, -*v, 0.5]));
        let low: [f64; 2] = std::array::from_fn(|axis| rectangle.low[axis] + f64::from(pixel[axis].min(16)));
        // A triangle's and a rectangle's part of a box with such sides.
        let at = |[x, y]: [f64; 2]| [low[0] + sides[0] * x, low[1] + sides[1] * y];
        let [[x, y], [w, h], ..] = corners;
        let (right, top) = (x + w * (1.0 - x), y + h * (1.0 - y));
        let parts = [
            [[x, y], [right, y], [right, top], [x, top]],
            [[0.0, 0.0], [1.0, y], [1.0, y], [x, 1.0]],
        ];
        for part in parts {
            let part = Polygon::quadrilateral(part.map(at));
            let (exact, area) = tile.integral_over(&part, Instructions::widest());
            let (found, same) = tile.at_centroid(&part);
            prop_assert!((area - same).abs() < 1e-9);
            let bound = tile.off_at_centroids(sides) * area + 1e-12;
            for (exact, found) in exact.into_iter().zip(found) {
                prop_assert!((exact - found).abs() <= bound, "{exact} {found} {bound}");
            }
        }
    }
}

/// The bound is met where one term bends most: T_4 in a corner.
#[test]
fn what_a_centroid_may_be_off_by_is_no_more_than_it_can_be() {
    let rectangle = Rectangle {
        low: [0.0; 2],
        high: [100.0; 2],
    };
    let basis = Basis::<5>::new();
    let nodes = basis.nodes(&rectangle).map(|[x, _]| [chebyshev_4(x); 3]);
    let (tile, _) = basis.fit(rectangle, nodes);
    let corner = Rectangle {
        low: [99.0, 0.0],
        high: [100.0, 1.0],
    };
    let [[left, bottom], [right, top]] = [corner.low, corner.high];
    let part = Polygon::quadrilateral([[left, bottom], [right, bottom], [right, top], [left, top]]);
    let (found, _) = tile.at_centroid(&part);
    let off = (tile.integral(&corner)[0] - found[0]).abs();
    let bound = tile.off_at_centroids([1.0; 2]);
    assert!(off <= bound && off > 0.9 * bound, "{off} {bound}");
}

fn chebyshev_4(x: f64) -> f64 {
    values::<5>(0.02 * x - 1.0)[4]
}

#[test]
fn antiderivatives_are_those_of_the_polynomials() {
    let step = 1e-5;
    for x in [-0.9, -0.2, 0.0, 0.4, 1.0 - 2e-5] {
        let slope = integrals::<8>(x - step, x + step).map(|rise| rise / (2.0 * step));
        for (slope, value) in slope.into_iter().zip(values::<8>(x)) {
            assert!(
                (slope - value).abs() < 1e-7,
                "{slope} against {value} at {x}"
            );
        }
    }
}

#[test]
fn means_hold_less_than_points() {
    let rectangle = Rectangle {
        low: [3.0, 5.0],
        high: [5.0, 6.0],
    };
    let basis = Basis::<8>::new();
    // T_6 along columns: its mean is 1/35 over the tile and over either half, and over a hundredth as large as it
    // is.
    let nodes = basis
        .nodes(&rectangle)
        .map(|[x, _]| [values::<8>(x - 4.0)[6]; 3]);
    let (tile, fit) = basis.fit(rectangle, nodes);
    assert!((fit.error - LEFT_OUT).abs() < 1e-12);
    let told = |columns: &[f64]| tile.left_out_of_means(columns, &[5.0, 6.0]) / LEFT_OUT;
    assert!((told(&[3.0, 5.0]) - 1.0 / 35.0).abs() < 1e-12);
    assert!((told(&[3.0, 4.0, 5.0]) - 1.0 / 35.0).abs() < 1e-12);
    assert!((told(&[3.99, 4.01]) - 1.0).abs() < 1e-2);
}

#[test]
fn a_product_of_polynomials_is_met_exactly() {
    let rectangle = Rectangle {
        low: [3.0, 5.0],
        high: [11.0, 7.0],
    };
    let function = |x: f64, y: f64| [x * x * x * y, x + y * y, 1.0];
    let basis = Basis::<8>::new();
    let nodes = basis.nodes(&rectangle).map(|[x, y]| function(x, y));
    let (tile, fit) = basis.fit(rectangle, nodes);
    assert!(fit.error < 1e-9);
    for (found, expected) in tile.value([4.5, 6.2]).into_iter().zip(function(4.5, 6.2)) {
        assert!((found - expected).abs() < 1e-9 * expected);
    }
    let cell = Rectangle {
        low: [4.0, 5.0],
        high: [5.0, 6.0],
    };
    let expected = [
        (625.0 - 256.0) / 4.0 * 5.5,
        4.5 + (216.0 - 125.0) / 3.0,
        1.0,
    ];
    for (found, expected) in tile.integral(&cell).into_iter().zip(expected) {
        assert!((found - expected).abs() < 1e-10 * expected);
    }
}
