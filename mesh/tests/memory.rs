//! How much memory and time refusals take. One test, alone in its process, whose memory it measures.

#![allow(
    clippy::unwrap_used,
    reason = "a panic here is a failed test, which says where"
)]

use mesh::Mesh;
use std::{fs, time::Instant};

/// Seconds that a refusal may take; most take milliseconds, and machines are shared.
const REFUSAL_SECONDS_MAX: f64 = 5.0;

/// The most memory that the process has held at one time.
fn peak_bytes() -> usize {
    let status = fs::read_to_string("/proc/self/status").unwrap();
    let line = status.lines().find(|line| line.starts_with("VmHWM:"));
    let kib: usize = line
        .unwrap()
        .split_whitespace()
        .nth(1)
        .unwrap()
        .parse()
        .unwrap();
    kib << 10
}

/// Reads bytes that must be refused, and returns the sentence.
#[track_caller]
fn refused(bytes: &[u8], extra_bytes_max: usize) -> String {
    let (before, start) = (peak_bytes(), Instant::now());
    let error = Mesh::read(bytes).unwrap_err();
    let seconds = start.elapsed().as_secs_f64();
    assert!(seconds < REFUSAL_SECONDS_MAX, "{seconds} s: {error}");
    let extra = peak_bytes() - before;
    assert!(extra <= extra_bytes_max, "{extra} bytes: {error}");
    error.to_string()
}

fn header(vertices: u64, faces: u64) -> String {
    format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex {vertices}\nproperty uchar x\n\
         property uchar y\nproperty uchar z\nelement face {faces}\n\
         property list uint uint vertex_indices\nend_header\n"
    )
}

#[test]
fn refusals_take_little_memory_and_time() {
    const SMALL: usize = 4 << 20;
    let mut claims = header(4_000_000_000, 1).into_bytes();
    claims.resize(1024, 0);
    let sentence = refused(&claims, SMALL);
    assert!(
        sentence.contains("announces 4000000000 of element `vertex`"),
        "{sentence}"
    );
    refused(header(u64::MAX, u64::MAX).as_bytes(), SMALL);
    let text = header(4_000_000_000, 1).replace("binary_little_endian", "ascii");
    refused(text.as_bytes(), SMALL);
    let mut list = header(1, 1).into_bytes();
    list.extend([0, 0, 0, 255, 255, 255, 255]);
    let sentence = refused(&list, SMALL);
    assert!(
        sentence.contains("face 0: the face has 4294967295 corners"),
        "{sentence}"
    );

    let mut state = 1_u64;
    let mut noise: Vec<u8> = std::iter::repeat_with(|| {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1);
        (state >> 56) as u8
    })
    .take(64 << 20)
    .collect();
    refused(&noise, SMALL);
    noise[..4].copy_from_slice(b"ply\n");
    refused(&noise, SMALL);
    let start = header(1 << 21, 1 << 21);
    noise[..start.len()].copy_from_slice(start.as_bytes());
    refused(&noise, 2 * (64 << 20));
    noise.fill(b' ');
    refused(&noise, SMALL);
    noise.fill(b'\n');
    refused(&noise, SMALL);
    noise[1] = b'f';
    for byte in [b' ', b'1', b'/', b'\\', b'-'] {
        noise[2..].fill(byte);
        refused(&noise, 64 << 20);
    }
    // Continuations all the way: the longest line that there can be.
    for pair in noise.chunks_exact_mut(2) {
        pair.copy_from_slice(b"\\\n");
    }
    refused(&noise, 2 * (64 << 20));
}
