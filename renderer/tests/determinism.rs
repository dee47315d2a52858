//! One image, one file: whatever traces the rays, however many threads, on whatever instructions.

use dataset::{
    Digest, HARD_CASES, Specification,
    specification::{IntegratorKind, Pixel},
};
use rayon::ThreadPoolBuilder;
use renderer::{Instructions, Renderer, geometry::BackendChoice};

/// The preset with few samples on a small film.
fn specification() -> Specification {
    let mut specification = Specification::preset();
    specification.image.width = 40;
    specification.image.height = 40;
    specification.integrator.samples_per_pixel = 16;
    specification
}

fn digest(
    kind: IntegratorKind,
    backend: &str,
    threads: usize,
    material: usize,
    view: u32,
) -> Digest {
    let backend: BackendChoice = backend.parse().expect("a backend");
    let mut specification = specification();
    specification.integrator.kind = kind;
    let renderer = Renderer::new(&specification, backend).expect("a renderer");
    let material = HARD_CASES[material].material;
    let pool = ThreadPoolBuilder::new()
        .num_threads(threads)
        .build()
        .expect("a pool");
    let rendering = pool.install(|| renderer.render(&material, Some(7), view));
    Digest::of(&rendering.expect("an image").exr)
}

/// Of the path tracer, which traces rays; the hybrid integrator traces none in these scenes.
#[test]
fn backends_and_instruction_sets_change_no_byte() {
    let mut backends = vec!["embree", "embree:sse2"];
    if std::is_x86_feature_detected!("avx2") {
        backends.push("embree:avx2");
    }
    if std::is_x86_feature_detected!("avx512f") {
        backends.push("embree:avx512");
    }
    for material in 0..HARD_CASES.len() {
        for view in [0, 4, 5, 8] {
            let native = digest(IntegratorKind::Path, "native", 2, material, view);
            for backend in &backends {
                assert_eq!(
                    native,
                    digest(IntegratorKind::Path, backend, 2, material, view),
                    "{backend}, material {material}, view {view}"
                );
            }
        }
    }
}

#[test]
fn the_last_digit_of_a_parameter_shows() {
    let renderer = Renderer::new(&specification(), BackendChoice::Native).expect("a renderer");
    let material = HARD_CASES[0].material;
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
            .render(&HARD_CASES[0].material, Some(7), 5)
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

/// Digests of small images, written down: integrator, hard case, view. A change of bits is a
/// decision, with which `dataset::RENDERER_VERSION` is raised, and never an accident. To write them
/// down anew, set `WRITE_DIGESTS` to the file's path.
fn written_down() -> Vec<(IntegratorKind, usize, u32, String)> {
    include_str!("digests.txt")
        .lines()
        .map(|line| {
            let words: Vec<&str> = line.split(' ').collect();
            let kind = match words[0] {
                "hybrid" => IntegratorKind::Hybrid,
                "path" => IntegratorKind::Path,
                other => panic!("no integrator {other}"),
            };
            let number = |word: &str| word.parse().expect("a number");
            (
                kind,
                number(words[1]) as usize,
                number(words[2]),
                words[3].to_owned(),
            )
        })
        .collect()
}

/// They hold on every machine, in debug and in release builds, on one thread and on five, on every
/// instruction set, with whatever was rendered before.
#[test]
fn bytes_are_those_written_down() {
    if let Ok(path) = std::env::var("WRITE_DIGESTS") {
        let lines = written_down().into_iter().map(|(kind, material, view, _)| {
            let name = match kind {
                IntegratorKind::Hybrid => "hybrid",
                IntegratorKind::Path => "path",
            };
            let digest = digest(kind, "native", 2, material, view);
            format!("{name} {material} {view} {digest}\n")
        });
        std::fs::write(path, lines.collect::<String>()).expect("written");
        return;
    }
    let written = written_down();
    assert_eq!(written.len(), 56);
    for kind in [IntegratorKind::Hybrid, IntegratorKind::Path] {
        let mut specification = specification();
        specification.integrator.kind = kind;
        for instructions in Instructions::available() {
            let renderer = Renderer::new(&specification, BackendChoice::Native)
                .expect("a renderer")
                .with_instructions(instructions);
            for threads in [1, 2, 5] {
                let pool = ThreadPoolBuilder::new()
                    .num_threads(threads)
                    .build()
                    .expect("a pool");
                for (_, material, view, expected) in
                    written.iter().filter(|written| written.0 == kind)
                {
                    let material = &HARD_CASES[*material].material;
                    let rendering = pool.install(|| renderer.render(material, Some(7), *view));
                    let found = Digest::of(&rendering.expect("an image").exr).to_string();
                    assert_eq!(
                        &found, expected,
                        "{kind:?} on {instructions}, {threads} threads, {material:?}, view {view}"
                    );
                }
            }
        }
    }
}
