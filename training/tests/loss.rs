//! Loss, gradients and readings against values worked out by a program that shares no code with this
//! one, at 40 digits (`reference/loss.json`; its formulas stand inside).

#![allow(clippy::unwrap_used, reason = "a panic here is a failed test")]

use burn::tensor::{Device, Tensor, TensorData};
use serde::Deserialize;
use training::labels::BINS;
use training::labels::loss::{cross_entropy, gradient, softmax, weighted_mean};
use training::labels::reading::{Reader, Reading, argmax, circular_mean, mean, resultant};
use training::labels::target::{Ends, Smoothing, entropy};
use training::network::loss::{self as network_loss, cross_entropies};

#[derive(Deserialize)]
struct Reference {
    tolerance: Tolerance,
    totals: Totals,
    reading: Weights,
    cases: Vec<Case>,
}

#[derive(Deserialize)]
struct Tolerance {
    float64: f64,
    float32: f64,
}

#[derive(Deserialize)]
struct Totals {
    cases: Vec<usize>,
    weights: Vec<f64>,
    plain: f64,
    weighted: f64,
}

#[derive(Deserialize)]
struct Weights {
    values: Vec<f64>,
}

#[derive(Deserialize)]
struct Case {
    number: usize,
    edge: Ends,
    bin: usize,
    centre: f64,
    sigma: f64,
    logits: Vec<f64>,
    loss: f64,
    entropy: f64,
    excess: f64,
    argmax: usize,
    mean: f64,
    unbiased: Option<f64>,
    resultant: Option<f64>,
    circular_mean: Option<f64>,
    at: Vec<usize>,
    target_at: Vec<f64>,
    gradient_at: Vec<f64>,
}

impl Case {
    fn circular(&self) -> bool {
        self.edge == Ends::Wrap
    }

    fn smoothing(&self) -> Smoothing {
        Smoothing {
            sigma_bins: self.sigma,
            ends: self.edge,
        }
    }

    fn target(&self) -> [f64; BINS] {
        self.smoothing().target(self.centre, self.circular())
    }

    fn logits(&self) -> [f64; BINS] {
        self.logits.clone().try_into().unwrap()
    }
}

fn reference() -> Reference {
    serde_json::from_str(include_str!("reference/loss.json")).unwrap()
}

#[track_caller]
fn assert_near(what: &str, number: usize, actual: f64, expected: f64, tolerance: f64) {
    let error = (actual - expected).abs() / expected.abs().max(1.0);
    assert!(
        error <= tolerance,
        "case {number}: {what} is {actual}, not {expected}: off by {error:e}"
    );
}

#[test]
fn losses_and_gradients_are_the_reference_s_in_64_bits() {
    let reference = reference();
    let tolerance = reference.tolerance.float64;
    assert_eq!(reference.cases.len(), 40);
    for case in &reference.cases {
        let (target, logits) = (case.target(), case.logits());
        let near = |what, actual, expected| {
            assert_near(what, case.number, actual, expected, tolerance);
        };
        let loss = cross_entropy(logits.into_iter(), target.into_iter());
        near("the loss", loss, case.loss);
        near("the entropy", entropy(&target), case.entropy);
        near("the excess", loss - entropy(&target), case.excess);
        let gradient = gradient(&logits, &target);
        for (place, &bin) in case.at.iter().enumerate() {
            near("the target", target[bin], case.target_at[place]);
            near("the gradient", gradient[bin], case.gradient_at[place]);
        }
    }
    let losses: Vec<f64> = reference
        .totals
        .cases
        .iter()
        .map(|&number| {
            let case = &reference.cases[number];
            cross_entropy(case.logits().into_iter(), case.target().into_iter())
        })
        .collect();
    let plain = weighted_mean(&losses, &[1.0; 10]).unwrap();
    assert_near(
        "the plain total",
        0,
        plain,
        reference.totals.plain,
        tolerance,
    );
    let weighted = weighted_mean(&losses, &reference.totals.weights).unwrap();
    assert_near(
        "the weighted total",
        0,
        weighted,
        reference.totals.weighted,
        tolerance,
    );
    assert_eq!(weighted_mean(&losses, &[0.0; 10]), None);
}

#[test]
fn losses_and_gradients_are_the_reference_s_in_32_bits() {
    let reference = reference();
    let tolerance = reference.tolerance.float32;
    let device = Device::flex().autodiff();
    let row = |values: Vec<f64>| {
        let values: Vec<f32> = values.into_iter().map(|value| value as f32).collect();
        Tensor::<3>::from_data(TensorData::new(values, [1, 1, BINS]), &device)
    };
    for case in &reference.cases {
        let logits = row(case.logits.clone()).require_grad();
        let losses = cross_entropies(logits.clone(), row(case.target().to_vec()));
        let loss = network_loss::weighted_mean(losses.clone(), Tensor::ones([1, 1], &device));
        let value = f64::from(loss.clone().into_scalar::<f32>());
        assert_near("the loss", case.number, value, case.loss, tolerance);
        let gradients = loss.backward();
        let gradient = logits.grad(&gradients).unwrap();
        let gradient = gradient.into_data().try_into_vec::<f32>().unwrap();
        for (place, &bin) in case.at.iter().enumerate() {
            let expected = case.gradient_at[place];
            let actual = f64::from(gradient[bin]);
            assert_near("the gradient", case.number, actual, expected, tolerance);
        }
    }
}

#[test]
fn the_batch_s_loss_is_weighted_as_the_reference_s() {
    let reference = reference();
    let totals = &reference.totals;
    let device = Device::flex();
    let tensor = |values: Vec<f64>, shape: [usize; 3]| {
        let values: Vec<f32> = values.into_iter().map(|value| value as f32).collect();
        Tensor::<3>::from_data(TensorData::new(values, shape), &device)
    };
    let cases = || totals.cases.iter().map(|&number| &reference.cases[number]);
    let logits = tensor(
        cases().flat_map(|c| c.logits.clone()).collect(),
        [1, 10, BINS],
    );
    let targets = tensor(cases().flat_map(Case::target).collect(), [1, 10, BINS]);
    let losses = cross_entropies(logits, targets);
    for (weights, expected) in [
        (vec![1.0; 10], totals.plain),
        (totals.weights.clone(), totals.weighted),
    ] {
        let weights = tensor(weights, [1, 1, 10]).reshape([1, 10]);
        let total = network_loss::weighted_mean(losses.clone(), weights);
        let total = f64::from(total.into_scalar::<f32>());
        assert_near("the total", 0, total, expected, reference.tolerance.float32);
    }
}

#[test]
fn readings_are_the_reference_s() {
    let reference = reference();
    let near = |case: &Case, what, actual, expected| {
        assert_near(what, case.number, actual, expected, 1e-9);
    };
    for case in &reference.cases {
        let distribution = softmax(&case.logits());
        assert_eq!(argmax(&case.logits()), case.argmax, "case {}", case.number);
        near(case, "the mean", mean(&distribution), case.mean);
        if let Some(expected) = case.resultant {
            let [x, y] = resultant(&distribution);
            near(case, "the resultant", libm::hypot(x, y), expected);
        }
        if let Some(expected) = case.circular_mean {
            let actual = circular_mean(&distribution).unwrap();
            near(case, "the circular mean", actual, expected);
            let reader = Reader::new(Reading::Unbiased, case.smoothing());
            near(
                case,
                "the reading",
                reader.position(&distribution, true),
                expected,
            );
        } else if case.circular() {
            assert_eq!(circular_mean(&distribution), None, "case {}", case.number);
        }
        if let Some(expected) = case.unbiased {
            let reader = Reader::new(Reading::Unbiased, Smoothing::default());
            near(
                case,
                "the reading",
                reader.position(&distribution, false),
                expected,
            );
        }
    }
    let weights = Reader::new(Reading::Unbiased, Smoothing::default());
    for (bin, &expected) in reference.reading.values.iter().enumerate() {
        let mut certain = [0.0; BINS];
        certain[bin] = 1.0;
        let actual = weights.position(&certain, false);
        assert_near("the weight of a bin", bin, actual, expected, 1e-9);
    }
}

#[test]
fn every_bin_s_target_sums_to_1_is_largest_there_and_reads_back() {
    let reader = Reader::new(Reading::Unbiased, Smoothing::default());
    for circular in [false, true] {
        for bin in 0..BINS {
            let target = Smoothing::default().target(bin as f64, circular);
            let sum: f64 = target.iter().sum();
            assert!((sum - 1.0).abs() < 1e-14, "bin {bin}: the sum is {sum}");
            assert_eq!(argmax(&target), bin);
            let read = reader.position(&target, circular);
            // On the circle 99.99 and -0.01 are one place.
            let off = (read - bin as f64 + 50.0).rem_euclid(100.0) - 50.0;
            assert!(off.abs() < 0.1, "bin {bin} reads as {read}");
        }
    }
}

#[test]
fn a_reflected_target_is_not_largest_at_its_own_bin() {
    // Why targets are renormalised and not reflected, as SciPy's filters do.
    let smoothing = Smoothing {
        ends: Ends::Reflect,
        ..Smoothing::default()
    };
    for bin in 1..=3 {
        assert_ne!(
            argmax(&smoothing.target(f64::from(bin), false)),
            bin as usize
        );
    }
}

#[test]
fn the_bin_of_each_case_is_its_centre_s() {
    for case in reference().cases {
        let bin = (case.centre + 0.5).floor().clamp(0.0, 99.0) as usize;
        assert_eq!(bin, case.bin, "case {}", case.number);
    }
}
