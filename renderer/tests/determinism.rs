//! One image, one file: whatever traces the rays, however many threads, on whatever instructions.

mod hard_materials;

use dataset::{Digest, Specification, specification::Pixel};
use hard_materials::hard_materials;
use rayon::ThreadPoolBuilder;
use renderer::{Renderer, geometry::BackendChoice};

/// The preset with few samples on a small film.
fn specification() -> Specification {
    let mut specification = Specification::preset();
    specification.image.width = 40;
    specification.image.height = 40;
    specification.integrator.samples_per_pixel = 16;
    specification
}

fn digest(backend: &str, threads: usize, material: usize, view: u32) -> Digest {
    let backend: BackendChoice = backend.parse().expect("a backend");
    let renderer = Renderer::new(&specification(), backend).expect("a renderer");
    let (_, material) = hard_materials()[material];
    let pool = ThreadPoolBuilder::new()
        .num_threads(threads)
        .build()
        .expect("a pool");
    let rendering = pool.install(|| renderer.render(&material, Some(7), view));
    Digest::of(&rendering.expect("an image").exr)
}

#[test]
fn threads_change_no_byte() {
    for (material, view) in [(0, 5), (1, 6), (2, 4), (5, 13)] {
        let alone = digest("native", 1, material, view);
        assert_eq!(alone, digest("native", 2, material, view));
        assert_eq!(alone, digest("native", 5, material, view));
    }
}

#[test]
fn backends_and_instruction_sets_change_no_byte() {
    let mut backends = vec!["embree", "embree:sse2"];
    if std::is_x86_feature_detected!("avx2") {
        backends.push("embree:avx2");
    }
    if std::is_x86_feature_detected!("avx512f") {
        backends.push("embree:avx512");
    }
    for material in 0..hard_materials().len() {
        for view in [0, 4, 5, 8] {
            let native = digest("native", 2, material, view);
            for backend in &backends {
                assert_eq!(
                    native,
                    digest(backend, 2, material, view),
                    "{backend}, material {material}, view {view}"
                );
            }
        }
    }
}

#[test]
fn the_last_digit_of_a_parameter_shows() {
    let renderer = Renderer::new(&specification(), BackendChoice::Native).expect("a renderer");
    let (_, material) = hard_materials()[0];
    let mut other = material;
    other.roughness = other.roughness.next_up();
    let render = |material| renderer.render(material, Some(7), 5).expect("an image");
    assert_ne!(
        Digest::of(&render(&material).exr),
        Digest::of(&render(&other).exr)
    );
}

#[test]
fn sixteen_and_thirty_two_bit_files_hold_the_film() {
    use exr::prelude::{FlatSamples, read_first_flat_layer_from_file};
    for pixel in [Pixel::Half, Pixel::Float] {
        let mut specification = specification();
        specification.image.pixel = pixel;
        let renderer = Renderer::new(&specification, BackendChoice::Native).expect("a renderer");
        let rendering = renderer
            .render(&hard_materials()[0].1, Some(7), 5)
            .expect("an image");
        let path =
            std::env::temp_dir().join(format!("brdfarm-{pixel:?}-{}.exr", std::process::id()));
        std::fs::write(&path, &rendering.exr).expect("written");
        let image = read_first_flat_layer_from_file(&path).expect("an EXR file");
        std::fs::remove_file(&path).expect("removed");
        let names: Vec<_> = image
            .layer_data
            .channel_data
            .list
            .iter()
            .map(|channel| channel.name.to_string())
            .collect();
        assert_eq!(names, ["B", "G", "R"]);
        for (channel, index) in image.layer_data.channel_data.list.iter().zip([2, 1, 0]) {
            let tolerance = match &channel.sample_data {
                FlatSamples::F16(_) => 5e-4,
                FlatSamples::F32(_) => 6e-8,
                FlatSamples::U32(_) => panic!("integers"),
            };
            for (value, pixel) in channel
                .sample_data
                .values_as_f32()
                .zip(&rendering.film.pixels)
            {
                let error = (f64::from(value) - pixel.value[index]).abs();
                assert!(error <= tolerance * pixel.value[index] + 6e-8);
            }
        }
    }
}
