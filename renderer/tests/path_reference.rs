//! The path tracer against pixels worked out by adaptive cubature.

mod reference_pixels;

use dataset::{Specification, specification::View};
use rayon::prelude::*;
use reference_pixels::reference_pixels;
use renderer::{
    geometry::BackendChoice, path::Tracer, reflectance::Reflectance, sampler::Sampler, scene::Scene,
};

const REPLICATES: u32 = 64;
const SAMPLES: u32 = 1024;

/// The value of Student's t with 63 degrees of freedom that a right estimate exceeds with
/// probability 1e-5: all 105 channels together fail once in a thousand seeds.
const T_LIMIT: f64 = 4.81;

#[test]
fn the_path_tracer_agrees_with_cubature_within_its_own_error() {
    let cases = reference_pixels();
    for (number, case) in cases.iter().enumerate() {
        let mut specification = Specification::preset();
        specification.views = vec![View {
            camera_elevation_deg: case.camera_elevation_deg,
            light_elevation_deg: case.light_elevation_deg,
            rotation_deg: case.rotation_deg,
            checker: false,
        }];
        let scene = Scene::new(&specification, 0, BackendChoice::Native)
            .expect("view 0")
            .expect("native geometry");
        let reflectance = Reflectance::new(&case.material, case.rotation_deg, case.tint);
        let tracer = Tracer::new(&scene, &reflectance, 4);
        let footprint = tracer.footprint(case.column, case.row);
        let means: Vec<[f64; 3]> = (0..REPLICATES)
            .into_par_iter()
            .map(|replicate| {
                let sampler = Sampler::new(number as u64, 0, replicate);
                tracer.replicate(&footprint, &sampler, SAMPLES)
            })
            .collect();
        for channel in 0..3 {
            let count = f64::from(REPLICATES);
            let mean = means.iter().map(|mean| mean[channel]).sum::<f64>() / count;
            let variance = means
                .iter()
                .map(|replicate| (replicate[channel] - mean) * (replicate[channel] - mean))
                .sum::<f64>()
                / (count - 1.0)
                / count;
            let error = (mean - case.value[channel]).abs();
            // Where paths have no variance left, rounding is what remains.
            let limit = T_LIMIT * variance.sqrt() + 1e-12 * case.value[channel];
            assert!(
                error <= limit,
                "pixel {number}, channel {channel}: {mean} against {}, limit {limit}",
                case.value[channel]
            );
            assert!(
                variance.sqrt() <= 5e-3 * case.value[channel],
                "pixel {number}: the error bar {} is too wide to tell anything",
                variance.sqrt()
            );
        }
    }
}
