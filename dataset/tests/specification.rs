//! Reading specifications: what is refused and how, round trips, and what the hash sees.

use dataset::{
    Specification, SpecificationError,
    specification::{Pixel, Tint, View, limits},
};
use proptest::prelude::*;
use serde_json::Value;
use std::{fs, path::PathBuf};

const PRESET: &str = include_str!("../src/maxbrdf.toml");

fn refusal(text: &str) -> String {
    Specification::from_toml(text, "set.toml")
        .expect_err(text)
        .to_string()
}

/// A text and the sentence by which it is refused.
type Fault = (&'static str, &'static str);

/// Keys that there are not.
const UNKNOWN_KEYS: &[Fault] = &[
    (
        "widht = 3",
        "set.toml:1:1: unknown key `widht`; did you mean `image.width`?",
    ),
    (
        "[image]\nwidht = 3",
        "set.toml:2:1: unknown key `image.widht`; did you mean `image.width`?",
    ),
    (
        "[light]\ndistance = 1",
        "set.toml:2:1: unknown key `light.distance`; did you mean `light.distance_m`?",
    ),
    (
        "[camera]\nradius_m = 1",
        "set.toml:2:1: unknown key `camera.radius_m`; did you mean `light.radius_m`?",
    ),
    (
        "[[views]]\n[[views]]\nrotation = 1",
        "set.toml:3:1: unknown key `views[1].rotation`; did you mean \
         `views[1].rotation_deg`?",
    ),
    (
        "[sample]\nqqqq = 1",
        "set.toml:2:1: unknown key `sample.qqqq`; the keys here are shape, side_m, mesh",
    ),
];

/// Values of another type.
const WRONG_TYPES: &[Fault] = &[
    (
        "[image]\nwidth = 3.0",
        "set.toml:2:9: `image.width` must be an integer, but is the float 3.0",
    ),
    (
        "name = 2020-01-01",
        "set.toml:1:8: `name` must be a text, but is a date or time",
    ),
    (
        "tint = \"hues\"",
        "set.toml:1:8: `tint` must be \"hue\" or \"product\", but is the text \"hues\"",
    ),
    (
        "image = 3",
        "set.toml:1:9: `image` must be a table, but is the integer 3",
    ),
    (
        "[views]",
        "set.toml:1:1: `views` must be a list of views, but is a table",
    ),
    (
        "[[views]]\nchecker = 1",
        "set.toml:2:11: `views[0].checker` must be true or false, but is the integer 1",
    ),
    (
        "[parameters]\nior = [1, 2, 3]",
        "set.toml:2:7: `parameters.ior` must be a list of two numbers, [low, high], but is \
         a list of 3",
    ),
    (
        "[parameters]\nior = [1, \"é\"]",
        "set.toml:2:11: `parameters.ior[1]` must be a number, but is the text \"é\"",
    ),
    (
        "[checker]\npatches_srgb8 = [[1, 2, 256]]",
        "set.toml:2:25: `checker.patches_srgb8[0]` must be a colour of three integers, \
         [red, green, blue], 0 to 255 each, but is the integer 256",
    ),
];

/// Values that may not be.
const OUT_OF_RANGE: &[Fault] = &[
    (
        "materials = 0",
        "set.toml:1:13: `materials` is 0, but must be 1 to 1000000",
    ),
    (
        "seed = -1",
        "set.toml:1:8: `seed` is -1, but must be 0 to 9223372036854775807",
    ),
    (
        "[image]\nheight = 99999999999999999999999999999999999999999999999999",
        "set.toml:2:10: `image.height` is 9999999999999999999999999999999999999999..., but \
         must be 1 to 4096",
    ),
    (
        "[accuracy]\nabsolute = nan",
        "set.toml:2:12: `accuracy.absolute` is nan, but must be 1e-9 to 1",
    ),
    (
        "[accuracy]\nabsolute = 1e999",
        "set.toml:2:12: `accuracy.absolute` is 1e999, but must be 1e-9 to 1",
    ),
    (
        "[integrator]\nsamples_per_pixel = 100",
        "set.toml:2:21: `integrator.samples_per_pixel` is 100, but must be a power of two, \
         16 to 1048576",
    ),
    (
        "name = \"../x\"",
        "set.toml:1:8: `name` is \"../x\", but must be 1 to 64 of the characters \
         a-z A-Z 0-9 - _ . and start with a letter or digit",
    ),
    (
        "views = []",
        "set.toml:1:9: `views` has 0 entries, but must have 1 to 64",
    ),
    (
        "[parameters]\nior = [3, 2]",
        "set.toml:2:7: `parameters.ior` runs from 3 down to 2, but the lower end must come \
         first",
    ),
];

/// Values that do not go together; the place is that of the value which the file gives.
const WRONG_TOGETHER: &[Fault] = &[
    (
        "[checker]\ncolumns = 5",
        "set.toml:2:11: `checker.patches_srgb8` must have 30 colours, for 5 columns of 6 \
         rows, but has 24",
    ),
    (
        "[sample]\nside_m = 0.2",
        "set.toml:2:10: `checker.lower_edge_y_m` is 0.055, but must be at least half the \
         sample's side, 0.1, or the chart cuts the sample",
    ),
    (
        "[light]\nradius_m = 0.001",
        "set.toml:2:12: `light.radius_m` is so small that the bulb, (distance_m / \
         radius_m)^2 = 1000000 times white, is brighter than a half float holds (65504); \
         make it larger or set image.pixel to \"float\"",
    ),
    (
        "[light]\nradius_m = 0.75",
        "set.toml:2:12: `views[0].light_elevation_deg` puts the bulb's centre \
         0.7071067811865476 m above the sample's plane, but its radius is 0.75 m; the bulb \
         must be clear of the plane",
    ),
    (
        "[[views]]\nlight_elevation_deg = 15\nchecker = true",
        "set.toml:3:11: `views[0].checker` puts the bulb on or behind the plane of the \
         chart, which would shade the sample; raise the light, lower checker.tilt_deg or \
         leave the chart out",
    ),
    (
        "[camera]\ndistance_m = 1\n[[views]]\ncamera_elevation_deg = 90\n\
         light_elevation_deg = 90",
        "set.toml:4:24: `views[0].camera_elevation_deg` puts the camera inside the bulb; \
         move one of them",
    ),
];

/// What is no TOML.
const NO_TOML: &[Fault] = &[
    (
        "[image]\nwidth = 1\nwidth = 2",
        "set.toml:3:1: this is not TOML: duplicate key",
    ),
    (
        "[checker]\npatches_srgb8 = [[1, 2, 3],\n",
        "set.toml:2:28: this is not TOML: unclosed array, expected `]`; the file ends here: \
         is it cut short?",
    ),
];

#[test]
fn every_fault_is_one_sentence_with_its_place() {
    let faults = [
        UNKNOWN_KEYS,
        WRONG_TYPES,
        OUT_OF_RANGE,
        WRONG_TOGETHER,
        NO_TOML,
    ];
    for (text, expected) in faults.concat() {
        assert_eq!(refusal(text), expected, "{text}");
    }
}

#[test]
fn a_file_cut_anywhere_is_read_or_refused_in_one_sentence() {
    for end in 0..PRESET.len() {
        let Some(cut) = PRESET.get(..end) else {
            continue;
        };
        if let Err(error) = Specification::from_toml(cut, "cut.toml") {
            assert_is_sentence(&error.to_string(), "cut.toml:");
        }
    }
}

fn assert_is_sentence(sentence: &str, start: &str) {
    assert!(sentence.starts_with(start), "{sentence}");
    assert!(!sentence.contains(char::is_control), "{sentence:?}");
    assert!(sentence.len() < 500, "{sentence}");
}

fn written(name: &str, bytes: &[u8]) -> PathBuf {
    let path = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(name);
    fs::write(&path, bytes).expect("the folder for tests is writable");
    path
}

/// Bytes of a linear congruential generator.
fn noise(bytes: usize) -> Vec<u8> {
    let mut state = 1_u64;
    (0..bytes)
        .map(|_| {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1);
            (state >> 56) as u8
        })
        .collect()
}

#[test]
fn files_that_are_no_specification_are_refused_in_one_sentence() {
    let large = written("noise_10_mb.toml", &noise(10_000_000));
    let error = Specification::load(&large).unwrap_err();
    assert!(matches!(error, SpecificationError::TooLarge { .. }));
    assert_is_sentence(&error.to_string(), &large.display().to_string());

    let small = written("noise.toml", &noise(1000));
    let error = Specification::load(&small).unwrap_err();
    assert!(matches!(error, SpecificationError::NotUtf8 { .. }));
    assert_is_sentence(&error.to_string(), &small.display().to_string());

    let latin = written("latin1.toml", b"# gr\xfcn\n");
    let error = Specification::load(&latin).unwrap_err();
    assert!(matches!(
        error,
        SpecificationError::NotUtf8 { offset: 4, .. }
    ));

    let missing = small.with_file_name("no_such_file.toml");
    let error = Specification::load(&missing).unwrap_err();
    assert!(matches!(error, SpecificationError::Unreadable { .. }));
    assert_is_sentence(&error.to_string(), &missing.display().to_string());

    let error = Specification::load(&small.with_file_name("")).unwrap_err();
    assert!(
        matches!(error, SpecificationError::Unreadable { .. }),
        "a folder is no file"
    );
}

#[test]
fn texts_at_the_limit_of_size_are_read() {
    let mut text = "#".repeat(limits::TEXT_BYTES_MAX);
    assert_eq!(
        Specification::from_toml(&text, "").unwrap(),
        Specification::preset()
    );
    text.push('#');
    let error = Specification::from_toml(&text, "").unwrap_err();
    assert!(matches!(error, SpecificationError::TooLarge { .. }));
    let error = Specification::from_json(&text).unwrap_err();
    assert!(matches!(error, SpecificationError::TooLarge { .. }));
}

#[test]
fn nesting_and_repetition_exhaust_nothing() {
    for text in [
        "[".repeat(500_000),
        "a.".repeat(400_000),
        "x = ".to_owned() + &"[".repeat(500_000),
    ] {
        assert_is_sentence(&refusal(&text), "set.toml:1:");
    }
    let views = "[[views]]\n".repeat(65);
    let expected = "set.toml:1:1: `views` has 65 entries, but must have 1 to 64";
    assert_eq!(refusal(&views), expected);
}

#[test]
fn json_is_checked_like_a_file() {
    let json = Specification::preset().to_json();
    let bad = json.replace("\"width\":128", "\"width\":0");
    assert_eq!(
        Specification::from_json(&bad).unwrap_err().to_string(),
        "specification as JSON: `image.width` is 0, but must be 1 to 4096"
    );
    for bad in [
        "",
        "{}",
        &json[1..],
        &json.replace("\"width\"", "\"widht\""),
    ] {
        let sentence = Specification::from_json(bad).unwrap_err().to_string();
        assert_is_sentence(&sentence, "this is not a specification as JSON: ");
    }
}

#[test]
fn absent_fields_have_the_presets_values() {
    let preset = Specification::preset();
    assert_eq!(Specification::from_toml("", "").unwrap(), preset);
    assert_eq!(Specification::from_toml(PRESET, "").unwrap(), preset);
    let changed = Specification::from_toml("image.width = 64\n[light]\npower_w = 60", "").unwrap();
    assert_eq!((changed.image.width, changed.image.height), (64, 128));
    assert_eq!(
        (changed.light.power_w, changed.light.distance_m),
        (60.0, 1.0)
    );
    assert_eq!(changed.views, preset.views);
}

#[test]
fn given_views_replace_the_presets_and_are_plain_where_silent() {
    let read = Specification::from_toml("[[views]]\n[[views]]\nrotation_deg = 7", "").unwrap();
    let plain = View {
        camera_elevation_deg: 45.0,
        light_elevation_deg: 45.0,
        rotation_deg: 0.0,
        checker: false,
    };
    let turned = View {
        rotation_deg: 7.0,
        ..plain.clone()
    };
    assert_eq!(read.views, [plain, turned]);
}

#[test]
fn the_preset_is_the_papers_dataset() {
    let preset = Specification::preset();
    assert_eq!(
        (preset.name.as_str(), preset.materials, preset.views.len()),
        ("maxbrdf", 9000, 14)
    );
    assert_eq!(preset.views.iter().filter(|view| view.checker).count(), 9);
}

/// Every leaf of a tree with its path, as JSON pointers.
fn leaves(value: &Value, path: &str, found: &mut Vec<String>) {
    match value {
        Value::Object(fields) => fields
            .iter()
            .for_each(|(key, value)| leaves(value, &format!("{path}/{key}"), found)),
        Value::Array(values) => (values.iter().enumerate())
            .for_each(|(place, value)| leaves(value, &format!("{path}/{place}"), found)),
        _ => found.push(path.to_owned()),
    }
}

#[test]
fn the_hash_sees_every_value_but_name_and_materials() {
    let preset = Specification::preset();
    let tree: Value = serde_json::from_str(&preset.to_json()).unwrap();
    let mut paths = Vec::new();
    leaves(&tree, "", &mut paths);
    let mut hashes = vec![preset.hash()];
    for path in &paths {
        let mut changed = tree.clone();
        let leaf = changed.pointer_mut(path).unwrap();
        *leaf = match leaf {
            Value::Bool(truth) => (!*truth).into(),
            Value::Number(number) => match number.as_u64() {
                // Written without a point, though it may be a float's.
                Some(integer) if path.contains("srgb8") => (integer ^ 1).into(),
                Some(integer) => (integer + 1).into(),
                None => number.as_f64().unwrap().next_up().into(),
            },
            Value::String(text) => match text.as_str() {
                "maxbrdf" => "other".into(),
                "hue" => "product".into(),
                "half" => "float".into(),
                "hybrid" => "path".into(),
                _ => unreachable!("{path}"),
            },
            _ => unreachable!("{path}"),
        };
        let changed: Specification = serde_json::from_value(changed).unwrap();
        assert_ne!(changed, preset, "{path}");
        if path == "/name" || path == "/materials" {
            assert_eq!(changed.hash(), preset.hash(), "{path}");
        } else {
            hashes.push(changed.hash());
        }
    }
    let count = hashes.len();
    assert!(count > 150);
    hashes.sort();
    hashes.dedup();
    assert_eq!(hashes.len(), count, "no two changes have one hash");
}

fn ordered(range: std::ops::RangeInclusive<f64>) -> impl Strategy<Value = [f64; 2]> {
    (range.clone(), range).prop_map(|(a, b)| [a.min(b), a.max(b)])
}

/// Specifications that are in range everywhere.
fn specifications() -> impl Strategy<Value = Specification> {
    let view = (0.1..=90.0, 40.0..=90.0, limits::ROTATION_DEG, any::<bool>()).prop_map(
        |(camera_elevation_deg, light_elevation_deg, rotation_deg, checker)| View {
            camera_elevation_deg,
            light_elevation_deg,
            rotation_deg,
            checker,
        },
    );
    let head = (
        "[a-zA-Z0-9][a-zA-Z0-9._-]{0,63}",
        limits::SEED,
        limits::MATERIALS,
        any::<bool>(),
        (
            limits::IMAGE_SIDE_PIXELS,
            limits::IMAGE_SIDE_PIXELS,
            any::<bool>(),
        ),
        (limits::ACCURACY_ABSOLUTE, limits::ACCURACY_RELATIVE),
        (4..=20_u32, limits::BOUNCES),
    );
    let scene = (
        (
            ordered(limits::ROUGHNESS_PERCENT),
            ordered(limits::ANISOTROPY),
            ordered(limits::ANGLE_DEG),
            ordered(limits::IOR),
        ),
        (0.01..=0.9, limits::FILM_HALF_WIDTH),
        (
            limits::LIGHT_POWER_W,
            limits::LIGHT_EFFICACY_LM_PER_W,
            0.005..=0.05,
        ),
        prop::collection::vec(any::<[u8; 3]>(), 24),
        prop::collection::vec(view, limits::VIEWS),
    );
    (head, scene).prop_map(|(head, scene)| {
        let (name, seed, materials, product, image, accuracy, integrator) = head;
        let (parameters, camera, light, patches, views) = scene;
        let mut made = Specification::preset();
        made.name = name;
        made.seed = seed;
        made.materials = materials;
        made.tint = if product { Tint::Product } else { Tint::Hue };
        (made.image.width, made.image.height) = (image.0, image.1);
        made.image.pixel = if image.2 { Pixel::Half } else { Pixel::Float };
        (made.accuracy.absolute, made.accuracy.relative) = accuracy;
        made.integrator.samples_per_pixel = 1 << integrator.0;
        made.integrator.max_bounces = integrator.1;
        let fields = &mut made.parameters;
        (
            fields.roughness,
            fields.anisotropy,
            fields.angle_deg,
            fields.ior,
        ) = parameters;
        (made.camera.distance_m, made.camera.film_half_width) = camera;
        (
            made.light.power_w,
            made.light.efficacy_lm_per_w,
            made.light.radius_m,
        ) = light;
        made.checker.patches_srgb8 = patches;
        made.checker.tilt_deg = 20.0;
        made.views = views;
        made
    })
}

/// The preset with some of its text replaced.
fn mutated_presets() -> impl Strategy<Value = String> {
    let insert = prop_oneof![
        ".*",
        "[\\[\\]{}=,.\"'#\\n0-9a-z_-]{0,8}",
        Just("nan".to_owned()),
        Just("-1".to_owned()),
        Just("1e400".to_owned()),
    ];
    let edit = (any::<prop::sample::Index>(), 0..20_usize, insert);
    prop::collection::vec(edit, 1..4).prop_map(|edits| {
        let mut text = PRESET.to_owned();
        for (place, length, insert) in edits {
            let start = text.floor_char_boundary(place.index(text.len() + 1));
            let end = text.ceil_char_boundary((start + length).min(text.len()));
            text.replace_range(start..end, &insert);
        }
        text
    })
}

proptest! {
    #![proptest_config(ProptestConfig {
        failure_persistence: None,
        ..ProptestConfig::with_cases(400)
    })]

    #[test]
    fn toml_and_json_read_back_to_an_equal_value(made in specifications()) {
        let (toml, json) = (made.to_toml(), made.to_json());
        let from_toml = Specification::from_toml(&toml, "made.toml").unwrap();
        let from_json = Specification::from_json(&json).unwrap();
        prop_assert_eq!(&from_toml, &made);
        prop_assert_eq!(&from_json, &made);
        prop_assert_eq!(from_toml.hash(), made.hash());
        prop_assert_eq!(from_json.to_json(), json);
    }

    #[test]
    fn order_comments_and_stated_defaults_leave_the_hash_alone(
        made in specifications(),
        key in any::<u64>(),
    ) {
        // Values first, then tables in any order, and of each table the lines in any order.
        let toml = made.to_toml();
        let mut blocks = toml.split("\n[");
        let mut values: Vec<&str> = blocks.next().unwrap().lines().collect();
        let (views, mut tables): (Vec<_>, Vec<_>) = blocks.partition(|block| block.starts_with('['));
        let turn = (key % values.len() as u64) as usize;
        values.rotate_left(turn);
        let turn = (key / 7 % tables.len() as u64) as usize;
        tables.rotate_left(turn);
        let mut shuffled = values.join(" # why\n");
        for table in tables.into_iter().chain(views) {
            let mut lines: Vec<_> = table.trim_end().lines().collect();
            lines[1..].reverse();
            shuffled += &format!("\n# a comment\n[{}\n", lines.join("\n").replace(" = ", "="));
        }
        let read = Specification::from_toml(&shuffled, "shuffled.toml").unwrap();
        prop_assert_eq!(&read, &made);
        prop_assert_eq!(read.hash(), made.hash());
    }

    #[test]
    fn no_text_panics(text in any::<String>()) {
        if let Err(error) = Specification::from_toml(&text, "any.toml") {
            assert_is_sentence(&error.to_string(), "any.toml:");
        }
        if let Err(error) = Specification::from_json(&text) {
            assert_is_sentence(&error.to_string(), "this is not a specification as JSON: ");
        }
    }

    #[test]
    fn no_bytes_panic(bytes in any::<Vec<u8>>()) {
        let text = String::from_utf8_lossy(&bytes);
        if let Err(error) = Specification::from_toml(&text, "any.toml") {
            assert_is_sentence(&error.to_string(), "any.toml:");
        }
    }

    #[test]
    fn no_change_of_the_preset_panics_and_what_is_read_reads_back(text in mutated_presets()) {
        match Specification::from_toml(&text, "mutated.toml") {
            Err(error) => assert_is_sentence(&error.to_string(), "mutated.toml:"),
            Ok(read) => {
                let again = Specification::from_toml(&read.to_toml(), "again.toml").unwrap();
                prop_assert_eq!(again, read);
            }
        }
    }
}
