use crate::{
    bench::{Bench, Puppet},
    cheap_image::cheap_image,
};
use coordinator::{Coordinator, CoordinatorError, Options};
use dataset::{Digest, RENDERER_VERSION};
use datastore::Store;
use limits::protocol;
use proto::client::{Credentials, with_deadline};
use tonic::Code;

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_worker_of_another_version_or_reading_is_told_what_to_install() {
    let bench = Bench::new(1);
    let coordinator = bench.coordinator().await;
    let mut client = proto::client::farm(&coordinator.url(), &Credentials::default()).unwrap();
    let right = proto::RegisterRequest {
        name: "w".to_owned(),
        renderer_version: RENDERER_VERSION.to_owned(),
        specification_hash: bench.specification.hash().as_bytes().to_vec(),
        worker_id: Vec::new(),
        resolves_disputes: false,
    };
    assert!(client.register(with_deadline(right.clone())).await.is_ok());
    let other_version = proto::RegisterRequest {
        renderer_version: "0.9".to_owned(),
        ..right.clone()
    };
    let other_reading = proto::RegisterRequest {
        specification_hash: vec![7; 32],
        ..right.clone()
    };
    for message in [other_version, other_reading] {
        let refused = client.register(with_deadline(message)).await.unwrap_err();
        assert_eq!(refused.code(), Code::FailedPrecondition);
        assert!(refused.message().contains("install"), "{refused}");
    }
    for (name, worker_id, hash) in [
        ("", vec![], vec![1; 32]),
        (&*"x".repeat(200), vec![], vec![1; 32]),
        ("w", vec![1; 3], vec![1; 32]),
        ("w", vec![], vec![1; 31]),
    ] {
        let message = proto::RegisterRequest {
            name: name.to_owned(),
            worker_id,
            specification_hash: hash,
            ..right.clone()
        };
        let refused = client.register(with_deadline(message)).await.unwrap_err();
        assert_eq!(refused.code(), Code::InvalidArgument);
    }
    coordinator.shutdown().await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn what_is_no_image_of_the_set_is_not_taken() {
    let bench = Bench::new(3);
    let coordinator = bench.coordinator().await;
    let mut puppet = Puppet::register(&bench, &coordinator.url()).await;
    let token = puppet.lease_one().await.token;
    let image = cheap_image(&bench.specification, 0, 0);
    let mut larger = bench.specification.clone();
    larger.image.width = 4096;
    let larger = cheap_image(&larger, 0, 0);
    let noise = b"no image at all".to_vec();
    let oversized = vec![0; protocol::BLOB_BYTES_MAX as usize + 1];
    for (digest, bytes, what) in [
        (Digest::of(b"other"), image.clone(), "digest"),
        (Digest::of(&larger), larger.clone(), "at most"),
        (Digest::of(&noise), noise.clone(), "no EXR"),
        (Digest::of(&oversized), oversized.clone(), "at most"),
    ] {
        let refused = puppet.put(0, digest, bytes).await.unwrap_err();
        assert_eq!(refused.code(), Code::InvalidArgument, "{refused}");
        assert!(refused.message().contains(what), "{refused}");
    }
    let message = proto::PutBlobRequest {
        digest: Digest::of(&image).as_bytes().to_vec(),
        size: image.len() as u64 - 1,
        data: image.clone().into(),
        token,
        material: 0,
    };
    let refused = puppet.client.put_blob(with_deadline(message)).await;
    assert_eq!(refused.unwrap_err().code(), Code::InvalidArgument);
    let staged = std::fs::read_dir(bench.path().join("staging")).unwrap();
    assert_eq!(staged.count(), 0);
    // The right one is, twice.
    for _ in 0..2 {
        let put = puppet.put(0, Digest::of(&image), image.clone()).await;
        put.unwrap();
    }
    coordinator.shutdown().await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn images_that_come_with_their_completion_are_checked_like_others() {
    let bench = Bench::new(3);
    let coordinator = bench.coordinator().await;
    let mut puppet = Puppet::register(&bench, &coordinator.url()).await;
    let job = puppet.lease_one().await;
    let images = puppet.images(0);
    let staged = || {
        std::fs::read_dir(bench.path().join("staging"))
            .unwrap()
            .count()
    };

    let refused = puppet.complete_bringing(&[9; 16], 0, &images).await;
    assert_eq!(refused.unwrap_err().code(), Code::FailedPrecondition);
    assert_eq!(staged(), 0, "no lease, no images");
    let noise = b"no image at all".to_vec();
    let large = vec![0; protocol::IMAGES_BROUGHT_BYTES_MAX as usize];
    for (odd, what) in [(noise, "no EXR"), (large, "PutBlob")] {
        let brought = [odd, images[1].clone(), images[2].clone()];
        let refused = puppet.complete_bringing(&job.token, 0, &brought).await;
        let refused = refused.unwrap_err();
        assert_eq!(refused.code(), Code::InvalidArgument, "{refused}");
        assert!(refused.message().contains(what), "{refused}");
    }
    let others = puppet.images(1);
    let refused = puppet.complete_bringing(&job.token, 0, &others).await;
    let refused = refused.unwrap_err();
    assert_eq!(refused.code(), Code::InvalidArgument, "{refused}");

    let answer = puppet.complete_bringing(&job.token, 0, &images).await;
    let answer = answer.unwrap();
    assert!(answer.missing.is_empty() && !answer.repeated);
    let answer = puppet.complete_bringing(&job.token, 0, &images).await;
    assert!(answer.unwrap().repeated);
    coordinator.shutdown().await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_completion_needs_every_image_and_the_right_ones() {
    let bench = Bench::new(3);
    let coordinator = bench.coordinator().await;
    let mut puppet = Puppet::register(&bench, &coordinator.url()).await;
    let job = puppet.lease_one().await;
    puppet.lease_one().await;
    let images = puppet.images(0);

    let answer = puppet.complete(&job.token, 0).await.unwrap();
    assert_eq!(answer.missing.len(), 3, "nothing was sent");
    puppet
        .put(0, Digest::of(&images[1]), images[1].clone())
        .await
        .unwrap();
    let answer = puppet.complete(&job.token, 0).await.unwrap();
    let expected = [0, 2].map(|view| Digest::of(&images[view]).as_bytes().to_vec());
    assert_eq!(answer.missing, expected);
    puppet.put_all(0).await;
    puppet.put_all(1).await;

    let foreign = puppet.images(1);
    let mut swapped = images.clone();
    swapped.swap(0, 1);
    for wrong in [&foreign, &swapped, &images[..2].to_vec()] {
        let refused = puppet
            .complete_with(&job.token, 0, wrong)
            .await
            .unwrap_err();
        assert_eq!(refused.code(), Code::InvalidArgument, "{refused}");
    }
    let refused = puppet.complete(&job.token, 1).await.unwrap_err();
    assert_eq!(
        refused.code(),
        Code::FailedPrecondition,
        "another job's token"
    );
    let refused = puppet.complete(&job.token, 77).await.unwrap_err();
    assert_eq!(refused.code(), Code::InvalidArgument, "no such material");
    assert_eq!(coordinator.progress().borrow().counts.completed, 0);

    puppet.complete(&job.token, 0).await.unwrap();
    assert_eq!(coordinator.progress().borrow().counts.completed, 1);
    coordinator.shutdown().await;
}

#[tokio::test]
async fn an_address_that_others_reach_has_to_be_asked_for() {
    let bench = Bench::new(1);
    let start = |insecure| {
        let store = Store::open_or_create(bench.path(), &bench.specification).unwrap();
        let options = Options {
            listen: ([0, 0, 0, 0], 0).into(),
            insecure,
            ..Options::default()
        };
        Coordinator::start(store, options)
    };
    let refused = start(false).await.err().unwrap();
    assert!(matches!(refused, CoordinatorError::Exposed(_)), "{refused}");
    start(true).await.unwrap().shutdown().await;
}

#[tokio::test]
async fn images_larger_than_a_message_are_refused_at_the_start() {
    let mut bench = Bench::new(1);
    bench.specification.image.width = 4096;
    bench.specification.image.height = 4096;
    let store = Store::open_or_create(bench.path(), &bench.specification).unwrap();
    let refused = Coordinator::start(store, Options::default()).await;
    let refused = refused.err().unwrap();
    assert!(matches!(refused, CoordinatorError::ImageTooLarge { .. }));
}
