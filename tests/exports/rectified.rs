//! `--rectified` against a checkerboard that the renderer's own camera sees.

use dataset::Specification;
use export::rectify::Rectifier;
use renderer::{geometry::BackendChoice, scene::Scene};

/// Squares of the checkerboard along the sample's side.
const SQUARES: u32 = 4;

/// The rectified image's side.
const SIDE: u32 = 64;

/// The film that a camera of the renderer sees of a pattern on the sample, black beside it. Rays
/// meet the plane here, without the homography. Each of `COLUMNS` by `ROWS` places in a pixel; a
/// column's are shifted against the next one's, so that no row of the film lies on a grid.
fn film(scene: &Scene, side_m: f64, pattern: impl Fn(f64, f64) -> f64) -> Vec<[f32; 3]> {
    const COLUMNS: u32 = 8;
    const ROWS: u32 = 32;
    let pixel = |column: u32, row: u32| {
        let mut sum = 0.0;
        for (i, j) in (0..COLUMNS * ROWS).map(|place| (place % COLUMNS, place / COLUMNS)) {
            let x = (f64::from(i) + 0.5) / f64::from(COLUMNS);
            let y = (f64::from(j) + x) / f64::from(ROWS);
            let ray = scene.camera.ray(f64::from(column) + x, f64::from(row) + y);
            if ray.direction.z >= 0.0 {
                continue;
            }
            let at = ray.origin - ray.direction * (ray.origin.z / ray.direction.z);
            let (u, v) = (at.x / side_m + 0.5, at.y / side_m + 0.5);
            if (0.0..1.0).contains(&u) && (0.0..1.0).contains(&v) {
                sum += pattern(u, v);
            }
        }
        [(sum / f64::from(COLUMNS * ROWS)) as f32; 3]
    };
    (0..128 * 128)
        .map(|place| pixel(place % 128, place / 128))
        .collect()
}

fn scene(specification: &Specification, view: usize) -> Scene {
    Scene::new(specification, view, BackendChoice::Native)
        .unwrap()
        .unwrap()
}

/// A line's place between the middles of the squares beside it, from how much of both is there:
/// `values` runs from the middle of one to the middle of the other.
fn edge(values: &[f64]) -> f64 {
    let (first, last) = (values[0].round(), values[values.len() - 1].round());
    assert_eq!((first - last).abs(), 1.0, "no edge in {values:?}");
    values
        .iter()
        .map(|value| (value - last) / (first - last))
        .sum()
}

/// The lines of a checkerboard come out where they are, to a twentieth of a pixel, whatever the
/// camera's elevation.
#[test]
fn a_checkerboard_is_warped_to_within_a_twentieth_of_a_pixel() {
    let specification = Specification::preset();
    let square = (SIDE / SQUARES) as usize;
    let checkerboard = |u: f64, v: f64| {
        let cell = |x: f64| (x * f64::from(SQUARES)) as u32;
        f64::from((cell(u) + cell(v)) % 2)
    };
    for view in 4..9 {
        let film = film(
            &scene(&specification, view),
            specification.sample.side_m,
            checkerboard,
        );
        let rectifier = Rectifier::new(&specification, view as u32, SIDE).unwrap();
        let values: Vec<f64> = rectifier
            .apply(&film)
            .iter()
            .map(|value| f64::from(value[0]))
            .collect();
        let at = |row: usize, column: usize| values[row * SIDE as usize + column];
        let mut worst = 0.0f64;
        for line in (1..SQUARES as usize).map(|number| number * square) {
            let window = line - square / 2..line + square / 2;
            // Where no other line is near.
            let middles = (0..SIDE as usize).filter(|place| {
                let within = place % square;
                (square * 3 / 8..square * 5 / 8).contains(&within)
            });
            for place in middles {
                let across: Vec<f64> = window.clone().map(|column| at(place, column)).collect();
                let along: Vec<f64> = window.clone().map(|row| at(row, place)).collect();
                for found in [edge(&across), edge(&along)] {
                    worst = worst.max((found - square as f64 / 2.0).abs());
                }
            }
        }
        assert!(worst < 0.05, "view {view}: {worst} pixel");
    }
}

/// A sample of one radiance, black beside it, becomes a square of it, up to the border.
#[test]
fn a_constant_sample_is_constant_up_to_its_border() {
    let specification = Specification::preset();
    for view in 4..9 {
        let film = film(
            &scene(&specification, view),
            specification.sample.side_m,
            |_, _| 0.7,
        );
        let rectifier = Rectifier::new(&specification, view as u32, SIDE).unwrap();
        let side = SIDE as usize;
        for (place, value) in rectifier.apply(&film).iter().enumerate() {
            let (row, column) = (place / side, place % side);
            let border = [row, column]
                .iter()
                .any(|place| *place < 4 || *place >= side - 4);
            // The film's own rays count coverage only to a few hundredths.
            let tolerance = if border { 0.04 } else { 1e-4 };
            let off = (f64::from(value[0]) / 0.7 - 1.0).abs();
            assert!(
                off < tolerance,
                "view {view}, row {row}, column {column}: {}",
                value[0]
            );
        }
    }
}
