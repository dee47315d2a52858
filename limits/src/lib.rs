//! Every limit of the farm, with its unit: the coordinator's here, what both sides of the protocol
//! keep in [`protocol`], a worker's in [`worker`], those of pages in a browser in [`web`].

pub mod protocol;
pub mod web;
pub mod worker;

use std::time::Duration;

/// How long a lease lives without renewal.
pub const LEASE: Duration = Duration::from_secs(60);

/// How long a lease is prolonged while its progress stands still: the longest that one view may
/// take after the first. Before that a job may wait in its worker behind another.
pub const STALL: Duration = Duration::from_secs(3600);

/// How long a lease is prolonged at all: the longest that one material may take.
pub const JOB_DEADLINE: Duration = Duration::from_secs(6 * 3600);

/// Different workers on which one material fails before it is quarantined.
pub const WORKERS_FAILED_MAX: u32 = 3;

/// Failures after which a material is quarantined in a farm that has fewer workers than that.
pub const FAILURES_MAX: u32 = 6;

/// Different materials that a worker fails in a row before it is blocked.
pub const JOBS_FAILED_MAX: u32 = 3;

/// Failures in a row that are kept of a worker. A policy that allows more blocks nobody.
pub const WORKER_FAILURES_KEPT_MAX: usize = 64;

/// How long a worker is blocked over failures.
pub const BLOCK: Duration = Duration::from_secs(600);

/// Of a million completed materials, how many are rendered a second time by another worker, whoever
/// rendered them. With [`PROBATION`] and [`AUDITS`], 8 workers render 2.5 percent of 2,000 materials
/// twice.
pub const REDUNDANT_PER_MILLION: u32 = 5_000;

/// Materials of each credential that another renders again because it is new: two, so that one that
/// always lies is found by its first, and one that lies half of the time in three of four cases.
pub const PROBATION: u32 = 2;

/// Materials of each credential that another renders again before a set is finished, drawn from all
/// that it alone vouches for: three miss a liar of nine materials in ten once in a thousand times.
pub const AUDITS: u32 = 3;

/// Leases of one material that may run out before it is quarantined: a material that takes its
/// worker down every time is not handed out for ever.
pub const LEASES_LOST_MAX: u32 = 10;

/// Workers registered at one time.
pub const WORKERS_MAX: usize = 10_000;

/// Names of workers whose failures are remembered; blocks always are.
pub const WORKER_RECORDS_MAX: usize = 100_000;

/// How long a worker counts as present after its last call, and is remembered when it holds
/// nothing. More than the longest wait for a lease.
pub const WORKER_ABSENT: Duration = Duration::from_secs(90);

/// Connections at one time whose peers have made a call that is authorised.
pub const CONNECTIONS_MAX: usize = 4096;

/// Connections at one time whose peers have spoken, as in a TLS handshake, and made no call that is
/// authorised yet; for one more the one that was there longest is closed.
pub const STRANGERS_MAX: usize = 1024;

/// How long after its first byte a peer may take to make a call that is authorised: on a slow line a
/// TLS handshake takes a few seconds.
pub const STRANGER_STAY: Duration = Duration::from_secs(10);

/// Addresses that have shown a token and are remembered, for which strangers from others make room.
pub const KNOWN_ADDRESSES_MAX: usize = 10_000;

/// Connections that the system keeps until they are accepted.
pub const ACCEPT_QUEUE_MAX: u32 = 4096;

/// Connections at one time whose peers have not spoken yet; of more the longest silent half are
/// closed.
pub const SILENT_CONNECTIONS_MAX: usize = 1024;

/// How long a peer may keep silent after connecting, and how long a TLS handshake may take.
pub const SILENCE_MAX: Duration = Duration::from_secs(10);

/// How long one message may take to arrive: 8 MiB over 3 Mbit/s fit.
pub const MESSAGE_DEADLINE: Duration = Duration::from_secs(25);

/// The headers of one call, bytes.
pub const HEADER_BYTES_MAX: u32 = 16 << 10;

/// The shortest token, bytes: 128 random bits as hexadecimal digits.
pub const TOKEN_BYTES_MIN: usize = 32;

/// The longest token, bytes.
pub const TOKEN_BYTES_MAX: usize = 256;

/// The most tokens that a coordinator knows.
pub const TOKENS_MAX: usize = 256;

/// How long accepting rests where the system has no room for another connection.
pub const ACCEPT_PAUSE: Duration = Duration::from_millis(50);

/// Bytes of messages under way, of all calls together.
pub const MESSAGES_BYTES_MAX: usize = 512 << 20;

/// What of [`MESSAGES_BYTES_MAX`] is for messages longer than [`SHORT_MESSAGE_BYTES_MAX`].
pub const LONG_MESSAGES_BYTES_MAX: usize = MESSAGES_BYTES_MAX / 4 * 3;

/// What of it is for shorter ones: images of the preset among them, of 12 kB in the mean.
pub const SHORT_MESSAGES_BYTES_MAX: usize = MESSAGES_BYTES_MAX - LONG_MESSAGES_BYTES_MAX;

/// The share of either that one credential's messages may have, as a multiple of what is left free:
/// see [`STAGED_SHARE_OF_FREE`].
pub const MESSAGES_SHARE_OF_FREE: usize = 3;

/// Bytes before each message of gRPC: whether it is compressed, and its length.
pub const MESSAGE_PREFIX_BYTES: usize = 5;

/// The longest message, bytes, that counts as short: the longest that an operator sends, with its
/// prefix.
pub const SHORT_MESSAGE_BYTES_MAX: usize =
    protocol::CONTROL_MESSAGE_BYTES_MAX + MESSAGE_PREFIX_BYTES;

/// Bytes of answers that nobody has read yet, of all connections together: room for a part of a mesh for
/// each, so that a peer that has to go where there are more has asked for more than a worker does.
pub const UNREAD_BYTES_MAX: usize = CONNECTIONS_MAX * protocol::MESH_BYTES_PER_CALL;

/// How long an answer may wait for its peer to read it, as long as a client waits for it: 8 MiB over
/// 2 Mbit/s fit, and a part of a mesh over 16 kbit/s.
pub const UNREAD_WAIT_MAX: Duration = protocol::CALL_DEADLINE;

/// How often answers are looked for that have waited too long.
pub const UNREAD_INTERVAL: Duration = Duration::from_secs(1);

/// Bytes of images accepted and not yet completed, with the room that leases reserved for more.
pub const STAGED_BYTES_MAX: u64 = 2 << 30;

/// The share of [`STAGED_BYTES_MAX`] that one credential's jobs may have, as a multiple of what is
/// left free: 3 gives one credential three quarters, two credentials three sevenths each, and leaves
/// room for whoever comes new.
pub const STAGED_SHARE_OF_FREE: u64 = 3;

/// How slowly a lease may stage its images while others wait for its room, bytes a second: as slow
/// as a line on which the largest message just arrives in time, [`MESSAGE_DEADLINE`].
pub const STAGED_BYTES_PER_SECOND_MIN: u64 =
    protocol::MESSAGE_BYTES_MAX as u64 / MESSAGE_DEADLINE.as_secs();

/// How long a lease may stage nothing while others wait for its room: longer than a message may
/// take and a worker waits before it repeats one.
pub const STAGED_IDLE_MAX: Duration = Duration::from_secs(60);

/// How long a call waits for room for its job's images before it is told to ask again: shorter than
/// its deadline.
pub const STAGING_WAIT: Duration = Duration::from_secs(20);

/// How often a call that waits for room looks for it.
pub const STAGING_PAUSE: Duration = Duration::from_millis(100);

/// How long a lease that waits for room keeps its place in line without asking: longer than a
/// worker waits before it repeats a call.
pub const STAGING_ASKER_ABSENT: Duration = Duration::from_secs(30);

/// How often a lease that has staged images is looked at: what is staged outlives its lease by so
/// much at most.
pub const STAGED_LEASE_CHECK_INTERVAL: Duration = Duration::from_secs(2);

/// Leases with staged images that are looked at together.
pub const STAGED_LEASES_CHECKED_AT_ONCE: usize = 64;

/// The largest image header as JSON, bytes.
pub const IMAGE_HEADER_BYTES_MAX: usize = 64 << 10;

/// For how many lifetimes of a lease a URL for an upload is good; asked for again, there is
/// another.
pub const UPLOAD_URL_LEASES: u32 = 15;

/// Images that are checked and written at one time, however many cores there are; with the largest
/// image this bounds memory.
pub const UPLOADS_AT_ONCE_MAX: usize = 16;

/// The largest specification file, bytes.
pub const SPECIFICATION_BYTES_MAX: u64 = 4 << 20;

/// The longest line of the completion log, bytes.
pub const LOG_LINE_BYTES_MAX: u64 = 4 << 20;

/// Room that stays free on a store's disk unless an operator says otherwise, bytes.
pub const DISK_RESERVE_BYTES: u64 = 512 << 20;

/// How far the records of images that were taken in may go below that, bytes.
pub const DISK_RESERVE_FOR_RECORDS_BYTES: u64 = 128 << 20;

/// How often a full disk is looked at again.
pub const DISK_FULL_INTERVAL: Duration = Duration::from_millis(250);

/// sled's page cache, bytes.
pub const LEDGER_CACHE_BYTES: u64 = 64 << 20;

/// Transitions that one group commit makes durable together.
pub const COMMIT_BATCH_MAX: usize = 1024;

/// The least time from one group commit to the next. With a thousand workers that never rest, 99 of
/// 100 leases take 45 ms with 10 ms, 79 with 20, at the same jobs a second (`tests/throughput.sh`).
pub const COMMIT_INTERVAL: Duration = Duration::from_millis(10);

/// How long a store's lock is asked for before somebody else is said to have it.
pub const STORE_LOCK_WAIT: Duration = Duration::from_secs(1);

/// How often a store's lock is asked for again.
pub const STORE_LOCK_PAUSE: Duration = Duration::from_millis(20);

/// How long a restart waits for the ledger of a process that is just ending.
pub const LEDGER_LOCK_WAIT: Duration = Duration::from_secs(10);

/// Jobs that are looked at under one lock of the queue: a tenth of a millisecond.
pub const JOBS_LOOKED_AT_MAX: usize = 4096;

/// Jobs that an operator's order changes under one lock of the queue: half a millisecond.
pub const JOBS_ORDERED_AT_ONCE_MAX: usize = 256;

/// Locks of the queue that one call which lists jobs takes, one after another: where they are not
/// enough its page comes back short.
pub const JOBS_LOOKS_PER_CALL: usize = 16;

/// Materials among which one statement of a database looks for jobs that are listed or ordered.
pub const DATABASE_WINDOW_MATERIALS: u32 = 2000;

/// Windows that one call which lists jobs looks through.
pub const DATABASE_WINDOWS_PER_CALL: usize = 16;

/// The longest pause between two looks for leases that ran out.
pub const SWEEP_INTERVAL_MAX: Duration = Duration::from_secs(1);

/// The pause between two looks at whether the next call would be answered.
pub const HEALTH_INTERVAL: Duration = Duration::from_secs(1);

/// How long what keeps the jobs may take to answer before the coordinator counts as not serving.
pub const HEALTH_WAIT: Duration = Duration::from_secs(3);

/// How long a coordinator whose set is complete waits for workers to take leave: a worker that
/// died never does.
pub const LEAVE_GRACE: Duration = Duration::from_secs(5);

/// How long a stopping coordinator waits for calls under way, and then for uploads to be removed.
pub const STOP_GRACE: Duration = Duration::from_secs(5);

/// Bytes that surround the pixels of an image: header, attributes, chunk table.
pub const IMAGE_OVERHEAD_BYTES_MAX: u64 = 64 << 10;

/// Requests to a bucket that one operation has under way at one time.
pub const BUCKET_REQUESTS_AT_ONCE: usize = 16;

/// How long a request is repeated while a bucket's server does not answer it: shorter than a worker
/// waits for its own call, so that it hears why.
pub const BUCKET_RETRY_MAX: Duration = Duration::from_secs(30);

/// The longest pause between two repetitions of a bucket's request.
pub const BUCKET_BACKOFF_MAX: Duration = Duration::from_secs(5);

/// Repetitions of a bucket's request.
pub const BUCKET_RETRIES_MAX: usize = 12;

/// Threads that wait for a bucket's server.
pub const BUCKET_THREADS: usize = 2;

/// The longest URL of a bucket, bytes.
pub const BUCKET_URL_BYTES_MAX: usize = 1024;

/// The largest object that says whose place in a bucket it is, bytes.
pub const BUCKET_OWNER_BYTES_MAX: u64 = 4096;

/// How long one statement of a database may take; commands that read or change all of it
/// take as long as they take.
pub const DATABASE_STATEMENT_MAX: Duration = Duration::from_secs(300);

/// How long a transaction whose coordinator froze or went away keeps its locks.
pub const DATABASE_TRANSACTION_IDLE_MAX: Duration = Duration::from_secs(15);

/// When a database first asks whether a silent coordinator's machine is still there.
pub const DATABASE_KEEPALIVE_IDLE: Duration = Duration::from_secs(10);

/// When it asks again.
pub const DATABASE_KEEPALIVE_INTERVAL: Duration = Duration::from_secs(5);

/// After how many questions without an answer it ends the connection.
pub const DATABASE_KEEPALIVE_COUNT: u32 = 3;

/// Connections of one coordinator to its database.
pub const DATABASE_CONNECTIONS_MAX: usize = 12;

/// How long a call waits for a connection to the database.
pub const DATABASE_CONNECT_WAIT: Duration = Duration::from_secs(5);

/// How often a database's lock is asked for again.
pub const DATABASE_LOCK_PAUSE: Duration = Duration::from_millis(50);

/// How long a database may leave what was sent to it unanswered by its machine.
pub const DATABASE_SILENCE_MAX: Duration = Duration::from_secs(20);

/// Attempts at a transaction that others stand in the way of.
pub const DATABASE_ATTEMPTS_MAX: u32 = 5;

/// Claims that one transaction makes durable together, and as many completions and the like.
pub const DATABASE_BATCH_MAX: usize = 256;

/// How long workers that ask a database for work wait for each other after there was none.
pub const DATABASE_IDLE_PAUSE: Duration = Duration::from_millis(250);

/// Bytes of a sample's mesh that one row of a database keeps, and one statement carries.
pub const DATABASE_MESH_PART_BYTES: usize = 8 << 20;

/// Jobs that one transaction of a sweep changes.
pub const DATABASE_PAGE_MAX: i64 = 10_000;

/// How long nobody may look for leases that ran out before all get their full time again; less
/// where leases are short.
pub const SWEEP_GAP_MAX: Duration = Duration::from_secs(15);
