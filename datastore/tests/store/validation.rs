use crate::cheap_image::{Cheap, cheap_image, small_specification};
use dataset::{
    Digest, IMAGE_HEADER_ATTRIBUTE, Specification, image_file_header, specification::Pixel,
};
use exr::prelude::{Blocks, Compression, LineOrder, Vec2};
use imagestore::inspector::{Inspector, Likely};
use imagestore::validation::{
    Rejection, check_digest, check_identity, check_size, decode, expected_headers, image_bytes_max,
    inspect,
};
use std::{ops::Range, sync::Arc};

#[test]
fn images_as_the_renderer_writes_them_are_accepted() {
    let mut specification = small_specification(5);
    for pixel in [Pixel::Half, Pixel::Float] {
        specification.image.pixel = pixel;
        let bytes = cheap_image(&specification, 4, 2);
        check_digest(&bytes, Digest::of(&bytes)).unwrap();
        let header = inspect(&bytes, &specification).unwrap();
        let expected = expected_headers(&specification, specification.hash(), 4);
        check_identity(&header, &expected[2]).unwrap();

        let decoded = decode(&bytes, &specification).unwrap();
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
        let rejection = inspect(&cheap.encode(), &specification).unwrap_err();
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
    rejected(|cheap| cheap.header.push(' '), "another value");
    rejected(|cheap| cheap.white_luminance *= 2.0, "whiteLuminance");
    rejected(|cheap| cheap.value = -1.0, "negative");
    rejected(|cheap| cheap.value = f32::NAN, "not finite");
    rejected(|cheap| cheap.value = f32::INFINITY, "not finite");
}

/// An attribute as a file has it.
fn attribute(name: &str, kind: &str, value: &[u8]) -> Vec<u8> {
    let size = (value.len() as u32).to_le_bytes();
    let parts = [name.as_bytes(), &[0], kind.as_bytes(), &[0], &size, value];
    parts.concat()
}

/// Where an attribute stands in a file.
fn place(file: &[u8], name: &str, kind: &str) -> Range<usize> {
    let begin = [name.as_bytes(), &[0], kind.as_bytes(), &[0]].concat();
    let start = file
        .windows(begin.len())
        .position(|window| window == begin)
        .unwrap();
    let value = start + begin.len() + 4;
    let size = u32::from_le_bytes(file[value - 4..value].try_into().unwrap());
    start..value + size as usize
}

/// The file with a part of its header replaced; its blocks stay where its table says.
fn replaced(specification: &Specification, part: Range<usize>, by: &[u8]) -> Vec<u8> {
    let file = cheap_image(specification, 0, 0);
    let header = &expected_headers(specification, specification.hash(), 0)[0];
    let header = image_file_header(specification, header).len();
    let blocks = specification.image.height.div_ceil(16) as usize;
    let mut new = [&file[..part.start], by, &file[part.end..header]].concat();
    let moved = new.len() as u64;
    for place in file[header..].chunks_exact(8).take(blocks) {
        let place = u64::from_le_bytes(place.try_into().unwrap());
        new.extend((place + moved - header as u64).to_le_bytes());
    }
    new.extend(&file[header + 8 * blocks..]);
    new
}

/// Must show 5: whatever else could stand in a header is refused with the reason.
#[test]
fn a_header_is_the_renderers_byte_for_byte() {
    let specification = small_specification(1);
    let file = cheap_image(&specification, 0, 0);
    let header = &expected_headers(&specification, specification.hash(), 0)[0];
    assert!(file.starts_with(&image_file_header(&specification, header)));
    let unchanged = place(&file, "software", "string");
    let same = replaced(&specification, unchanged.clone(), &file[unchanged.clone()]);
    assert_eq!(same, file, "the test itself is sound");

    let end = place(&file, IMAGE_HEADER_ATTRIBUTE, "string").end;
    let rejected = |part: Range<usize>, by: &[u8], what: &str| {
        let changed = replaced(&specification, part, by);
        let rejection = inspect(&changed, &specification).unwrap_err();
        assert!(matches!(rejection, Rejection::FileHeader(_)), "{rejection}");
        let message = rejection.to_string();
        assert!(message.contains(what), "{what}: {message}");
    };
    let added = "which the renderer does not write";
    let junk = attribute("junk", "string", &[b'j'; 5000]);
    rejected(end..end, &junk, added);
    rejected(end..end, &junk, "\"junk\"");
    rejected(8..8, &junk, added);
    let owner = attribute("owner", "string", b"somebody");
    rejected(end..end, &owner, added);
    // One by one pixels.
    let preview = [&[1, 0, 0, 0, 1, 0, 0, 0][..], &[9; 4]].concat();
    rejected(end..end, &attribute("preview", "preview", &preview), added);
    let longer = attribute("software", "string", b"brdfarm and more");
    rejected(unchanged.clone(), &longer, "\"software\"");
    rejected(unchanged.clone(), &[], "lacks the attribute \"software\"");
    // Another order: what stands first comes last.
    let moved = [&file[unchanged.end..end], &file[unchanged.clone()]].concat();
    rejected(unchanged.start..end, &moved, "where the renderer");
    let twice = [&file[unchanged.clone()], &file[unchanged.clone()]].concat();
    rejected(unchanged, &twice, "where the renderer");
}

#[test]
fn blocks_follow_each_other_without_a_gap_and_are_no_larger_than_raw_pixels() {
    let specification = small_specification(1);
    let file = cheap_image(&specification, 0, 0);
    let header = &expected_headers(&specification, specification.hash(), 0)[0];
    let table = image_file_header(&specification, header).len();
    let first = table + 2 * 8;
    let rejected = |file: &[u8], what: &str| {
        let message = inspect(file, &specification).unwrap_err().to_string();
        assert!(message.contains(what), "{what}: {message}");
    };
    rejected(&[&file[..], b"junk"].concat(), "size in bytes");
    // A gap before the second block, which the table knows of.
    let second = u64::from_le_bytes(file[table + 8..first].try_into().unwrap()) as usize;
    let mut gap = [&file[..second], b"junk", &file[second..]].concat();
    gap[table + 8..first].copy_from_slice(&(second as u64 + 4).to_le_bytes());
    rejected(&gap, "place of a block");
    // A first block that is larger than its pixels.
    let raw = 16 * 16 * 3 * 2;
    let mut large = file[..first + 4].to_vec();
    large.extend((raw + 1_u32).to_le_bytes());
    large.extend(vec![0; raw as usize + 1]);
    rejected(&large, "at most 1536");

    let most = image_bytes_max(&specification, header);
    assert_eq!(most as usize, first + 2 * 8 + 20 * 16 * 3 * 2);
    check_size(most, &specification, header).unwrap();
    let message = check_size(most + 1, &specification, header).unwrap_err();
    assert!(message.to_string().contains("at most"), "{message}");
}

#[test]
fn another_image_is_rejected_by_what_differs() {
    let specification = small_specification(5);
    let bytes = cheap_image(&specification, 3, 1);
    let header = inspect(&bytes, &specification).unwrap();
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
    let whole = cheap_image(&specification, 0, 0);
    let header = inspect(&whole, &specification).unwrap();
    let json = serde_json::to_vec(&header).unwrap();
    let attribute = whole
        .windows(json.len())
        .position(|window| window == json)
        .unwrap();
    let attribute = attribute..attribute + json.len();
    let blocks = image_file_header(&specification, &header).len() + 2 * 8;
    let inspector = Inspector::new(Arc::new(specification.clone()));
    let text = header.to_json();
    let likely = Likely {
        header: &header,
        text: &text,
    };
    let before = peak_memory_kib();
    for length in 0..whole.len() {
        let inspected = inspect(&whole[..length], &specification);
        assert!(inspected.is_err(), "cut at {length}");
        for likely in [Some(&likely), None] {
            assert!(inspector.inspect(&whole[..length], likely).is_err());
        }
    }
    let mut rejected = 0;
    for place in 0..whole.len() {
        for bit in 0..8 {
            let mut damaged = whole.clone();
            damaged[place] ^= 1 << bit;
            let inspected = inspect(&damaged, &specification);
            for likely in [Some(&likely), None] {
                let sooner = inspector.inspect(&damaged, likely);
                assert_eq!(sooner.ok(), inspected.clone().ok(), "{place} {bit}");
            }
            match inspected {
                Ok(found) if found == header => {
                    assert!(place >= blocks, "byte {place} of the header, bit {bit}");
                }
                Ok(_) => assert!(attribute.contains(&place), "{place} {bit}"),
                Err(_) => rejected += 1,
            }
        }
    }
    // What is left are numbers that the image says of itself.
    assert!(rejected > 7 * whole.len(), "{rejected}");
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
