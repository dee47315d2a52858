//! Materials found again from their own images, with and without noise.

use crate::scene::{
    BACKEND, Draws, code_error, eight_bits, films, median, median_material, observe, perturbed,
    preset,
};
use dataset::Material;
use inverse::{Encoding, Nuisances, Refined, Refiner, Settings, Stop, Theta};
use renderer::Renderer;

/// The photographs.
const VIEWS: [u32; 2] = [5, 8];

/// The relative accuracy of renderings.
const ACCURACY: f64 = 3e-3;

/// What noise does to a code.
#[derive(Clone, Copy)]
enum Noise {
    None,
    /// Standard deviation in 8-bit codes, then clipped and rounded to 8 bits.
    EightBits(f64),
}

/// The mean squared error of sRGB codes in `judged` views after refinement, and the best fit, for
/// material `index` of the preset.
fn refined(index: u32, noise: Noise, perturbation: f64, judged: &[u32]) -> (f64, Refined) {
    let specification = preset(32, ACCURACY);
    let renderer = Renderer::new(&specification, BACKEND).expect("views");
    let truth = specification.material(index).material;
    let mut draws = Draws::new(u64::from(index));
    let images = films(&renderer, &truth, &VIEWS);
    let start = perturbed(&truth, perturbation, &mut draws);
    let observation = observe(
        &specification,
        &images,
        &VIEWS,
        Encoding::Srgb,
        |code| match noise {
            Noise::None => code,
            Noise::EightBits(sd) => eight_bits(code, sd, &mut draws),
        },
    );
    let refiner = Refiner::new(&specification, BACKEND, Settings::default()).expect("settings");
    let found = refiner
        .refine(&observation, &[start, median_material()])
        .expect("fits")
        .remove(0);
    let expected = films(&renderer, &truth, judged);
    let error = code_error(&films(&renderer, &found.material, judged), &expected);
    println!(
        "material {index}: error {error:.1e}, {} renderings, {:?}, cost {:.1e}",
        found.renderings, found.stop, found.cost
    );
    (error, found)
}

/// Materials of ordinary roughness, whose renderings take milliseconds.
const MATERIALS: [u32; 3] = [2, 5, 7];

#[test]
fn noise_free_images_give_the_material_back() {
    let errors = MATERIALS.map(|index| refined(index, Noise::None, 0.08, &VIEWS).0);
    let middle = median(&errors);
    assert!(
        middle < 1e-6,
        "the median error is {middle:.1e}: {errors:?}"
    );
}

#[test]
fn eight_bits_and_noise_leave_little_error() {
    let noise = Noise::EightBits(4.0);
    let errors = MATERIALS.map(|index| refined(index, noise, 0.08, &VIEWS).0);
    let middle = median(&errors);
    assert!(
        middle < 1e-4,
        "the median error is {middle:.1e}: {errors:?}"
    );
}

#[test]
fn gain_and_light_are_fitted_too() {
    let known = preset(16, ACCURACY);
    let mut actual = known.clone();
    actual.light.distance_m *= 1.03;
    for view in &mut actual.views {
        view.light_elevation_deg = (view.light_elevation_deg - 0.8).min(90.0);
    }
    let truth = known.material(5).material;
    let renderer = Renderer::new(&actual, BACKEND).expect("views");
    let mut images = films(&renderer, &truth, &VIEWS);
    for value in images[0].iter_mut().flatten() {
        *value *= 1.1;
    }
    let observation = observe(&known, &images, &VIEWS, Encoding::Log, |code| code);
    let nuisances = Nuisances {
        light_elevation_deg: Some(1.0),
        light_distance: Some(0.05),
        camera_elevation_deg: None,
        gain: Some(0.2),
    };
    // Weak priors, so that they do not draw the solution to themselves.
    let fitted = Settings {
        nuisances,
        noise_sd: 1e-5,
        ..Settings::default()
    };
    let start = perturbed(&truth, 0.05, &mut Draws::new(1));
    let fit = |settings| -> Refined {
        let refiner = Refiner::new(&known, BACKEND, settings).expect("settings");
        refiner.refine_from(&observation, &start).expect("a fit")
    };
    let (with, without) = (fit(fitted), fit(Settings::default()));
    println!("{with:?}");
    assert!(with.mean_square < 1e-2 * without.mean_square);
    for (gains, expected) in with.nuisances.gain.iter().zip([1.1, 1.0]) {
        assert!(gains.iter().all(|gain| (gain - expected).abs() < 0.02));
    }
    assert!((with.nuisances.light_elevation_deg + 0.8).abs() < 0.1);
    assert!((with.nuisances.light_distance - 1.03).abs() < 0.01);
}

#[test]
fn limits_are_kept_and_bad_input_is_refused() {
    let specification = preset(8, 1e-2);
    let renderer = Renderer::new(&specification, BACKEND).expect("views");
    let truth = specification.material(5).material;
    let images = films(&renderer, &truth, &[8]);
    let observation = observe(&specification, &images, &[8], Encoding::Srgb, |code| code);
    let with = |settings| Refiner::new(&specification, BACKEND, settings);
    let few = Settings {
        renderings_max: 13,
        ..Settings::default()
    };
    let short = with(few)
        .expect("settings")
        .refine_from(&observation, &median_material());
    let short = short.expect("a fit");
    assert!(short.renderings <= 13 && short.stop == Stop::RenderingsSpent);
    let message = |settings, starts: &[Material]| {
        let refiner = with(settings);
        let found = refiner.and_then(|refiner| refiner.refine(&observation, starts));
        found.map_or_else(|error| error.to_string(), |_| String::new())
    };
    let start = [median_material()];
    let tiny = Settings {
        renderings_max: 5,
        ..few
    };
    assert!(message(tiny, &start).contains("renderings_max is 5"));
    assert!(message(few, &[]).contains("no starting material"));
    let broken = Settings {
        difference: f64::NAN,
        ..few
    };
    assert!(message(broken, &start).contains("difference is NaN"));
    let outside = Material {
        ior: 0.5,
        ..start[0]
    };
    assert!(message(few, &[outside]).contains("ior is 0.5"));
    let other = preset(9, 1e-2);
    let refiner = Refiner::new(&other, BACKEND, few).expect("settings");
    let refused = refiner
        .refine(&observation, &start)
        .expect_err("another film");
    assert!(refused.to_string().contains("view 8 has 64 pixels"));
}

/// The common factor of the colours shows nowhere, so no colour is known much better than before.
#[test]
fn a_fit_at_the_truth_stays_there_and_says_how_sure_it_is() {
    let specification = preset(16, ACCURACY);
    let renderer = Renderer::new(&specification, BACKEND).expect("views");
    let truth = specification.material(5).material;
    let images = films(&renderer, &truth, &VIEWS);
    let observation = observe(&specification, &images, &VIEWS, Encoding::Log, |code| code);
    let fit = |gain| -> Refined {
        let nuisances = Nuisances {
            gain,
            ..Nuisances::default()
        };
        let settings = Settings {
            nuisances,
            covariance: true,
            ..Settings::default()
        };
        let refiner = Refiner::new(&specification, BACKEND, settings).expect("settings");
        refiner.refine_from(&observation, &truth).expect("a fit")
    };
    let (known, unknown) = (fit(None), fit(Some(0.1)));
    for found in [&known, &unknown] {
        assert_eq!(found.stop, Stop::Converged);
        let moved = found.theta.difference(&Theta::of(&truth));
        assert!(moved.iter().all(|along| along.abs() < 1e-6), "{moved:?}");
    }
    let [known, unknown] = [known, unknown].map(|found| {
        let covariance = found.covariance.expect("asked");
        let roots = covariance.diagonal().map(f64::sqrt);
        roots.as_slice().to_vec()
    });
    println!("exposure known {known:?}, unknown {unknown:?}");
    for parameter in 0..10 {
        let told = known[parameter] < 0.01;
        assert_eq!(told, parameter < 4, "{known:?}");
        // What is not known beside a parameter makes it less certain. Which directions count as not
        // observed depends a little on the columns beside them.
        assert!(unknown[parameter] >= 0.98 * known[parameter], "{unknown:?}");
    }
}
