//! Every share of the tolerance, every regime and every limit on work of the hybrid integrator.
//!
//! The specification asks for an accuracy. Its *target* is the error that it allows a pixel of value
//! one. Each constant here says what it is a share of and why it has its value: derived, measured, or
//! chosen. *Chosen* means that no derivation or measurement is on record; tests of the stated errors
//! (`tests/hybrid.rs`, `tests/scenes/`) hold with it.
//!
//! How a pixel's target is divided:
//!
//! ```text
//! bulb                                    0.1
//! chart, seen straight or in the sample   0.4 (1.7 for its tiles: what they show to be off by, and
//!                                                  the doubt about what they do not show
//!                                              + 0.35 for interreflection of order 1
//!                                              + 0.15 for all higher orders)
//! sum                                     0.98
//! ```
//!
//! What the rule at a point misses comes on top, at most [`TILING`]'s `beside` of a tile's share: a rule
//! that misses more leaves less to the tile's series. What an error of order 1 becomes in the higher
//! orders is part of its share. What interreflection misses is a share of the light on the chart: of a
//! pixel it takes no more than that share.

pub mod interreflection;
pub mod mirror;

use crate::film::demand::{self, FunctionError, Terms};
use crate::film::log_tiling;
use crate::film::target;
use crate::numerics::tolerance::Tolerance;
use crate::reflectance::Reflectance;
use dataset::specification::Accuracy;

/// The target of the preset. Limits on work are made for it.
const PRESET_TARGET: f64 = 1e-3;

/// From this target on coarse rules suffice: [`wide::RULE_SHARE`] and [`wide::TILE`] have looser
/// values. Measured: a third of the work, and the stated errors still hold. And so do series of few terms where
/// nothing is sharp. Measured at a target of 0.1: a quarter of the time.
const COARSE_TARGET: f64 = 1e-2;

/// The share of the target that the bulb's light may miss. Chosen: this light costs next to nothing.
const BULB_SHARE: f64 = 0.1;

/// The share of the target that the chart's light may miss. Chosen: with it the sum above is below 1.
/// Where interreflection misses next to nothing, 0.5 would be below 1, too. The dearest materials would
/// take a seventh less work. But one of 1,400 images of the preset then had a tile that was off by 2.5
/// times the tolerance (material 6716, view 1): the light rose to the tile's side, and its coefficients and
/// the one point that is looked at there did not show it. And with 0.5 a quarter of the tests of tiles
/// (`kinks`) fails.
const CHART_SHARE: f64 = 0.4;

const _: () = assert!(
    BULB_SHARE
        + CHART_SHARE
            * (TILING.doubt + interreflection::ORDER_1_SHARE + interreflection::HIGHER_SHARE)
        <= 1.0,
    "the parts of a pixel may not miss more than its target"
);

/// No lit pixel states less than this share of its target. Rules are compared with finer ones at a few
/// points of a tile, and the pixels on an outline are sums of few points: elsewhere they miss up to 0.17
/// of the target where nothing shows. Measured against finer renderings (`survey` with `check`): with 0.1,
/// 3 of 775 images of the preset had 1.4 to 1.7 percent of their pixels off by more than they state, next
/// to the chart's image on the sample (materials 1817, 2618 and 3152).
const STATED_LEAST: f64 = 0.2;

/// The bulb's absolute tolerance, as a share of [`BULB_SHARE`]. Chosen: with it even pixels far below
/// white are right to a fraction of the relative tolerance.
const BULB_FAINT: f64 = 1e-4;

/// A tile is as long as this many features of the function on it. Chosen.
const FEATURES_PER_TILE: f64 = 3.0;

/// The least length of a feature's tile in pixels. Chosen.
const FEATURE_MIN: f64 = 4.0;

/// How [`crate::film::tiling`] divides what a tile may miss.
///
/// - `rule`: with 0.1, tiles of sharp lobes were worked out with a finer rule although their series were
///   far better than they had to be, and spent the limit on evaluations on it (materials 752 and 928 of the
///   preset).
/// - `beside`: chosen. It is what `rule` was while the rule had a share of its own.
/// - `cross`, `point`: measured on twelve images with kinks at every pixel, against renderings to a fiftieth of the
///   tolerance. With less of `cross`, nodes are worked out of tiles that are halved anyhow; more of `point` gains
///   nothing, because the points off the nodes tell what coefficients do not.
/// - `centroids`: see [`COARSE_CENTROIDS`].
/// - `step`, `step_at_outline`: chosen, after trying. With 0.7 for both, 10 of 680,000 pixels that an outline cuts were
///   off by more than they may be, by up to 1.3 times; with 1, 3; with these none of 4.5 million (`kinks`).
/// - `apart`: with 1, 18 of 77,800 pixels with kinks along the tiles' sides were off by more than the tolerance, with
///   1.25 8 (measured: `kinks`).
/// - `doubt`: between the points that are looked at a tile is off by more than they show. With 1.7 one of 336
///   images had more than a hundredth of its pixels off by more than they state (measured: `survey` with `check`).
/// - `unmet`: a rule that has not converged was off by up to 1.6 times its difference from the next (measured on one
///   specification).
pub const TILING: demand::Shares = demand::Shares {
    rule: 0.3,
    beside: 0.1,
    cross: 0.7,
    point: 0.05,
    centroids: 0.0,
    step: 1.0,
    step_at_outline: 2.0,
    apart: 1.25,
    doubt: 1.7,
    unmet: 3.0,
};

/// What [`TILING`] has of `centroids` from [`COARSE_TARGET`] on. Chosen. Below that target few tiles are smooth enough.
const COARSE_CENTROIDS: f64 = 0.05;

/// How [`log_tiling`] divides what a tile may miss. Chosen.
pub const LOG_TILING: log_tiling::Shares = log_tiling::Shares {
    dark: 0.3,
    rule: 0.2,
    quadrature: 0.05,
    edge_tiles: 8.0,
};

/// A limit on evaluations for a part of a view. Nothing is refined beyond it.
#[derive(Clone, Copy, Debug)]
pub struct Limit {
    /// For each pixel of the film.
    per_pixel: u64,
    /// On small films.
    least: u64,
}

/// The tolerances of a view's parts.
#[derive(Clone, Debug)]
pub struct Budget {
    target: f64,
    /// What a pixel may miss in all.
    whole: Accuracy,
    /// What the bulb's light may miss.
    pub bulb: Accuracy,
    /// The same where the bulb's image has edges finer than a pixel: there each pixel costs.
    pub sharp_bulb: Accuracy,
    /// The rule over the bulb where a tile holds the light's logarithm.
    pub bulb_rule: Tolerance,
    /// What the chart's light may miss, seen straight and in the sample.
    pub chart: Accuracy,
    /// Whether the target is at least [`COARSE_TARGET`].
    pub is_coarse: bool,
    /// The rule over the chart off a wide lobe.
    pub wide_rule: Tolerance,
    /// How many features long the tiles of the chart off a wide lobe are: see [`wide::TILE`].
    pub wide_tile: f64,
    /// The rule over a glossy lobe.
    pub glossy_rule: Tolerance,
}

impl Budget {
    /// The tolerances for an accuracy.
    pub fn new(accuracy: &Accuracy) -> Self {
        let target = accuracy.relative.max(accuracy.absolute);
        let is_coarse = target >= COARSE_TARGET;
        let (wide_share, wide_tile) = if is_coarse {
            (wide::RULE_SHARE_COARSE, wide::TILE_COARSE)
        } else {
            (wide::RULE_SHARE, wide::TILE)
        };
        Self {
            target,
            whole: accuracy.clone(),
            bulb: Accuracy {
                absolute: BULB_SHARE * BULB_FAINT * accuracy.absolute,
                relative: BULB_SHARE * accuracy.relative,
            },
            sharp_bulb: Accuracy {
                absolute: BULB_SHARE * accuracy.absolute,
                relative: BULB_SHARE * accuracy.relative,
            },
            bulb_rule: Tolerance::new(direct::RULE_SHARE * target),
            chart: Accuracy {
                absolute: CHART_SHARE * accuracy.absolute,
                relative: CHART_SHARE * accuracy.relative,
            },
            is_coarse,
            wide_rule: Tolerance::new(wide_share * target),
            wide_tile,
            glossy_rule: Tolerance::new(glossy::RULE_SHARE * target),
        }
    }

    /// The least error that a lit pixel of this value states.
    pub fn stated_least(&self, value: [f64; 3]) -> f64 {
        STATED_LEAST * target(&self.whole, value)
    }

    /// Of the series on tiles of a smooth function.
    pub fn smooth_terms(&self) -> Terms {
        if self.is_coarse {
            Terms::Few
        } else {
            Terms::Many
        }
    }

    /// How tiles divide what they may miss.
    pub fn tiling(&self) -> demand::Shares {
        demand::Shares {
            centroids: if self.is_coarse {
                COARSE_CENTROIDS
            } else {
                TILING.centroids
            },
            ..TILING
        }
    }

    /// How a glance is taken at the higher orders of interreflection.
    pub fn glance(&self) -> interreflection::Glance {
        if self.is_coarse {
            interreflection::COARSE_GLANCE
        } else {
            interreflection::GLANCE
        }
    }

    /// The rule over the bulb where a tile holds the light itself.
    pub fn bulb_linear_rule(&self) -> Tolerance {
        Tolerance::new(direct::LINEAR_RULE_SHARE * self.bulb_rule.error())
    }

    /// The largest blur in pixels of a near mirror.
    pub fn mirror_blur_max(&self) -> f64 {
        if self.is_coarse {
            mirror::BLUR_MAX_COARSE
        } else {
            mirror::BLUR_MAX
        }
    }

    /// What the chart's tiles may miss beside what interreflection is known to miss: [`Budget::chart`], or
    /// less where that has taken more than its share, but no less than `least` of the target.
    pub fn chart_beside(&self, known: FunctionError, least: f64) -> Accuracy {
        let taken = known.absolute / self.whole.absolute;
        let taken = taken.min(known.relative / self.whole.relative);
        let left = (1.0 - BULB_SHARE - taken) / (TILING.doubt + TILING.beside);
        let share = left.clamp(least, CHART_SHARE);
        Accuracy {
            absolute: share * self.whole.absolute,
            relative: share * self.whole.relative,
        }
    }

    /// The error allowed to the polynomials by which the chart's light is told to the sample.
    pub fn light_on_chart(&self) -> f64 {
        let least = self.chart.absolute;
        least.max(self.chart.relative * reflected_chart::FAINT)
    }

    /// The limit on evaluations for a film of this size. It rises with the root of the inverse of a
    /// target below [`PRESET_TARGET`].
    pub fn evaluations_max(&self, limit: Limit, size: [u32; 2]) -> u64 {
        let [width, height] = size.map(u64::from);
        let finer = (PRESET_TARGET / self.target).max(1.0).sqrt();
        (finer * limit.least.max(limit.per_pixel * width * height) as f64) as u64
    }
}

/// The length in pixels of a tile, for a feature of this length.
pub fn tile_pixels(feature_pixels: f64) -> f64 {
    FEATURES_PER_TILE * feature_pixels
}

/// The same, and long enough for a tile of a function with edges.
pub fn edged_tile_pixels(feature_pixels: f64) -> f64 {
    tile_pixels(feature_pixels).max(FEATURE_MIN)
}

/// The length in pixels of a tile none of whose nodes' gaps hides a chart of this side: of eight
/// Chebyshev nodes no two neighbours lie farther apart than 0.195 of the tile.
pub fn chart_tile_pixels(chart_pixels: f64) -> f64 {
    chart_pixels / 0.195
}

/// The same for a patch. [`FEATURE_MIN`] is the least: of smaller patches every tile shows many, and their
/// number would be the number of tiles.
pub fn patch_tile_pixels(patch_pixels: f64) -> f64 {
    chart_tile_pixels(patch_pixels).max(FEATURE_MIN)
}

/// Whether a material's lobe is glossy: narrow, or narrow along one axis and far wider along the
/// other. This is the only definition of the word.
pub fn is_glossy(reflectance: &Reflectance) -> bool {
    let lobe = &reflectance.lobe;
    let is_highly_anisotropic =
        lobe.n_u > glossy::ANISOTROPIC_EXPONENT && lobe.n_u > glossy::ANISOTROPY * lobe.n_v;
    reflectance.specular_share == 1.0 && (lobe.n_u > glossy::EXPONENT || is_highly_anisotropic)
}

/// The bulb's light off the sample.
pub mod direct {
    use crate::hybrid::budget::Limit;

    /// The share of the target that the rule over the bulb may miss. Chosen.
    pub(super) const RULE_SHARE: f64 = 1e-2;

    /// The rule's share of [`RULE_SHARE`] where pixels are closed forms. Chosen: there the rule at a
    /// point is the largest error.
    pub(super) const LINEAR_RULE_SHARE: f64 = 0.1;

    /// About a second of a core at 128 x 128 (measured). With 1,200 a pixel one of the first 14,000 images of the
    /// preset had fewer than 99 percent of its pixels within the tolerance for it (material 416).
    pub const LIMIT: Limit = Limit {
        per_pixel: 1_600,
        least: 20_000_000,
    };

    /// Up to this exponent a lobe is rough: the light itself is as smooth as its logarithm, and its
    /// integrals over pixels are closed forms. Chosen.
    pub const ROUGH_EXPONENT: f64 = 400.0;

    /// A lobe narrower than this many pixels is sharp. It makes edges that no tile follows: where the
    /// bulb's image itself is large on the film, pixels on its edge are integrated one by one. Chosen.
    pub const SHARP_WIDTH: f64 = 0.25;

    /// Neither holds where a tile of the light itself is shorter than this many pixels: a coarse
    /// film's nodes could miss a feature that its logarithm cannot. Chosen.
    pub const TILE_MIN: f64 = 12.0;

    /// The same for a sharp lobe: where a tile is shorter, the film is rendered finer. Derived: the
    /// bulb's image is then four pixels across (a tile spans three of its half widths), and of eight
    /// Chebyshev nodes no two neighbours lie farther apart than 0.195 of the tile, 1.2 pixels.
    pub const SHARP_TILE_MIN: f64 = 6.0;

    /// A lobe's widths about the bulb's mirror image within which there is light: six widths off its edge the
    /// lobe has fallen to 1.5e-8.
    pub const IMAGE_WIDTHS: f64 = 6.0;

    /// The most pixels of that finer film: 2^20. Chosen.
    pub const FINER_PIXELS_MAX: f64 = 1_048_576.0;

    /// A bulb of at most this half width in the slope plane may be small enough for the seven points of
    /// Radon's rule. Chosen.
    pub const SMALL_BULB: f64 = 0.1;

    /// The search for the ends of what counts stops at this part of a lobe's width. Chosen.
    pub const SEARCH_WIDTH: f64 = 0.25;

    /// The lobe's bulk along its wide axis, to either side, in widths. Chosen: it holds 95 percent of
    /// a normal density.
    pub const BULK_WIDTHS: f64 = 2.0;

    /// A bend that takes more than this many widths of the narrow axis to cross the lobe is smooth
    /// enough once it is integrated along the wide one. Chosen.
    pub const STEEP_WIDTHS: f64 = 3.0;

    /// What the middle of a rectangle's slopes may be off its corners' mean, as a share of their box:
    /// beyond it the corners say too little of what lies between them. Chosen.
    pub const CURVATURE_MAX: f64 = 0.25;

    /// A bulb is dark where the lobe has fallen by more e-folds than this: no light is so bright that 4e-44 of it
    /// counts.
    pub const DARK_EXPONENT: f64 = 100.0;

    /// No series of a tile follows an edge over more than this many widths of the lobe. Chosen.
    pub const EDGE_WIDTHS: f64 = 12.0;
}

/// The chart as the camera sees it straight, and what all kinds of lobes share.
pub mod reflected_chart {
    use crate::hybrid::budget::Limit;

    /// Each evaluation takes longer than one of the bulb's: a tenth of the bulb's limit on small films.
    pub const LIMIT: Limit = Limit {
        per_pixel: 1_200,
        least: 2_000_000,
    };

    /// The least share of the target for tiles where interreflection has taken more than its part. Chosen: a tile
    /// of the chart seen straight costs next to nothing.
    pub const SHARE_LEAST: f64 = 0.1;
    pub const SHARE_LEAST_STRAIGHT: f64 = 0.02;

    /// The chart's reflection is at least this much of white where its relative tolerance counts.
    /// Chosen.
    pub(super) const FAINT: f64 = 0.1;

    /// How many times as much polynomials may miss of the sample's light on the chart as of the bulb's: its
    /// part is taken off at every point, and few points see the worst of it. Measured: from 3 to here a
    /// twentieth of the work goes, and material 608 of the preset, whose polynomials missed 63 times as much,
    /// gains all of its pixels.
    pub const OFF_SAMPLE_SHARE: f64 = 40.0;

    /// What polynomials miss of the light on the chart is stated as it is where it is no more than this share of what
    /// they may miss of the bulb's; else points tell what the sample sends on of it. Chosen: in the preset's proportions
    /// it is at most a twelfth of a dark pixel's target and a hundredth of a white one's.
    pub const STATED_SHARE: f64 = 0.2;

    /// The most patches that a chart is parted into where its light bends. A limit on work. Chosen.
    pub const PATCHES_MAX: u32 = 4096;
}

/// The chart off a wide lobe.
pub mod wide {
    /// The share of the target that the rule over the chart may miss, to begin with. Measured: from 0.01
    /// to here a twelfth of the work goes; at 0.1 images of interreflecting materials miss their target.
    pub(super) const RULE_SHARE: f64 = 0.03;

    /// Tiles are this many times longer than a feature asks for. Chosen: their nodes are dense at
    /// their ends.
    pub(super) const TILE: f64 = 2.0;

    /// The same two from [`super::COARSE_TARGET`] on.
    pub(super) const RULE_SHARE_COARSE: f64 = 0.1;
    pub(super) const TILE_COARSE: f64 = 3.0;

    /// Digits beyond those that count at which the lobe's tail is cut. Chosen.
    pub const TAIL_DIGITS: f64 = 1.0;

    /// Lobes that reach farther in the slope plane than this have no window. Chosen.
    pub const WINDOW_REACH_MAX: f64 = 1.2;
}

/// The chart off a glossy lobe.
pub mod glossy {
    use crate::hybrid::budget::Limit;

    /// Above this exponent along its narrower axis a lobe is glossy. Measured on 40 materials of the
    /// preset: above it rules along the lobe's axes take half the time of those along the chart's to
    /// as much, and at 500 twice as much.
    pub(super) const EXPONENT: f64 = 1_500.0;

    /// The same for a lobe whose two exponents have at least this ratio: there the rules along the
    /// chart's axes are the dearer ones from here on (measured).
    pub(super) const ANISOTROPIC_EXPONENT: f64 = 300.0;
    pub(super) const ANISOTROPY: f64 = 20.0;

    /// The share of the target that the rule may miss. Measured: with 0.08 ten dear images take 3 percent less, and a
    /// few of the usual ones three times as much, because their points ask for finer rules.
    pub(super) const RULE_SHARE: f64 = 0.05;

    /// Tiles are this many times longer than a feature asks for. Chosen, for the same reason.
    pub const TILE: f64 = 6.0;

    /// Up to five seconds of a core at 128 x 128 in the preset (measured). With 1,800 a pixel 5 of the first 14,000
    /// images had fewer than 99 percent of their pixels within the tolerance for it; with this none has. Near mirrors
    /// and highly anisotropic samples take so much: one image in two thousand.
    pub const LIMIT: Limit = Limit {
        per_pixel: 6_400,
        least: 3_000_000,
    };

    /// The limit on work of a finer film is that of an image of this size, or of the image itself if that is larger.
    pub const FINER_LIMIT_OF: [u32; 2] = [128; 2];

    /// Charts of more patches are not rendered on a finer film: the tiles that such a film begins with took 380 million
    /// evaluations for 4,096 patches (class `unbounded` of `tests/scenes/`), far beyond that limit. Chosen.
    pub const FINER_PATCHES_MAX: u32 = 1_024;

    /// The share of pixels that may miss their target on a film of small patches before a finer one is tried. Chosen.
    pub const MISSING_MAX: f64 = 0.005;

    /// Orders of the polynomials along the narrow axis: a point's own and two finer ones. Beyond them
    /// the rule of wide lobes serves.
    pub const ORDERS: u32 = 3;

    /// But not from this exponent on, for a lobe whose exponents have such a ratio: it would take milliseconds a point
    /// (1.2 million evaluations for material 608 of the preset). There a third finer order of polynomials serves, and
    /// states how far the one before it was off. Off a lobe that is nearly round the rule takes no more than polynomials
    /// do, and has converged where they have not (material 848, view 5: 98.9 percent of its pixels were within the
    /// tolerance); sharper ones than this are near mirrors, for which it gains nothing.
    pub fn wide_rule_exponent(ratio: f64) -> f64 {
        if ratio < 3.0 { 1e6 } else { 1e4 }
    }

    /// The length of a cell of the light on the chart in ln(1 + height / gap), of patches in so many `parts` along a
    /// side. A parabola over 2.2 missed a quarter of what a rough sample sends to the chart (measured), and the error
    /// falls with the cube of the length. Measured with 0.2 for whole patches: polynomials of degree ten over a lobe
    /// that spans several cells did not converge, for the bends between them, and 3.5 percent of an image's pixels
    /// stated twice their target (material 3152, view 5). With a quarter of that for patches in parts, too, the cells
    /// take 35 MB.
    pub fn cell_height(parts: u32) -> f64 {
        (0.2 / f64::from(parts)).min(0.05)
    }

    /// Edges that a line is compared with, and corners that a point is, in the time of an evaluation
    /// (estimated from their operations): what charts of many patches cost counts as work.
    pub const EDGES_AN_EVALUATION: usize = 8;
    pub const CORNERS_AN_EVALUATION: usize = 2;

    /// Digits beyond those that count at which the lobe's tail is cut. Chosen.
    pub const TAIL_DIGITS: f64 = 0.5;

    /// Above this exponent what multiplies the lobe is constant over it to five digits. Measured: at 5e6 it was
    /// not where the lobe's narrow axis lies along the view at a slant (material 32 of the preset).
    pub const CONSTANT_EXPONENT: f64 = 2e7;

    /// Above this exponent what multiplies the lobe is a parabola over it to five digits.
    pub const PARABOLA_EXPONENT: f64 = 3e4;

    /// Above this one a polynomial of degree four suffices. Measured: below it tiles fell to the rule of wide
    /// lobes, and one of fourteen dear images took twice the work.
    pub const QUARTIC_EXPONENT: f64 = 1e4;

    /// The share of a lobe's fall along its wide axis by which a piece needs fewer digits. Chosen below 1: the
    /// lobe falls from the piece's end, and rises in it.
    pub const FALL_SHARE: f64 = 0.8;

    /// The most corners of patches that are looked at: those of 64 by 64 patches. A limit on work.
    pub const CORNERS_MAX: usize = 4_225;

    /// The `points` of a line are not drawn together to less than this, in widths to either side: the moments would
    /// lose their digits, by the factor (farthest point / this)^degree. With seven points and less that leaves nine
    /// digits at the lobe's end, five widths out. For more points the factor is chosen the same. With 0.5 eleven points
    /// were off by 2 percent (material 784 of the preset).
    pub const fn span_min(points: usize) -> f64 {
        match points {
            0..=7 => 0.5,
            8..=9 => 1.0,
            _ => 1.55,
        }
    }

    /// Widths of the lobe that a group of patches shows beyond its edges, for the nodes of a tile. Chosen: what an
    /// edge's blur asks of a tile ([`TILE`]) leaves 3.5 between two nodes.
    pub const HIDDEN_WIDTHS: f64 = 4.0;

    /// Widths of the lobe beyond its edges at which a group of patches is dark. Chosen: the lobe falls to 4e-6.
    pub const HIDDEN_REACH: f64 = 5.0;

    /// The most groups of patches that are looked at beside the whole chart. A limit on work: of more, every tile shows
    /// some.
    pub const GROUPS_MAX: usize = 64;

    /// Widths from the middle of an edge's passage through the lobe at which it is over. Chosen.
    pub const PASSAGE: f64 = 3.5;

    /// An edge that bends by more than this share of the way from the middle of its passage to where it is over may
    /// turn back. Chosen: with 0.4 material 608 takes a quarter more, with 0.08 no less.
    pub const BENT: f64 = 0.2;

    /// The most by which an edge bends at one width of the narrow axis, in widths of the wide one, for a step to stand
    /// at the mean of where it passes. Chosen: the square of it counts little.
    pub const BEND_MAX: f64 = 0.05;

    /// A passage shorter than this share of the lobe's wide width is a step. Chosen.
    pub const STEP: f64 = 1e-4;

    /// A piece with an edge's passage through the lobe needs so many digits fewer than one without. Measured: what
    /// changes there is the integral of a density, over a small part of the lobe. With this, and two lines at least
    /// where all digits ask for as many, such pieces still miss less than the others; with 2 some images take twice as
    /// much, for finer rules.
    pub const PASSAGE_DIGITS: f64 = 1.5;
    pub const PASSAGE_LINES_MIN: usize = 2;

    /// The most by which the distance from a pole is taken to grow over a piece, in logarithms. A limit on work.
    pub const GROWTH_MAX: f64 = 8.0;

    /// A corner of a patch shows as a kink where the lobe has fallen by this many digits less than
    /// count. Chosen.
    pub const CORNER_DIGITS: f64 = 2.0;
}
