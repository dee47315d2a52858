//! What a server makes of the URLs that are signed for workers.

use crate::liar::put;
use imagestore::bucket::{Bucket, BucketUrl};
use md5::{Digest, Md5};
use proto::{Header, UploadUrl};
use std::collections::BTreeSet;
use std::env;
use std::thread;
use std::time::Duration;

const IMAGE: &[u8] = b"an image, as it was rendered";
const OTHER: &[u8] = b"an image, as it was altered!";

/// A URL for the image, good for this many seconds, as a worker gets it.
fn sign(bucket: &Bucket, key: &str, seconds: u64) -> UploadUrl {
    let md5 = Md5::digest(IMAGE).into();
    let signed = bucket.upload_url(key, md5, Duration::from_secs(seconds));
    let signed = bucket.block_on(signed).expect("signed");
    let headers = signed.headers.into_iter();
    UploadUrl {
        url: signed.url,
        headers: headers
            .map(|(name, value)| Header { name, value })
            .collect(),
    }
}

fn is_taken(status: u16) -> bool {
    (200..300).contains(&status)
}

/// `BRDFARM_TEST_BUCKET` is a place in a bucket, whose keys are in the environment as for the
/// program, and `BRDFARM_TEST_REFUSES` names the misuses that its server has to refuse, between
/// commas. `tests/buckets.sh` runs this on every emulator.
#[test]
#[ignore = "wants a bucket: tests/buckets.sh runs it"]
fn a_signed_url_takes_what_was_signed_and_a_misuse_is_refused() {
    let place = env::var("BRDFARM_TEST_BUCKET").expect("BRDFARM_TEST_BUCKET names a bucket");
    let refuses = env::var("BRDFARM_TEST_REFUSES").expect("BRDFARM_TEST_REFUSES names misuses");
    let url: BucketUrl = place.parse().expect("the URL of a bucket");
    let bucket = Bucket::open(&url).expect("a bucket");

    let signed = sign(&bucket, "image", 600);
    // A worker that did not hear the answer sends again.
    for _ in 0..2 {
        let status = put(&signed, IMAGE);
        assert!(is_taken(status), "{status}");
    }
    let there = bucket.block_on(bucket.read("image", IMAGE.len() as u64));
    assert_eq!(there.expect("read"), IMAGE);

    let mut undeclared = signed.clone();
    undeclared
        .headers
        .retain(|header| header.name != "content-md5");
    let mut elsewhere = sign(&bucket, "image", 600);
    elsewhere.url = elsewhere.url.replacen("image?", "other?", 1);
    let late = sign(&bucket, "late", 1);
    thread::sleep(Duration::from_secs(3));
    let misuses = [
        ("damaged", put(&signed, OTHER)),
        ("undeclared", put(&undeclared, OTHER)),
        ("elsewhere", put(&elsewhere, IMAGE)),
        ("late", put(&late, IMAGE)),
    ];
    for (name, status) in &misuses {
        println!("{name}: {status}");
    }
    let refused = misuses.iter().filter(|(_, status)| !is_taken(*status));
    let refused: BTreeSet<&str> = refused.map(|(name, _)| *name).collect();
    let expected = refuses.split(',').filter(|name| !name.is_empty());
    assert_eq!(refused, expected.collect());
}
