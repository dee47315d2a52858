//! What workers send that is no image, or no name: bombs, other bytes than were named, paths.

use crate::cheap_image::{Cheap, cheap_image};
use crate::folder::below;
use crate::place::{Guest, MEMORY_MAX, SPECIFICATION, coordinator, memory_bytes, status, succeed};
use dataset::{Digest, RENDERER_VERSION, Specification, image_file_header};
use exr::prelude::Compression;
use imagestore::validation::expected_headers;
use proto::client::{self, Credentials, with_deadline};
use std::fs;
use std::path::Path;
use tonic::{Code, Status};

/// The largest image that a message can carry.
const BYTES_MAX: usize = limits::protocol::BLOB_BYTES_MAX as usize;

/// A zlib stream of `bytes` bytes that unpacks to 159 times as many zeros: one literal and then
/// repetitions of it, 258 at a time, in 13 bits each.
fn deflated_zeros(bytes: usize) -> Vec<u8> {
    let mut packed = vec![0x78, 0x01];
    let (mut bits, mut count) = (0u32, 0);
    let mut push = |packed: &mut Vec<u8>, code: u32, length: u32| {
        bits |= code << count;
        count += length;
        while count >= 8 {
            packed.push(bits as u8);
            bits >>= 8;
            count -= 8;
        }
    };
    // The last block, with the fixed code, whose words stand with their first bit lowest.
    push(&mut packed, 0b011, 3);
    push(&mut packed, 0b0000_1100, 8);
    while packed.len() < bytes {
        push(&mut packed, 0b1010_0011, 8);
        push(&mut packed, 0, 5);
    }
    push(&mut packed, 0, 7);
    packed.extend([0; 5]);
    packed
}

/// An image whose first block unpacks to far more than the film has.
fn block_bomb(specification: &Specification) -> Vec<u8> {
    let image = cheap_image(specification, 0, 0);
    // The film is one block: its place in the file stands right before it.
    let table = (0..image.len() - 8).find(|place| {
        let word: [u8; 8] = image[*place..*place + 8].try_into().expect("8 bytes");
        u64::from_le_bytes(word) == *place as u64 + 8
    });
    let block = table.expect("a table of blocks") + 8;
    let packed = deflated_zeros(BYTES_MAX - (64 << 10));
    let mut bomb = image[..block + 4].to_vec();
    bomb.extend((packed.len() as u32).to_le_bytes());
    bomb.extend(packed);
    bomb
}

/// An image that says that it is larger than any memory.
fn window_bomb(specification: &Specification) -> Vec<u8> {
    let mut image = cheap_image(specification, 0, 0);
    let name = b"dataWindow\0box2i\0";
    let place = image.windows(name.len()).position(|found| found == name);
    // The size of the value, then its corners.
    let corner = place.expect("a data window") + name.len() + 4 + 8;
    for side in 0..2 {
        let place = corner + 4 * side;
        image[place..place + 4].copy_from_slice(&(i32::MAX - 1).to_le_bytes());
    }
    image
}

/// An honest image of another film: a small file, and a hundred megabytes of pixels.
fn film_bomb(specification: &Specification) -> Vec<u8> {
    let mut large = Cheap::new(specification, 0, 0);
    large.film.width = 4096;
    large.film.height = 4096;
    large.value = 0.0;
    large.encode()
}

#[tokio::test]
async fn bombs_and_bytes_with_another_digest_are_refused_in_bounded_memory() {
    let directory = tempfile::tempdir().expect("a directory");
    let directory = directory.path();
    let (coordinator, url) = coordinator(directory, "store", "");
    let specification = Specification::from_toml(SPECIFICATION, "spec.toml").expect("valid");
    let mut guest = Guest::leasing(&url, &Credentials::default()).await;
    let before = memory_bytes(&coordinator);
    let image = cheap_image(&specification, 0, 0);
    let other = Digest::of(b"other");
    for (name, bytes, digest) in [
        ("block", block_bomb(&specification), None),
        ("window", window_bomb(&specification), None),
        ("film", film_bomb(&specification), None),
        ("noise", vec![0x5a; BYTES_MAX], None),
        ("digest", image.clone(), Some(other)),
        (
            "flipped",
            [&image[..image.len() - 1], &[!image[image.len() - 1]]].concat(),
            Some(Digest::of(&image)),
        ),
    ] {
        assert!(bytes.len() <= BYTES_MAX, "{name} fits a message");
        for _ in 0..3 {
            let digest = digest.unwrap_or_else(|| Digest::of(&bytes));
            let refused = guest.put(digest, bytes.clone()).await;
            let refused = refused.expect_err(name);
            assert_eq!(refused.code(), Code::InvalidArgument, "{name}: {refused}");
        }
    }
    let grown = memory_bytes(&coordinator).saturating_sub(before);
    assert!(grown < MEMORY_MAX / 4, "{grown} bytes more");
    let staged = fs::read_dir(directory.join("store/staging")).expect("a folder");
    assert_eq!(staged.count(), 0, "something was taken in");
    guest.leave().await;
    assert_eq!(
        status(&url, &Credentials::default())
            .await
            .expect("an answer"),
        2
    );
    let work = format!("worker connect {url} --backend native");
    assert!(succeed(directory, &work).contains("28 images"));
}

/// A sound image with an attribute of `bytes` bytes more.
fn with_junk(specification: &Specification, bytes: usize) -> Vec<u8> {
    let file = cheap_image(specification, 0, 0);
    let headers = expected_headers(specification, specification.hash(), 0);
    let header = image_file_header(specification, &headers[0]).len();
    let mut junk = b"junk\0string\0".to_vec();
    junk.extend((bytes as u32).to_le_bytes());
    junk.resize(junk.len() + bytes, b'j');
    // The film is one block, whose place the table has; the header ends with a zero.
    let block = (header + 8 + junk.len()) as u64;
    [
        &file[..header - 1],
        &junk,
        &[0],
        &block.to_le_bytes(),
        &file[header + 8..],
    ]
    .concat()
}

/// Must show 5 of the trusted farm: what else a header could carry is refused with the reason.
#[tokio::test]
async fn headers_with_something_else_are_refused_with_the_reason() {
    let directory = tempfile::tempdir().expect("a directory");
    let directory = directory.path();
    let (_coordinator, url) = coordinator(directory, "store", "");
    let specification = Specification::from_toml(SPECIFICATION, "spec.toml").expect("valid");
    let mut guest = Guest::leasing(&url, &Credentials::default()).await;
    assert_eq!(guest.job.material, 0);
    let mut longer = Cheap::new(&specification, 0, 0);
    longer.header.push(' ');
    let mut packed = Cheap::new(&specification, 0, 0);
    packed.encoding.compression = Compression::RLE;
    let sound = cheap_image(&specification, 0, 0);
    for (bytes, what) in [
        (with_junk(&specification, 10), "has the attribute \"junk\""),
        (with_junk(&specification, 6 << 20), "size in bytes"),
        (
            longer.encode(),
            "another value of the attribute \"brdfarm\"",
        ),
        (packed.encode(), "compression"),
        (cheap_image(&specification, 1, 0), "material"),
        ([&sound[..], b"more"].concat(), "size in bytes"),
    ] {
        let refused = guest.put(Digest::of(&bytes), bytes).await.expect_err(what);
        assert_eq!(refused.code(), Code::InvalidArgument, "{refused}");
        assert!(refused.message().contains(what), "{what}: {refused}");
    }
    guest
        .put(Digest::of(&sound), sound)
        .await
        .expect("it is sound");
}

/// Requests in which a text stands for a digest, an identity or a token.
fn requests_with(
    text: &str,
) -> (
    proto::PutBlobRequest,
    proto::GetBlobRequest,
    proto::FindMissingBlobsRequest,
    proto::LeaseRequest,
    proto::FailRequest,
) {
    let bytes = text.as_bytes().to_vec();
    let put = proto::PutBlobRequest {
        digest: bytes.clone(),
        size: 4,
        data: b"data".to_vec().into(),
        ..proto::PutBlobRequest::default()
    };
    let get = proto::GetBlobRequest {
        digest: bytes.clone(),
    };
    let find = proto::FindMissingBlobsRequest {
        digests: vec![bytes.clone()],
        ..proto::FindMissingBlobsRequest::default()
    };
    let lease = proto::LeaseRequest {
        worker_id: bytes.clone(),
        jobs_max: 1,
        wait_ms: 0,
    };
    let fail = proto::FailRequest {
        token: bytes,
        material: 0,
        error: text.to_owned(),
    };
    (put, get, find, lease, fail)
}

#[tokio::test]
async fn what_is_sent_never_becomes_a_path() {
    let directory = tempfile::tempdir().expect("a directory");
    let directory = directory.path();
    let (_coordinator, url) = coordinator(directory, "inner/store", "");
    let specification = Specification::from_toml(SPECIFICATION, "spec.toml").expect("valid");
    let nobody = Credentials::default();
    let mut farm = client::farm(&url, &nobody).expect("a client");
    let mut control = client::control(&url, &nobody).expect("a client");
    let before = below(directory);
    for path in [
        "../../../../escaped",
        "/tmp/escaped",
        "..",
        "staging/../../escaped",
    ] {
        let refused = |answer: Result<(), Status>| {
            let refused = answer.expect_err(path);
            assert_eq!(refused.code(), Code::InvalidArgument, "{path}: {refused}");
        };
        let (put, get, find, lease, fail) = requests_with(path);
        refused(farm.put_blob(with_deadline(put)).await.map(drop));
        refused(control.get_blob(with_deadline(get)).await.map(drop));
        refused(farm.find_missing_blobs(with_deadline(find)).await.map(drop));
        refused(farm.lease(with_deadline(lease)).await.map(drop));
        refused(farm.fail(with_deadline(fail)).await.map(drop));
        // A name is a name, whatever it looks like.
        let register = proto::RegisterRequest {
            name: path.to_owned(),
            renderer_version: RENDERER_VERSION.to_owned(),
            specification_hash: specification.hash().as_bytes().to_vec(),
            worker_id: Vec::new(),
            resolves_disputes: false,
        };
        farm.register(with_deadline(register))
            .await
            .expect("a name");
        let bar = proto::BarWorkerRequest {
            name: path.to_owned(),
            reason: path.to_owned(),
        };
        control.bar_worker(with_deadline(bar)).await.expect("a bar");
    }
    let beyond_the_set = proto::CompleteRequest {
        token: vec![0; 16],
        material: u32::MAX,
        views: Vec::new(),
        seconds: 0.0,
    };
    let refused = farm.complete(with_deadline(beyond_the_set)).await;
    assert_eq!(
        refused.expect_err("no material").code(),
        Code::InvalidArgument
    );
    assert_eq!(below(directory), before);
    assert!(!Path::new("/tmp/escaped").exists());
    let work = format!("worker connect {url} --backend native --name honest");
    assert!(succeed(directory, &work).contains("28 images"));
}
