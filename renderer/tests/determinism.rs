//! One image, one file: whatever traces the rays, however many threads, on whatever instructions.

use dataset::{
    Digest, HARD_CASES, Specification,
    specification::{IntegratorKind, Pixel},
};
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

#[test]
fn threads_change_no_byte() {
    for kind in [IntegratorKind::Hybrid, IntegratorKind::Path] {
        for (material, view) in [(0, 5), (1, 6), (2, 4), (5, 13)] {
            let alone = digest(kind, "native", 1, material, view);
            for threads in [2, 5] {
                assert_eq!(alone, digest(kind, "native", threads, material, view));
            }
        }
    }
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

/// Digests of small images, written down: a change of bits is a decision, with which
/// `dataset::RENDERER_VERSION` is raised, and never an accident. They hold on every machine, in
/// debug and in release builds.
#[test]
fn bytes_are_those_written_down() {
    const DIGESTS: [(IntegratorKind, usize, u32, &str); 12] = [
        (
            IntegratorKind::Hybrid,
            0,
            5,
            "d83eef859fb7ab8d7e4026331988c2190dd97ca708fa848592888e93484524b4",
        ),
        (
            IntegratorKind::Hybrid,
            1,
            6,
            "11d5cb4316a9711e5da9e772ea9d09138057c33156fce44c4598005cb255d6f1",
        ),
        (
            IntegratorKind::Hybrid,
            2,
            4,
            "3f1ad8e11f16fa767368784eec90dc5222a2452ac0c852d8ce438f4c9e87d7f9",
        ),
        (
            IntegratorKind::Hybrid,
            3,
            8,
            "6521677ff175f28f2e64de6038379106b05ed305aa34a754548c66cde3402ddc",
        ),
        (
            IntegratorKind::Hybrid,
            5,
            13,
            "037e77f6da1d022ec57726969255c7a7aa0828af38223d1f94e075fe9221eb28",
        ),
        (
            IntegratorKind::Hybrid,
            6,
            0,
            "31200d0fa83dcd7468fb79e7a666b071d3da1de5b41baf1e74e4315e9998388f",
        ),
        (
            IntegratorKind::Hybrid,
            8,
            9,
            "60157e99acbc8e9fc9776d63c3f322b2b4eade43b4db3419db5ca4bb506a6d18",
        ),
        (
            IntegratorKind::Hybrid,
            10,
            7,
            "ba6c5a1b7dea9831b2e07cb9535d09a3541dc44c8f11f0c9baa72a8075cbedac",
        ),
        (
            IntegratorKind::Path,
            0,
            5,
            "8378cb175547b1b2974146d65798e4ecbc7087ad0017816cb641131b707d92d1",
        ),
        (
            IntegratorKind::Path,
            1,
            6,
            "c4f2f9d229ec9043bc097ba1ecd2b50bba84c7b45e2aa87ddad0a863b606c141",
        ),
        (
            IntegratorKind::Path,
            2,
            4,
            "3605eb2473d3564e0b6acdd3c1f7ea631e3d4dede5eb6440e486593e47fe4422",
        ),
        (
            IntegratorKind::Path,
            5,
            13,
            "a3c024b8fca82499842dba4a90a1d0e8dc6f0bc836d5a03639d9faaa987a3c5d",
        ),
    ];
    for (kind, material, view, expected) in DIGESTS {
        let found = digest(kind, "native", 2, material, view).to_string();
        assert_eq!(
            found, expected,
            "{kind:?}, material {material}, view {view}"
        );
    }
}
