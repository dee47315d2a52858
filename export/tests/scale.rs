//! A synthetic store of the full size, for `tests/scale.sh`.

#![allow(clippy::unwrap_used, reason = "a panic here is a failed test")]

use dataset::{CompletedView, Digest, ErrorStatistics, PixelStatistics, Specification};
use datastore::Store;
use exr::prelude::*;
use jobqueue::Completion;
use std::{env, io::Cursor, path::PathBuf};

/// Bytes of an image: what the preset's images have in the mean.
const IMAGE_BYTES: u32 = 36_000;

/// Materials that become durable together.
const BATCH_MATERIALS: u32 = 100;

/// A black image that every reader opens, with bytes behind it that no compressor shrinks: an
/// export of images as they are decodes those of the card alone.
fn image(black: &[u8], material: u32, view: u32) -> Vec<u8> {
    let mut hasher = blake3::Hasher::new();
    hasher.update(&material.to_le_bytes());
    hasher.update(&view.to_le_bytes());
    // Sizes vary as those of images do.
    let size = IMAGE_BYTES - 8_000 + (material * 14 + view) % 16_000;
    let mut bytes = black.to_vec();
    bytes.resize(size as usize, 0);
    hasher.finalize_xof().fill(&mut bytes[black.len()..]);
    bytes
}

fn black(specification: &Specification) -> Vec<u8> {
    let size = (
        specification.image.width as usize,
        specification.image.height as usize,
    );
    let zero = f16::from_f32(0.0);
    let channels = SpecificChannels::rgb(|_: Vec2<usize>| (zero, zero, zero));
    let mut bytes = Vec::new();
    Image::from_channels(size, channels)
        .write()
        .to_buffered(Cursor::new(&mut bytes))
        .unwrap();
    bytes
}

#[test]
#[ignore = "writes 4.5 GB: tests/scale.sh runs it"]
fn make_a_store_of_126_000_images() {
    let path = PathBuf::from(env::var_os("BRDFARM_SCALE_STORE").expect("BRDFARM_SCALE_STORE"));
    let specification = Specification::preset();
    let black = black(&specification);
    let mut store = Store::open_or_create(&path, &specification).unwrap();
    for first in (0..specification.materials).step_by(BATCH_MATERIALS as usize) {
        let (mut completions, mut images) = (Vec::new(), Vec::new());
        for material in first..(first + BATCH_MATERIALS).min(specification.materials) {
            let mut views = Vec::new();
            for view in 0..specification.views.len() as u32 {
                let bytes = image(&black, material, view);
                let digest = Digest::of(&bytes);
                views.push(CompletedView {
                    digest,
                    bytes: bytes.len() as u64,
                    statistics: ErrorStatistics {
                        mean: 1e-5 * f64::from(1 + material % 97),
                        p95: 1e-4 / f64::from(1 + view),
                        max: 1e-3,
                        within_target: 1.0,
                        samples: 0,
                        evaluations: u64::from(material) * 1000,
                    },
                    pixels: Some(PixelStatistics {
                        sample_share: 0.2,
                        brightness_mean: 1e-2 / f64::from(1 + view),
                        brightness_p99: 0.1 + 0.2,
                        dark_share: 1e-3 * f64::from(material % 97),
                        above_white_share: 0.0,
                    }),
                });
                images.push((digest, bytes));
            }
            completions.push(Completion {
                material,
                views,
                seconds: 1.0,
                worker: "nobody".to_owned(),
            });
        }
        store.put(&completions, &images).unwrap();
    }
}
