//! What everything costs: every service time of the simulation, and where it was measured.

use std::time::Duration;

/// Processor time of an image of 128 x 128, seconds, in the mean over the paper's set (README, the
/// whole set).
pub const IMAGE_SECONDS: f64 = 0.0208;

/// Bytes of an image for each of its pixels (README: 126,000 images of 128 x 128 in 1.53 GB).
pub const BYTES_PER_PIXEL: f64 = 0.74;

/// The standard deviation of the logarithm of a material's time. With it the dearest 1 percent of
/// the materials take 15 percent of the time, and the dearest 10 percent half of it: README has 17
/// and 50 percent (version 4), and 14 and 47 (version 7).
pub const MATERIAL_SIGMA: f64 = 1.28;

/// Service times; by default all are zero. "A core" is processor time of the machine named; what is waited for without one
/// says so.
#[derive(Clone, Copy, Debug, Default)]
pub struct Costs {
    /// Of the coordinator and its callers.
    pub calls: Calls,
    /// Of a store in a folder.
    pub files: Files,
    /// Of PostgreSQL.
    pub postgres: Postgres,
    /// Of a bucket.
    pub bucket: Bucket,
}

/// A call's processor time, a half of it before the job store or the images are asked.
#[derive(Clone, Copy, Debug, Default)]
pub struct Calls {
    /// The coordinator's, of a lease.
    pub lease: Duration,
    /// Of a renewal; of any other call that looks nothing up.
    pub renew: Duration,
    /// Of the question which images are missing.
    pub find: Duration,
    /// Of an image that is sent by itself, besides taking it in.
    pub upload: Duration,
    /// Of a completion, besides its images.
    pub complete: Duration,
    /// Taking in an image: digest, layout, pixels, a file. On an upload slot.
    pub take_in: Duration,
    /// The same, for each pixel.
    pub take_in_pixel_ns: f64,
    /// What an image waits for the disk, on its upload slot.
    pub take_in_wait: Duration,
    /// The caller's, of a lease.
    pub caller_lease: Duration,
    /// Of an image sent by itself.
    pub caller_upload: Duration,
    /// Of any other call.
    pub caller: Duration,
}

/// Group commit and publication.
#[derive(Clone, Copy, Debug, Default)]
pub struct Files {
    /// The commit thread's processor time for a batch.
    pub commit: Duration,
    /// For each lease in it.
    pub commit_lease: Duration,
    /// For each completion in it, besides its images.
    pub commit_completion: Duration,
    /// For each image of a completion.
    pub commit_image: Duration,
    /// What a batch waits for the disk.
    pub commit_sync: Duration,
    /// The publisher's processor time for a batch.
    pub publish: Duration,
    /// For each image in it.
    pub publish_image: Duration,
    /// What a batch waits for the disk.
    pub publish_sync: Duration,
    /// The same for each image in it.
    pub publish_sync_image: Duration,
    /// The same for each pixel of each image in it.
    pub publish_sync_pixel_ns: f64,
    /// Processor time of the runtime's threads, which a batch of either kind wakes.
    pub wake: Duration,
    /// Processor time of the kernel's own threads after a batch of either kind: file system and
    /// disk. Nobody waits for it.
    pub kernel: Duration,
    /// The same for each image that is published.
    pub kernel_image: Duration,
}

/// Transactions of `jobstore-postgres/src/turns.rs`.
#[derive(Clone, Copy, Debug, Default)]
pub struct Postgres {
    /// A transaction's processor time at the coordinator.
    pub coordinator: Duration,
    /// For each question in it, or lease that is renewed.
    pub coordinator_each: Duration,
    /// A transaction's processor time at the database.
    pub transaction: Duration,
    /// For each claim.
    pub claim: Duration,
    /// For each question where a completion would stand.
    pub standing: Duration,
    /// The question whether images are known, a statement by itself.
    pub look_up: Duration,
    /// For each lease that is renewed.
    pub renewal: Duration,
    /// For each completion.
    pub completion: Duration,
    /// For each image of a completion.
    pub image: Duration,
    /// What a commit waits for the disk; one sync serves all that wait.
    pub sync: Duration,
    /// Statements that wait for each other's answers.
    pub round_trips: u32,
}

/// Requests to a bucket. Not measured here.
#[derive(Clone, Copy, Debug, Default)]
pub struct Bucket {
    /// A coordinator's processor time for a request.
    pub request: Duration,
    /// How long a PUT takes.
    pub put: Duration,
    /// How long a HEAD and the COPY after it take.
    pub settle: Duration,
}

const fn us(microseconds: u64) -> Duration {
    Duration::from_micros(microseconds)
}

impl Costs {
    /// What was measured, on two virtual cores of an Intel Xeon with a virtual disk, beside other
    /// work.
    ///
    /// A cost "a call" and "a batch" are told apart by batches of different sizes: with 1, 8 and 64
    /// clients group commit takes 180, 240 and 520 us for 1, 8 and 63 leases.
    pub fn measured() -> Self {
        Self {
            calls: Calls::measured(),
            files: Files::measured(),
            postgres: Postgres::measured(),
            bucket: Bucket::assumed(),
        }
    }
}

impl Calls {
    /// `tests/throughput.sh costs`: processor time of coordinator and callers a call, 64 clients
    /// (large images: 32). A completion is told apart from its images by one of a small image, 205
    /// us, and one of 14 large ones, 2,976.
    fn measured() -> Self {
        Self {
            lease: us(50),
            renew: us(25),
            find: us(56),
            // A renewal's, and the bytes.
            upload: us(60),
            complete: us(149),
            take_in: us(54),
            take_in_pixel_ns: 9.0,
            // 32 clients have both upload slots busy.
            take_in_wait: us(150),
            caller_lease: us(38),
            caller_upload: us(60),
            caller: us(53),
        }
    }
}

impl Files {
    /// `tests/throughput.sh costs`: the commit thread's processor time and the time of a commit,
    /// the time of a publication, and the processor time of the kernel's threads.
    fn measured() -> Self {
        Self {
            commit: us(275),
            commit_lease: us(7),
            commit_completion: us(16),
            commit_image: us(5),
            commit_sync: us(1_000),
            publish: us(200),
            publish_image: us(15),
            publish_sync: us(1_500),
            publish_sync_image: us(20),
            publish_sync_pixel_ns: 3.7,
            // What a lease costs the runtime's threads is 320 us more with 1 client than with 64.
            wake: us(350),
            kernel: us(150),
            kernel_image: us(6),
        }
    }
}

impl Postgres {
    /// Unlike all others these are fitted to rates: those of `tests/postgres.sh measure` with 1 to
    /// 64 clients, 472, 928, 2,196 and 3,110 jobs of 14 images a second (and some 4,000 of one). The
    /// model gives 472, 1,295, 2,344 and 3,443 (and 3,792).
    ///
    /// The sync is what 1 client's time of a job leaves beside processor time. A renewal and the
    /// question after images were not measured: they are taken as a question
    /// where a completion stands, and as three.
    fn measured() -> Self {
        Self {
            coordinator: us(150),
            coordinator_each: us(18),
            transaction: us(235),
            claim: us(120),
            standing: us(20),
            look_up: us(60),
            renewal: us(20),
            completion: us(120),
            image: us(12),
            sync: us(240),
            round_trips: 5,
        }
    }
}

impl Bucket {
    /// Not measured: guesses of a provider's latencies in its own region, and of what a signed
    /// request by TLS costs the processor.
    fn assumed() -> Self {
        Self {
            request: us(100),
            put: us(30_000),
            settle: us(50_000),
        }
    }
}
