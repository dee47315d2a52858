//! Every limit of the protocol. Both sides keep to them; the coordinator enforces them.

use std::time::Duration;

/// The largest message either side sends or decodes, bytes.
pub const MESSAGE_BYTES_MAX: usize = 8 << 20;

/// The largest message that a person's call sends, bytes.
pub const CONTROL_MESSAGE_BYTES_MAX: usize = 256 << 10;

/// The largest image, bytes: a message less what surrounds the image in it.
pub const BLOB_BYTES_MAX: u64 = 7 << 20;

/// The most that the images brought along by one completion have together, bytes. More are sent one
/// by one, so that on a slow line what has arrived need not be sent again.
pub const IMAGES_BROUGHT_BYTES_MAX: u64 = 256 << 10;

/// The bytes of a mesh that one answer has, but for the last. A worker asks for one at a time. Who makes 64
/// calls on a connection and reads none of the answers holds 4 MiB, which `UNREAD_BYTES_MAX` bounds for all
/// connections together.
pub const MESH_BYTES_PER_CALL: usize = 64 << 10;

/// Length of a lease token and of a worker's id, bytes.
pub const TOKEN_BYTES: usize = 16;

/// Length of a digest, bytes.
pub const DIGEST_BYTES: usize = 32;

/// The longest name of a worker, bytes.
pub const NAME_BYTES_MAX: usize = 128;

/// The longest error that is kept, bytes; more is cut off.
pub const ERROR_BYTES_MAX: usize = 2048;

/// The most jobs one call leases.
pub const JOBS_PER_CALL_MAX: u32 = 64;

/// The most leases a worker holds.
pub const LEASES_PER_WORKER_MAX: u32 = 256;

/// The most digests one call asks for.
pub const DIGESTS_PER_CALL_MAX: usize = 4096;

/// Length of an MD5, bytes.
pub const MD5_BYTES: usize = 16;

/// The most views of a material that one completion reports.
pub const VIEWS_MAX: usize = 64;

/// The longest that a call for leases waits for one.
pub const LEASE_WAIT_MAX: Duration = Duration::from_secs(30);

/// The most jobs that one call lists.
pub const JOBS_LISTED_MAX: u32 = 1000;

/// The longest error in a list of jobs or workers, bytes; more is cut off.
pub const ERROR_LISTED_BYTES_MAX: usize = 256;

/// The most workers that one call lists.
pub const WORKERS_LISTED_MAX: usize = 10_000;

/// The most ranges of materials in a selection or an answer.
pub const RANGES_PER_CALL_MAX: usize = 4096;

/// The longest reason of a block, bytes.
pub const REASON_BYTES_MAX: usize = 512;

/// Priorities are between this with a minus sign and this.
pub const PRIORITY_MAX: i32 = 1000;

/// Events that wait for one reader before it misses some.
pub const EVENTS_WAITING_MAX: usize = 1024;

/// Readers of events at one time.
pub const EVENT_READERS_MAX: usize = 64;

/// The most materials quarantined that one status lists.
pub const QUARANTINED_LISTED_MAX: usize = 16;

/// The deadline of a call, beyond what it asks to wait: uploads of 8 MiB over 2 Mbit/s fit.
pub const CALL_DEADLINE: Duration = Duration::from_secs(40);

/// The longest that connecting takes.
pub const CONNECT_DEADLINE: Duration = Duration::from_secs(10);

/// How often an idle connection is probed, from both ends.
pub const KEEPALIVE_INTERVAL: Duration = Duration::from_secs(15);

/// How long a probe may stay unanswered before the connection counts as broken.
pub const KEEPALIVE_TIMEOUT: Duration = Duration::from_secs(20);

/// The most calls under way on one connection.
pub const CALLS_PER_CONNECTION_MAX: usize = 64;

/// The domain of the error details that a coordinator sends.
pub const ERROR_DOMAIN: &str = "brdfarm";

/// How long a client should wait after an error that passes.
pub const RETRY_AFTER: Duration = Duration::from_secs(1);
