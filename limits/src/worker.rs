//! Every limit of the worker.

use std::time::Duration;

/// Materials that a worker holds at one time: one is rendered while another is leased or uploaded.
pub const JOBS_HELD: usize = 2;

/// How long a call for work waits for some.
pub const LEASE_WAIT: Duration = Duration::from_secs(20);

/// How long a worker that stays for more rests when nothing is left to do.
pub const IDLE_PAUSE: Duration = Duration::from_secs(5);

/// Renewals in the life of a lease: two may be lost before the lease is.
pub const RENEWALS_PER_LEASE: u32 = 3;

/// The pause before the second repetition of a call; the first repetition is immediate. Every
/// further one doubles.
pub const BACKOFF_FIRST: Duration = Duration::from_millis(100);

/// The longest pause between two repetitions of a call.
pub const BACKOFF_MAX: Duration = Duration::from_secs(10);

/// How long a coordinator may be away before its worker gives up.
pub const AWAY_MAX: Duration = Duration::from_secs(3600);

/// How long the first connection is tried for.
pub const CONNECT_MAX: Duration = Duration::from_secs(30);

/// Images that are uploaded at one time.
pub const UPLOADS_AT_ONCE: usize = 4;

/// How long one upload to a bucket may take: 7 MiB over 2 Mbit/s fit.
pub const UPLOAD_DEADLINE: Duration = Duration::from_secs(40);

/// How long a connection to a bucket stays open without a request.
pub const UPLOAD_CONNECTION_IDLE_MAX: Duration = Duration::from_secs(30);

/// Attempts of one upload before another URL is asked for.
pub const UPLOAD_ATTEMPTS: u32 = 5;

/// How often the images of one material are sent again after the coordinator forgot them, as it
/// does when it restarts.
pub const DELIVERIES_MAX: u32 = 100;

/// How long a stopping worker goes on delivering what is rendered.
pub const STOP_GRACE: Duration = Duration::from_secs(20);

/// The deadline of taking leave.
pub const LEAVE_DEADLINE: Duration = Duration::from_secs(3);
