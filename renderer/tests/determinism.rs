//! One image, one file: whatever traces the rays, however many threads, on whatever instructions.

use dataset::{
    Digest, HARD_CASES, Material, Specification, image_file_bytes_max, image_file_header,
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

/// Embree as it chooses for itself, and on every instruction set of this processor.
#[cfg(target_arch = "x86_64")]
fn embree_backends() -> Vec<&'static str> {
    let mut backends = vec!["embree", "embree:sse2"];
    if std::is_x86_feature_detected!("avx2") {
        backends.push("embree:avx2");
    }
    if std::is_x86_feature_detected!("avx512f") {
        backends.push("embree:avx512");
    }
    backends
}

/// Embree as it chooses for itself: its instruction sets have names on x86-64 only.
#[cfg(not(target_arch = "x86_64"))]
fn embree_backends() -> Vec<&'static str> {
    vec!["embree"]
}

/// Renders with the path tracer: the hybrid integrator traces no rays in these scenes.
#[test]
#[cfg_attr(
    not(target_arch = "x86_64"),
    ignore = "needs Embree, which deploy/fetch-embree.sh fetches for x86-64 only"
)]
fn backends_and_instruction_sets_change_no_byte() {
    let backends = embree_backends();
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

/// One of a material's ten numbers.
type Parameter = fn(&mut Material) -> &mut f64;

const PARAMETERS: [(&str, Parameter); 10] = [
    ("roughness", |material| &mut material.roughness),
    ("anisotropy", |material| &mut material.anisotropy),
    ("angle_deg", |material| &mut material.angle_deg),
    ("ior", |material| &mut material.ior),
    ("rgb0, red", |material| &mut material.rgb0[0]),
    ("rgb0, green", |material| &mut material.rgb0[1]),
    ("rgb0, blue", |material| &mut material.rgb0[2]),
    ("rgb90, red", |material| &mut material.rgb90[0]),
    ("rgb90, green", |material| &mut material.rgb90[1]),
    ("rgb90, blue", |material| &mut material.rgb90[2]),
];

/// Compares pixels, because a file also carries the parameters in its header. The upper bound
/// rules out that pixels differ for another reason, such as random numbers that a parameter seeds.
#[test]
fn the_last_digit_of_a_parameter_shows_in_pixels() {
    // The last digit can turn one of many paths the other way.
    for (kind, most) in [
        (IntegratorKind::Hybrid, 1e-12),
        (IntegratorKind::Path, 1e-3),
    ] {
        let mut specification = specification();
        specification.integrator.kind = kind;
        let renderer = Renderer::new(&specification, BackendChoice::Native).expect("a renderer");
        let pixels = |material: &Material| -> Vec<f64> {
            let rendering = renderer.render(material, Some(7), 5).expect("an image");
            let pixels = rendering.film.pixels.iter();
            pixels.flat_map(|pixel| pixel.value).collect()
        };
        let material = HARD_CASES[0].material;
        let expected = pixels(&material);
        for (name, parameter) in PARAMETERS {
            let mut other = material;
            let value = parameter(&mut other);
            *value = value.next_up();
            let difference = pixels(&other)
                .iter()
                .zip(&expected)
                .map(|(found, expected)| (found - expected).abs())
                .fold(0.0, f64::max);
            assert!(
                difference > 0.0 && difference < most,
                "{kind:?}: the last digit of {name} changes pixels by up to {difference:e}"
            );
        }
    }
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

/// How many threads render: in turn one, two and five, or the number that `BRDFARM_DIGEST_THREADS`
/// gives, which `tests/arm.sh` sets because an emulated processor is slow.
fn thread_counts() -> Vec<usize> {
    match std::env::var("BRDFARM_DIGEST_THREADS") {
        Ok(count) => vec![count.parse().expect("a number of threads")],
        Err(_) => vec![1, 2, 5],
    }
}

/// They hold on every processor, in debug and in release builds, for every number of threads, on
/// every instruction set, with whatever was rendered before.
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
            for threads in thread_counts() {
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

/// A coordinator accepts no other header than this one, and has no renderer to ask.
#[test]
fn a_file_begins_as_the_dataset_says() {
    let mut specification = Specification::preset();
    specification.image.height = 9;
    for (width, pixel) in [(3, Pixel::Half), (40, Pixel::Float)] {
        specification.image.width = width;
        specification.image.pixel = pixel;
        let renderer = Renderer::new(&specification, BackendChoice::Native).expect("a renderer");
        let material = specification.material(5).material;
        for (index, view) in [(Some(5), 0), (None, 13)] {
            let rendering = renderer.render(&material, index, view).expect("an image");
            let header = image_file_header(&specification, &rendering.header);
            assert!(rendering.exr.starts_with(&header), "{width} {view}");
            let most = image_file_bytes_max(&specification, header.len() as u64);
            assert!(rendering.exr.len() as u64 <= most, "{width} {view}");
        }
    }
}
