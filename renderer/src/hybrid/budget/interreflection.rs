//! Interreflection. Shares are of the chart's tolerance.

/// What order 1 and all higher orders may miss. Chosen: the rest of the target is left to the
/// chart's tiles on the film.
pub const ORDER_1_SHARE: f64 = 0.35;
pub const HIGHER_SHARE: f64 = 0.15;

/// The share below which a bound stands for the light itself. Chosen.
pub const LEFT_OUT_SHARE: f64 = 0.05;

/// Of an error that is allowed, the share that the rules over the sample may miss; the rest is left
/// to the series. Chosen.
pub const RULE_SHARE: f64 = 0.4;

/// Of an error that is allowed, the share that the cubature over the bulb may miss. Chosen.
pub const DISC_SHARE: f64 = 0.1;

/// A bulb of up to this half width, in widths of the lobe along its narrow axis, may count as a point, if
/// [`DISC_SHARE`] allows it. Derived: over a disc of radius r the mean of a normal density is off by r^2 / 4 of it
/// at its middle, a hundredth.
pub const POINT_WIDTHS: f64 = 0.2;

/// The most rings of that cubature. A limit on work. Chosen.
pub const RINGS_MAX: usize = 8;

/// Decimal digits of the rules over the sample, from coarse to fine. The finest is only for
/// comparison. Chosen.
pub const DIGITS: [f64; 7] = [2.0, 2.7, 3.5, 4.5, 6.0, 8.0, 10.0];

/// The levels of [`DIGITS`] that have a finer one to compare with.
pub const LEVEL_MAX: usize = DIGITS.len() - 2;

/// Cells of the chart by level: their sides over their distance from the sample, at most, and
/// points along either side of them. Chosen.
pub const CELLS: [(f64, usize); LEVEL_MAX + 2] = [
    (2.0, 1),
    (1.0, 1),
    (1.0, 2),
    (0.5, 2),
    (0.5, 3),
    (0.5, 4),
    (0.5, 5),
];

/// The finest division of a patch: 2 to this power along either side. A limit on work. Chosen.
pub const DIVISIONS_MAX: u32 = 8;

/// Evaluations of the reflectance for order 1, and for the higher ones: about a tenth of a second
/// (measured).
pub const EVALUATIONS_MAX: u64 = 12_000_000;

/// Evaluations of the coarsest rules for the higher orders, in half a second: nothing is known without them. The
/// path tracer renders what takes more. Measured: 9 of 600 charts drawn at random take more than
/// [`EVALUATIONS_MAX`] for them, up to 2.7 times as much; of 40 with 64 x 64 patches on the sample's edge 3 would
/// take up to 3.6 times as much as this.
pub const FIRST_EVALUATIONS_MAX: u64 = 50_000_000;

/// Higher orders that miss this many times what they may (3.6 times the target) are worth all of
/// [`EVALUATIONS_MAX`], others proportionally less: pixels have room for a small excess, and time has not.
/// Measured on the first 1,000 materials of the preset: with 8 they take 5 percent more time, and as many images
/// have a hundredth of their pixels above the tolerance.
pub const EXCESS_WORTH_ALL: f64 = 60.0;

/// A rule is taken not to resolve the lobe if the next finer one moves the result by more than this
/// share of it. Chosen.
pub const UNRESOLVED_SHARE: f64 = 0.25;

/// Light that no rule resolves, but that is below this much of white at every node that was tried,
/// is stated as an error: the path tracer's own is as large.
pub const UNRESOLVED_MAX: f64 = 2e-3;

/// A column of the chart narrower than this share of it is no tile of its own. Chosen.
pub const SLIVER: f64 = 1e-6;

/// A tile is halved before its rules are refined if its series leaves out this many times more than
/// they miss. Chosen.
pub const SERIES_FIRST: f64 = 3.0;

/// Halving did not help if the half's series still leaves out this share of the whole's: for a
/// smooth function it is far below. Chosen.
pub const STUCK: f64 = 0.5;

/// But then the rules are not to blame if they miss less than this share of it where they were
/// compared with finer ones. Chosen.
pub const STUCK_MISSED: f64 = 0.03;

/// A part of the chart states this many times what the tiles on it and beside it show to be off by, but no
/// more than the worst of all. Measured on materials 416 and 608 of the preset, at 400 points of the chart
/// each: one is off by 1.3 times what it states. With each tile's own error 20 of 400 were, by up to 12 times.
pub const NEIGHBOURS_DOUBT: f64 = 2.0;

/// A glance at the higher orders.
#[derive(Clone, Copy, Debug)]
pub struct Glance {
    /// Points of the chart that it takes.
    pub points: usize,
    /// How many times what it sees there by the coarsest rules there may be elsewhere.
    pub margin: f64,
}

/// Measured against fine rules at 40 points of each of 2,040 charts drawn at random, up to 40 patches wide and down
/// to a few pixels: at most 11.3 times what is seen (`a_glance_at_higher_orders_tells_how_dark_they_are` draws a
/// part of them).
pub const GLANCE: Glance = Glance {
    points: 9,
    margin: 20.0,
};

/// The same from [`super::COARSE_TARGET`] on. Measured in the same way on 840 charts: at most 17.2 times. It takes a
/// twentieth off the time of an image at a target of 0.1.
pub const COARSE_GLANCE: Glance = Glance {
    points: 5,
    margin: 40.0,
};

/// Points off the nodes at which a tile of the higher orders is looked at, divided among the chart's columns.
/// Measured with [`OFF_NODES_DOUBT`].
pub const OFF_NODES: usize = 9;

/// A tile of the higher orders states this many times what it is off by at the worst of them. Measured on 40
/// charts drawn at random, at 24 points each: one point of 912 is off by more than it states, by 1.2 times
/// (`higher_orders_state_what_they_are_off_by`); by the last coefficients alone 70 are, by up to 50.
pub const OFF_NODES_DOUBT: f64 = 2.0;

/// Tiles are halved no more than this often. A limit on work. Chosen.
pub const HALVINGS_MAX: u32 = 12;

/// From this exponent on an anisotropic lobe is narrow enough that lines along its u axis pay.
pub const ROTATED_FROM: f64 = 10.0;

/// The bulb's half width, in widths of the lobe along its narrow axis, from which on the bulb is cut into
/// arcs. Where a line ends beside the bulb's outline, they miss a share that rises with the lobe's width.
/// Measured on 161 views of the preset: from 1 on arcs take less time, below it up to five times as much.
/// Material 5136 needs them at 2.04.
pub const BULB_WIDTHS: f64 = 2.0;

/// The largest angular radius of a bulb that is cut into arcs: over a larger one the lobe's width changes.
/// Measured on lines drawn at random: up to it arcs were off by a hundredth at most.
pub const ARCS_HALF_ANGLE_MAX: f64 = 0.15;

/// Lines over an anisotropic lobe are as dense as this exponent asks for, if not denser: the
/// lobe turns from line to line where light grazes the sample, however wide it is. Measured on
/// 370 and 690 of the preset, whose rules missed a hundredth at every level without it; highly
/// anisotropic lobes take less work with it.
pub const BESIDE_RIDGE_EXPONENT: f64 = 160.0;

/// Digits beyond those that count at which the tail of a narrow lobe is cut. Chosen.
pub const TAIL_DIGITS: f64 = 1.0;

/// Boxes along each side of the sample, and across and up the chart, by which the light of the bulb
/// is bounded. A limit on work. Chosen.
pub const BULB_BOXES: [usize; 3] = [5, 4, 10];

/// The same for the light of the chart, where pairs of boxes of the chart are tried.
pub const CHART_BOXES: [usize; 3] = [3, 2, 8];

/// Interreflections that are kept: those of two materials in the preset's rotations of the sample.
pub const KEPT: usize = 10;
