use crate::cheap_image::{Cheap, cheap_image, small_specification};
use dataset::{Digest, specification::Pixel};
use exr::prelude::{Blocks, Compression, LineOrder, Vec2};
use imagestore::validation::{
    Rejection, check_digest, check_identity, decode, expected_headers, inspect,
};

#[test]
fn images_as_the_renderer_writes_them_are_accepted() {
    let mut specification = small_specification(5);
    for pixel in [Pixel::Half, Pixel::Float] {
        specification.image.pixel = pixel;
        let bytes = cheap_image(&specification, 4, 2);
        check_digest(&bytes, Digest::of(&bytes)).unwrap();
        let header = inspect(&bytes, &specification.image).unwrap();
        let expected = expected_headers(&specification, specification.hash(), 4);
        check_identity(&header, &expected[2]).unwrap();

        let decoded = decode(&bytes, &specification.image).unwrap();
        assert_eq!(decoded.header, header);
        // Levels are 1, 1/2 and 1/3 of the value in channels B, G and R, rising along the line.
        let level = 1.0 + 4.0 + 2.0 / 16.0;
        assert_eq!(decoded.pixels.len(), 16 * 20);
        for (place, [red, green, blue]) in decoded.pixels.iter().enumerate() {
            let expected = level * (place % 16) as f32;
            assert!((blue - expected).abs() <= 1e-3 * expected, "{place}");
            assert!((green - expected / 2.0).abs() <= 1e-3 * expected, "{place}");
            assert!((red - expected / 3.0).abs() <= 1e-3 * expected, "{place}");
        }
    }
}

#[test]
fn another_layout_is_rejected_by_name() {
    let specification = small_specification(1);
    let rejected = |change: fn(&mut Cheap), what: &str| {
        let mut cheap = Cheap::new(&specification, 0, 0);
        change(&mut cheap);
        let rejection = inspect(&cheap.encode(), &specification.image).unwrap_err();
        let message = rejection.to_string();
        assert!(message.contains(what), "{what}: {message}");
    };
    rejected(|cheap| cheap.film.width = 17, "data window's size");
    rejected(|cheap| cheap.film.height = 4096, "data window's size");
    rejected(|cheap| cheap.film.pixel = Pixel::Float, "pixel type");
    rejected(|cheap| cheap.channels = &["B", "G"], "list of channels");
    rejected(
        |cheap| cheap.channels = &["A", "B", "G", "R"],
        "list of channels",
    );
    rejected(
        |cheap| cheap.encoding.compression = Compression::RLE,
        "compression",
    );
    rejected(
        |cheap| cheap.encoding.line_order = LineOrder::Decreasing,
        "line order",
    );
    rejected(
        |cheap| cheap.encoding.blocks = Blocks::Tiles(Vec2(16, 16)),
        "block layout",
    );
    rejected(|cheap| cheap.attribute = "other", "missing");
    rejected(|cheap| cheap.header = "{}".to_owned(), "no image header");
    rejected(
        |cheap| cheap.header = format!("\"{}\"", "x".repeat(70_000)),
        "more than",
    );
    rejected(|cheap| cheap.value = -1.0, "negative");
    rejected(|cheap| cheap.value = f32::NAN, "not finite");
    rejected(|cheap| cheap.value = f32::INFINITY, "not finite");
}

#[test]
fn another_image_is_rejected_by_what_differs() {
    let specification = small_specification(5);
    let bytes = cheap_image(&specification, 3, 1);
    let header = inspect(&bytes, &specification.image).unwrap();
    let expected = expected_headers(&specification, specification.hash(), 3)[1].clone();
    let rejected = |change: fn(&mut dataset::ImageHeader), what: &str| {
        let mut other = expected.clone();
        change(&mut other);
        let message = check_identity(&header, &other).unwrap_err().to_string();
        assert!(message.contains(what), "{what}: {message}");
    };
    rejected(|other| other.material = Some(4), "material");
    rejected(|other| other.view = 2, "view");
    rejected(|other| other.seed += 1, "seed");
    rejected(|other| other.specification.push('0'), "specification");
    rejected(|other| other.renderer_version.push('0'), "renderer version");
    rejected(|other| other.parameters.ior += 1e-9, "material parameters");
}

#[test]
fn bytes_of_another_digest_are_rejected() {
    let rejection = check_digest(b"some bytes", Digest::of(b"others")).unwrap_err();
    assert!(matches!(rejection, Rejection::Digest { .. }));
}

/// Every bit of a whole file flipped in turn, and the file cut at every length: nothing panics
/// through, nothing asks for much memory, and whatever is accepted says the same of itself.
#[test]
fn damage_is_rejected_within_bounded_memory() {
    let specification = small_specification(1);
    let film = &specification.image;
    let whole = cheap_image(&specification, 0, 0);
    let header = inspect(&whole, film).unwrap();
    let json = serde_json::to_vec(&header).unwrap();
    let attribute = whole
        .windows(json.len())
        .position(|window| window == json)
        .unwrap();
    let attribute = attribute..attribute + json.len();
    let before = peak_memory_kib();
    for length in 0..whole.len() {
        assert!(inspect(&whole[..length], film).is_err(), "cut at {length}");
    }
    let mut rejected = 0;
    for place in 0..whole.len() {
        for bit in 0..8 {
            let mut damaged = whole.clone();
            damaged[place] ^= 1 << bit;
            match inspect(&damaged, film) {
                Ok(found) if found == header => {}
                Ok(_) => assert!(attribute.contains(&place), "{place} {bit}"),
                Err(_) => rejected += 1,
            }
        }
    }
    // What is left are bits that say nothing: paddings, unused attributes, parts of strings.
    assert!(rejected > 6 * whole.len(), "{rejected}");
    let grown = peak_memory_kib() - before;
    assert!(grown < 64 << 10, "{grown} KiB");
}

fn peak_memory_kib() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap();
    let line = status
        .lines()
        .find_map(|line| line.strip_prefix("VmHWM:"))
        .unwrap();
    line.trim().trim_end_matches(" kB").parse().unwrap()
}
