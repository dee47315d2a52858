//! The chart in a near mirror.

/// The largest blur in pixels: of larger ones tiles hold the edges for less. Measured on the preset's views 4 and
/// 5, for a roughness of 0.3 to 3 percent: at the preset's target and at one a hundred times as large.
pub(super) const BLUR_MAX: f64 = 0.12;
pub(super) const BLUR_MAX_COARSE: f64 = 0.35;

/// The least side of a patch's image in pixels. Chosen: so that few pixels have two edges along one axis.
pub const PATCH_MIN: f64 = 4.0;

/// The most pixels. A limit on memory: some 50 MB.
pub const PIXELS_MAX: f64 = 131_072.0;

/// Pixels about the chart's image that are looked at, whether anything of it shows. Chosen.
pub const MARGIN: f64 = 6.0;

/// Evaluations that a row of pixels may take. Estimated.
pub const EVALUATIONS_A_ROW: u64 = 2_000;

/// What a parabola over a pixel makes of the mean over a part of it is off by this share of what it makes of the
/// whole, at most. Derived: the integral of u^2 - 1/12 over where that is positive, over 1/12.
pub const BEND: f64 = 0.39;

/// Of the pixels along an edge one in so many is looked at, and the first. Chosen.
pub const LOOKS: u32 = 8;

/// The share of the target that the polynomials may miss which tell white light. Chosen.
pub const WHITE_SHARE: f64 = 0.1;

/// Light on the chart by polynomials on parts half as long is off by this share of what it differs from that on the
/// longer parts by. Parabolas are off by an eighth as much on them; chosen larger.
pub const FINER_SHARE: f64 = 0.25;

/// Levels by which the rule may be finer that white light is known by. A limit on work.
pub const FINER_RULES: u32 = 2;

/// The share of the target that an edge farther than the reach may be off by. Chosen.
const TAIL_SHARE: f64 = 0.02;

/// How many blurs an edge reaches, for such a target.
pub fn reach(target: f64) -> f64 {
    (2.0 * libm::log(0.5 / (TAIL_SHARE * target)).max(1.0)).sqrt()
}

/// The share of a blurred edge that lies farther than its reach, at most: the normal distribution is less than half
/// of exp(-t^2/2). Two edges end on either side of a pixel along each of two axes.
pub fn tail(reach: f64) -> f64 {
    4.0 * 0.5 * libm::exp(-0.5 * reach * reach)
}
