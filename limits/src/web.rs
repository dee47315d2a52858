//! What the pages in a browser may cost.

use std::time::Duration;

/// The longest that somebody stays signed in.
pub const SESSION: Duration = Duration::from_secs(12 * 3600);

/// Sessions that ended early and are remembered until they would have ended by themselves.
pub const SESSIONS_ENDED_MAX: usize = 10_000;

/// The longest query of an address, bytes.
pub const QUERY_BYTES_MAX: usize = 4096;

/// The largest form, bytes.
pub const FORM_BYTES_MAX: usize = 8192;

/// How long the head of a request may take to arrive.
pub const HEAD_DEADLINE: Duration = Duration::from_secs(10);

/// How long a connection lives: whoever reads an answer slowly, or not at all, holds its memory and its
/// place no longer. A browser opens another.
pub const CONNECTION_SPAN: Duration = Duration::from_secs(600);

/// How long an answer may take, but for one that streams events.
pub const ANSWER_DEADLINE: Duration = Duration::from_secs(60);

/// Completed materials that the catalogue holds, some 150 bytes each.
pub const CATALOGUE_MATERIALS_MAX: usize = 300_000;

/// Materials on a page.
pub const MATERIALS_A_PAGE: usize = 48;

/// Jobs on a page.
pub const JOBS_A_PAGE: u32 = 50;

/// How long jobs are looked through for a page. Jobs of a state may be far apart, and a database looks
/// at few of them in one call.
pub const JOBS_SEARCH: Duration = Duration::from_millis(100);

/// Pages that are made, and records of the store that are read, at one time.
pub const PAGES_AT_ONCE: usize = 4;

/// Requests for pages and images that wait for these; more are refused.
pub const PAGES_WAITING_MAX: usize = 1024;

/// How long the catalogue rests after it looked for new materials.
pub const CATALOGUE_PAUSE: Duration = Duration::from_secs(1);

/// The same for a store in a database, where looking costs a connection.
pub const CATALOGUE_PAUSE_DATABASE: Duration = Duration::from_secs(10);

/// The catalogue rests for this many times as long as its last look took, if that is longer.
pub const CATALOGUE_PAUSE_TIMES: u32 = 20;

/// The side of a thumbnail, pixels.
pub const THUMBNAIL_SIDE: u32 = 112;

/// Bytes of pictures that are kept in memory.
pub const PICTURE_CACHE_BYTES: usize = 64 << 20;

/// Pictures that are made at one time.
pub const PICTURES_AT_ONCE: usize = 2;

/// Requests that wait for a picture; more are refused.
pub const PICTURES_WAITING_MAX: usize = 512;

/// Bytes of images and pictures that are on their way to browsers.
pub const SENDING_BYTES_MAX: usize = 256 << 20;

/// Pixels of an image whose values a page shows under the pointer, at 12 bytes each.
pub const VIEWER_PIXELS_MAX: u64 = 1 << 20;

/// Requests that wait for a rendering of stated errors; more are refused.
pub const RENDERINGS_WAITING_MAX: usize = 8;

/// Pages that are told at one time what happens.
pub const LIVE_PAGES_MAX: usize = 512;

/// How long a page is told before it has to ask again, and to show who it is: somebody who signed out,
/// or whose token is gone, is told no longer than this.
pub const LIVE_SPAN: Duration = Duration::from_secs(120);

/// How often pages are told, at most.
pub const LIVE_PAUSE: Duration = Duration::from_secs(1);

/// The last images on the farm's page.
pub const LAST_IMAGES: usize = 24;

/// Events on the farm's page.
pub const LAST_EVENTS: usize = 30;
