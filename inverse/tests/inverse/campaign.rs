//! Derivatives of many materials against differences, in a long run.

use crate::differences::{Comparison, compare, reference, reference_step, rendered_like};
use crate::scene::{BACKEND, from_environment, preset};
use dataset::specification::View;
use dataset::{HARD_CASES, Material, Specification};
use inverse::{Differentiator, NAMES, PARAMETERS};
use rayon::prelude::*;
use renderer::Renderer;
use std::time::Instant;

/// Derivatives at one accuracy against the reference at a tighter one, over all views of the hard cases
/// and of materials drawn from the preset. Prints what share of notable derivatives is right to a percent,
/// by parameter, also of those that the reference itself knows, and what share of all lies within the
/// stated errors.
#[test]
#[ignore = "takes hours: tests/inverse.sh runs it"]
fn campaign_of_derivatives() {
    let count: usize = from_environment("BRDFARM_CASES");
    let first: usize = from_environment("BRDFARM_FIRST");
    let [side, accuracy, tight] =
        ["BRDFARM_SIDE", "BRDFARM_ACCURACY", "BRDFARM_TIGHT_ACCURACY"].map(from_environment::<f64>);
    let rough = preset(side as u32, accuracy);
    let drawn = (0..rough.materials).map(|number| {
        let index = (7 + 131 * number) % rough.materials;
        (format!("material {index}"), rough.material(index).material)
    });
    let hard = HARD_CASES.map(|case| (case.name.to_owned(), case.material));
    let cases = hard.into_iter().chain(drawn).skip(first).take(count);
    let cases: Vec<(String, Material)> = cases.collect();
    let alike = views_alike(&rough);
    let work: Vec<(usize, &Vec<u32>)> = (0..cases.len())
        .flat_map(|case| alike.iter().map(move |views| (case, views)))
        .collect();
    let differentiator = Differentiator::new(&rough, BACKEND).expect("views");
    let renderer = Renderer::new(&preset(side as u32, tight), BACKEND).expect("views");
    let examine = |&(case, views): &(usize, &Vec<u32>)| {
        let (name, material) = &cases[case];
        let begun = Instant::now();
        let derivatives = differentiator.views(material, views);
        let derivatives = derivatives.expect("derivatives");
        let rendered = rendered_like(&renderer, material, views);
        let by = |parameter| {
            let step = reference_step(material, parameter);
            let expected = reference(&rendered, material, parameter, step);
            compare(&derivatives, parameter, &expected)
        };
        let found: [Comparison; PARAMETERS] = std::array::from_fn(by);
        for (found, parameter) in found.iter().zip(NAMES) {
            if found.beyond_a_percent + found.uncovered > 0 {
                println!("{name}, views {views:?}, {parameter}: {found:?}");
            }
        }
        let mut all = Comparison::default();
        for found in found {
            all += found;
        }
        let took = begun.elapsed().as_secs_f64();
        println!("{name}, views {views:?} in {took:.0} s: {all:?}");
        found
    };
    let found: Vec<[Comparison; PARAMETERS]> = work.par_iter().map(examine).collect();
    let mut all = Comparison::default();
    for parameter in 0..PARAMETERS {
        let mut sum = Comparison::default();
        for found in &found {
            sum += found[parameter];
        }
        println!("{}: {}; {sum:?}", NAMES[parameter], sum.shares());
        all += sum;
    }
    println!("all: {}", all.shares());
    assert!(all.uncovered * 1000 <= all.channels);
}

/// The views in groups of one light and one rotation of the sample, which share their interreflection.
fn views_alike(specification: &Specification) -> Vec<Vec<u32>> {
    let alike = |one: &View, other: &View| {
        one.light_elevation_deg == other.light_elevation_deg
            && one.rotation_deg == other.rotation_deg
    };
    let mut groups: Vec<Vec<u32>> = Vec::new();
    for (index, view) in specification.views.iter().enumerate() {
        let same = |group: &&mut Vec<u32>| alike(view, &specification.views[group[0] as usize]);
        match groups.iter_mut().find(same) {
            Some(group) => group.push(index as u32),
            None => groups.push(vec![index as u32]),
        }
    }
    groups
}
