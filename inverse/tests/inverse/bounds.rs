//! The Cramer-Rao bound against the spread of refinements of noisy images.

use crate::scene::{BACKEND, Draws, films, observe, preset};
use inverse::{Differentiator, Encoding, Information, NAMES, PARAMETERS, Refiner, Settings, Theta};
use renderer::Renderer;

/// Noisy copies.
const COPIES: usize = 16;

/// Chi squared with 15 degrees of freedom exceeds the upper and falls below the lower with a
/// probability of 1e-4 each.
const CHI_SQUARED_15: [f64; 2] = [2.41, 44.26];

/// The false alarm rate is 2e-4 a parameter, some 1e-3 in all; seeds are fixed.
#[test]
fn refinements_spread_as_the_bound_says() {
    let views = [5, 8];
    let specification = preset(16, 1e-3);
    let renderer = Renderer::new(&specification, BACKEND).expect("views");
    // Both photographs show everything about it but the common factor of its colours.
    let truth = specification.material(5).material;
    let noise_sd = 1.0 / 255.0;
    let differentiator = Differentiator::new(&specification, BACKEND).expect("views");
    let derivatives = differentiator.views(&truth, &views).expect("derivatives");
    let parts: Vec<Information> = derivatives
        .iter()
        .map(|view| Information::of_view(view, Encoding::Srgb))
        .collect();
    let information = Information::sum(&parts).expect("two views");
    let bounds = information.bounds(noise_sd).expect("bounds");

    let images = films(&renderer, &truth, &views);
    let refiner = Refiner::new(&specification, BACKEND, Settings::default()).expect("settings");
    let mut draws = Draws::new(7);
    let deviations: Vec<[f64; PARAMETERS]> = (0..COPIES)
        .map(|_| {
            let noisy = |code: f64| code + noise_sd * draws.normal();
            let observation = observe(&specification, &images, &views, Encoding::Srgb, noisy);
            let found = refiner.refine_from(&observation, &truth).expect("a fit");
            found.theta.difference(&Theta::of(&truth))
        })
        .collect();

    let mut compared = 0;
    for (parameter, bound) in bounds.iter().enumerate() {
        let values = deviations.iter().map(|deviation| deviation[parameter]);
        let mean = values.clone().sum::<f64>() / COPIES as f64;
        let squares: f64 = values.map(|value| (value - mean) * (value - mean)).sum();
        let spread = (squares / (COPIES - 1) as f64).sqrt();
        println!(
            "{}: bound {bound:.2e}, spread {spread:.2e}, mean {mean:.1e}",
            NAMES[parameter]
        );
        // Beyond this images are no longer linear in the parameter.
        if *bound > 0.05 {
            continue;
        }
        compared += 1;
        let statistic = squares / (bound * bound);
        let [low, high] = CHI_SQUARED_15;
        assert!(
            low < statistic && statistic < high,
            "{}: {statistic}",
            NAMES[parameter]
        );
        // Five standard deviations of a mean: 6e-7.
        assert!(
            mean.abs() < 5.0 * bound / (COPIES as f64).sqrt(),
            "{}",
            NAMES[parameter]
        );
    }
    assert!(compared >= 4, "{bounds:?}");
}
