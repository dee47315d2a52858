//! What a specification may say: every limit by name.
//!
//! Both ends of a range are allowed. They are physical where physics sets one, and otherwise wide
//! enough for a scene on a table and narrow enough that no computation loses its digits.

use std::ops::RangeInclusive;

/// Size of a specification as TOML or JSON, in bytes.
pub const TEXT_BYTES_MAX: usize = 1 << 20;

/// Length of a name, in characters.
pub const NAME_CHARACTERS: RangeInclusive<usize> = 1..=64;

/// Seeds: TOML's integers that are not negative.
pub const SEED: RangeInclusive<u64> = 0..=i64::MAX as u64;

/// Materials in a set.
pub const MATERIALS: RangeInclusive<u32> = 1..=1_000_000;

/// The film's width and height, in pixels.
pub const IMAGE_SIDE_PIXELS: RangeInclusive<u32> = 1..=4096;

/// Absolute accuracy, in units of white. Below 1e-9 rounding in the reflectance model shows.
pub const ACCURACY_ABSOLUTE: RangeInclusive<f64> = 1e-9..=1.0;

/// Relative accuracy, as a fraction; 0 leaves the absolute one alone.
pub const ACCURACY_RELATIVE: RangeInclusive<f64> = 0.0..=1.0;

/// Camera rays a pixel, a power of two.
pub const SAMPLES_PER_PIXEL: RangeInclusive<u32> = 16..=1 << 20;

/// Surface hits along a path.
pub const BOUNCES: RangeInclusive<u32> = 1..=16;

/// Roughness, in percent: the model's domain.
pub const ROUGHNESS_PERCENT: RangeInclusive<f64> = 0.0..=100.0;

/// Anisotropy: the model's domain.
pub const ANISOTROPY: RangeInclusive<f64> = 0.0..=1.0;

/// Anisotropy angle, in degrees: one period.
pub const ANGLE_DEG: RangeInclusive<f64> = 0.0..=180.0;

/// Index of refraction: the model's domain.
pub const IOR: RangeInclusive<f64> = 1.0..=10.0;

/// Distance of the camera and of the bulb from the origin, in metres.
pub const DISTANCE_M: RangeInclusive<f64> = 0.01..=100.0;

/// Half the film's width at unit distance: fields of view of 0.1 to 168 degrees.
pub const FILM_HALF_WIDTH: RangeInclusive<f64> = 0.001..=10.0;

/// The bulb's radius, in metres.
pub const LIGHT_RADIUS_M: RangeInclusive<f64> = 1e-4..=100.0;

/// The bulb's electrical power, in watts.
pub const LIGHT_POWER_W: RangeInclusive<f64> = 1e-6..=1e9;

/// The bulb's efficacy, in lumens for each watt. 683 is that of monochromatic green light.
pub const LIGHT_EFFICACY_LM_PER_W: RangeInclusive<f64> = 1e-3..=683.0;

/// The largest radiance of a pixel, the bulb's own in a perfect mirror, in units of white, that a
/// 16-bit float holds.
pub const HALF_RADIANCE_MAX: f64 = 65504.0;

/// The sample's side, in metres.
pub const SAMPLE_SIDE_M: RangeInclusive<f64> = 0.001..=10.0;

/// Columns and rows of the chart, in patches.
pub const CHECKER_PATCHES_A_SIDE: RangeInclusive<u32> = 1..=64;

/// The side of a patch, in metres.
pub const CHECKER_PITCH_M: RangeInclusive<f64> = 1e-4..=10.0;

/// Where the chart's lower edge stands, in metres.
pub const CHECKER_LOWER_EDGE_Y_M: RangeInclusive<f64> = 0.0..=100.0;

/// The chart's angle above the horizontal, in degrees.
pub const CHECKER_TILT_DEG: RangeInclusive<f64> = 0.0..=90.0;

/// Views of a material.
pub const VIEWS: RangeInclusive<usize> = 1..=64;

/// Elevations of cameras and of the bulb, in degrees. At 0 the sample is seen from its edge.
pub const ELEVATION_DEG: RangeInclusive<f64> = 0.1..=90.0;

/// The material's turn, in degrees.
pub const ROTATION_DEG: RangeInclusive<f64> = -360.0..=360.0;

/// Text of a file that an error repeats, in characters.
pub const QUOTED_CHARACTERS_MAX: usize = 40;
