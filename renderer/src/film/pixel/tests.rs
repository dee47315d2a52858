use super::*;

const TOLERANCE: f64 = 4e-5;
const WORK: Work = Work {
    points_max: 4_000,
    evaluations_max: u64::MAX,
};

fn unit_square() -> Polygon {
    let square = Polygon::quadrilateral([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]);
    square.clipped(&Rectangle::pixel(0, 0))
}

/// Kronecker's sequence: positions that no rule's points favour.
fn fraction(index: u32, factor: f64) -> f64 {
    (f64::from(index) * factor).fract()
}

/// The area of the unit square where `height` is positive, which is linear in the position.
fn area(height: impl Fn([f64; 2]) -> f64) -> f64 {
    let square = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
    let mut kept: Vec<[f64; 2]> = Vec::new();
    for (index, to) in square.into_iter().enumerate() {
        let from = square[(index + 3) % 4];
        let (before, after) = (height(from), height(to));
        if (before > 0.0) != (after > 0.0) {
            let share = before / (before - after);
            kept.push([0, 1].map(|axis| from[axis] + share * (to[axis] - from[axis])));
        }
        if after > 0.0 {
            kept.push(to);
        }
    }
    let next = kept.iter().cycle().skip(1);
    let twice = kept
        .iter()
        .zip(next)
        .map(|(a, b)| a[0] * b[1] - a[1] * b[0]);
    0.5 * twice.sum::<f64>()
}

/// What the integral of a step of this height at a line is off by, and what it states.
fn step_along(normal: [f64; 2], offset: f64, step: f64) -> [f64; 2] {
    let height = |[x, y]: [f64; 2]| normal[0] * x + normal[1] * y - offset;
    let pixel = unit_square();
    let axis = usize::from(normal[1].abs() > normal[0].abs());
    let (value, stated) = integrate(&pixel, axis, TOLERANCE, &WORK, |x, y| {
        ([if height([x, y]) > 0.0 { step } else { 0.0 }; 3], 1)
    });
    [(value[0] - step * area(height)).abs(), stated]
}

#[test]
fn steps_are_off_by_no_more_than_stated() {
    for index in 0..2_000 {
        let mut angle = std::f64::consts::TAU * fraction(index, 0.754_877_666_246_692_8);
        if index % 2 == 0 {
            // All lines meet it at nearly one place.
            angle *= 1e-3;
        }
        let offset = 1.5 * fraction(index, 0.569_840_290_998_053_2);
        let (sin, cos) = libm::sincos(angle);
        let [off, stated] = step_along([cos, sin], offset, 0.07);
        assert!(
            off <= stated.max(TOLERANCE),
            "{angle} {offset}: {off}, stated {stated}"
        );
    }
}

/// A rise across the unit square as the normal distribution's, and what is told of it.
struct Rise<'a> {
    normal: [f64; 2],
    offset: f64,
    width: f64,
    /// By how much of a line, and by what factor, the edge that is told of is misplaced; `None` if none is.
    told: Option<[f64; 2]>,
    points: &'a Cell<u64>,
}

impl<'a> Rise<'a> {
    /// At any angle, and 2 to 100 of them to a pixel.
    fn drawn(index: u32, told: Option<[f64; 2]>, points: &'a Cell<u64>) -> Self {
        let angle = std::f64::consts::TAU * fraction(index, 0.754_877_666_246_692_8);
        let (sin, cos) = libm::sincos(angle);
        let inside = [0.618_033_988_749_894_9, 0.414_213_562_373_095_1];
        let [x, y] = inside.map(|factor| fraction(index, factor));
        Self {
            normal: [cos, sin],
            offset: cos * x + sin * y,
            width: 0.5 * libm::pow(0.02, fraction(index, 0.569_840_290_998_053_2)),
            told,
            points,
        }
    }

    fn height(&self, [x, y]: [f64; 2]) -> f64 {
        self.normal[0] * x + self.normal[1] * y - self.offset
    }

    /// The area on one side of the lines of equal height, each as often as it stands.
    fn mean(&self) -> f64 {
        let step = 1.0 / 64.0;
        let heights = (-512..=512).map(|index| step * f64::from(index));
        let weighed = heights.map(|z| {
            let beyond = area(|at| self.height(at) + self.width * z);
            step * libm::exp(-0.5 * z * z) * beyond
        });
        weighed.sum::<f64>() / std::f64::consts::TAU.sqrt()
    }

    /// What the integral is off by, and what it states.
    fn off(self) -> [f64; 2] {
        let expected = self.mean();
        let axis = usize::from(self.normal[1].abs() > self.normal[0].abs());
        let (value, stated) = integrate(&unit_square(), axis, TOLERANCE, &WORK, self);
        [(value[0] - expected).abs(), stated]
    }
}

impl OnPixel for Rise<'_> {
    fn at(&mut self, film_point: [f64; 2]) -> ([f64; 3], u64) {
        self.points.set(self.points.get() + 1);
        let in_widths = self.height(film_point) / self.width;
        let value = 0.5 * (1.0 + libm::erf(in_widths * std::f64::consts::FRAC_1_SQRT_2));
        ([value; 3], 1)
    }

    fn edge(&self, axis: usize, across: f64, [from, to]: [f64; 2]) -> Option<Edge> {
        let [misplaced, wider] = self.told?;
        let normal = self.normal[axis];
        let at = (self.offset - self.normal[1 - axis] * across) / normal;
        let width = self.width / normal.abs();
        (from < at && at < to).then_some(Edge {
            at: at + misplaced * (to - from),
            width: wider * width,
        })
    }
}

#[test]
fn an_edge_that_is_known_takes_fewer_points() {
    let [with, without] = [Some([0.0, 1.0]), None].map(|told| {
        let points = Cell::new(0);
        for index in 0..500 {
            let rise = Rise::drawn(index, told, &points);
            let [off, stated] = rise.off();
            assert!(off <= stated.max(TOLERANCE), "{index}: {off}, {stated}");
        }
        points.get() as f64
    });
    assert!(with < 0.7 * without, "{with} {without}");
}

/// An edge is told of where the function's outline has it, which is not where it changes by half if that bends.
#[test]
fn an_edge_that_is_misplaced_is_off_by_no_more_than_stated() {
    let points = Cell::new(0);
    for index in 0..1_000 {
        let misplaced = 0.4 * (fraction(index, 0.324_717_957_244_746) - 0.5);
        let wider = libm::pow(100.0, fraction(index, 0.236_067_977_499_789_7) - 0.5);
        let rise = Rise::drawn(index, Some([misplaced, wider]), &points);
        let [off, stated] = rise.off();
        assert!(off <= stated.max(TOLERANCE), "{index}: {off}, {stated}");
    }
}

/// A rise over the rim of a disc, which is told of, and a step over a straight line, which is not.
struct Rim {
    centre: [f64; 2],
    radius: f64,
    width: f64,
    is_told: bool,
    /// A line's direction, its distance, and the height of the step over it.
    step: ([f64; 2], f64, f64),
}

impl Rim {
    /// Radii of 2 to 64 pixels, and 2 to 200 widths of the rim to a pixel.
    fn drawn(index: u32, step: f64) -> Self {
        let fraction = |factor| fraction(index, factor);
        let radius = 2.0 * libm::pow(32.0, fraction(0.754_877_666_246_692_8));
        let through = [0.618_033_988_749_894_9, 0.414_213_562_373_095_1].map(fraction);
        let (sin, cos) = libm::sincos(std::f64::consts::TAU * fraction(0.324_717_957_244_746));
        let (down, right) = libm::sincos(std::f64::consts::TAU * fraction(0.236_067_977_499_789_7));
        Self {
            centre: [through[0] - radius * cos, through[1] - radius * sin],
            radius,
            width: 0.5 * libm::pow(0.01, fraction(0.569_840_290_998_053_2)),
            is_told: true,
            step: (
                [right, down],
                0.5 * (right + down) + 0.4 * (through[0] - 0.5),
                step,
            ),
        }
    }

    fn outside(&self, [x, y]: [f64; 2]) -> f64 {
        libm::hypot(x - self.centre[0], y - self.centre[1]) - self.radius
    }

    /// The integral to a tolerance, what it states, and points.
    fn integral(&self, tolerance: f64, work: &Work) -> (f64, f64, u64) {
        let (away, points) = (self.outside([0.5; 2]), Cell::new(0));
        let slope = [0, 1].map(|axis| (0.5 - self.centre[axis]) / (away + self.radius));
        let axis = usize::from(slope[1].abs() > slope[0].abs());
        let (value, stated) = integrate(&unit_square(), axis, tolerance, work, (self, &points));
        (value[0], stated, points.get())
    }
}

impl OnPixel for (&Rim, &Cell<u64>) {
    fn at(&mut self, film_point: [f64; 2]) -> ([f64; 3], u64) {
        let (rim, points) = self;
        points.set(points.get() + 1);
        let in_widths = rim.outside(film_point) / rim.width;
        let (normal, distance, height) = rim.step;
        let beyond = normal[0] * film_point[0] + normal[1] * film_point[1] > distance;
        let light = 0.5 * libm::erfc(in_widths * std::f64::consts::FRAC_1_SQRT_2);
        ([light + if beyond { height } else { 0.0 }; 3], 1)
    }

    fn edge(&self, axis: usize, across: f64, [from, to]: [f64; 2]) -> Option<Edge> {
        let rim = self.0;
        let aside = across - rim.centre[1 - axis];
        let half = (rim.radius * rim.radius - aside * aside).max(0.0).sqrt();
        let mut ends = [-half, half]
            .map(|half| rim.centre[axis] + half)
            .into_iter();
        let at = ends.find(|&at| from < at && at < to)?;
        let slope = (at - rim.centre[axis]).abs() / rim.radius;
        let width = rim.width / slope;
        (rim.is_told && width.is_finite()).then_some(Edge { at, width })
    }
}

const MUCH: Work = Work {
    points_max: 4_000_000,
    evaluations_max: u64::MAX,
};

#[test]
fn a_rim_is_off_by_no_more_than_stated() {
    let (mut with, mut without) = (0, 0);
    for index in 0..600 {
        let mut rim = Rim::drawn(index, 0.0);
        let (value, stated, points) = rim.integral(TOLERANCE, &WORK);
        rim.is_told = false;
        let (expected, ..) = rim.integral(1e-8, &MUCH);
        let off = (value - expected).abs();
        assert!(off <= stated.max(TOLERANCE), "{index}: {off}, {stated}");
        with += points;
        without += rim.integral(TOLERANCE, &WORK).2;
    }
    assert!(with < without / 3 * 2, "{with} {without}");
}

/// Lines along a known edge begin with few points; what else is on the pixel is not lost.
#[test]
fn a_step_beside_a_known_rim_is_off_by_no_more_than_stated() {
    for index in 0..2_000 {
        let height = libm::exp10(-4.0 * fraction(index, 0.148_148_148_1));
        let mut rim = Rim::drawn(index, height);
        let (value, stated, _) = rim.integral(TOLERANCE, &WORK);
        rim.step.2 = 0.0;
        let (of_rim, ..) = rim.integral(1e-6, &MUCH);
        let (normal, distance, _) = rim.step;
        let beyond = area(|at| normal[0] * at[0] + normal[1] * at[1] - distance);
        let off = (value - of_rim - height * beyond).abs();
        assert!(
            off <= stated.max(TOLERANCE),
            "{index} {height}: {off}, {stated}"
        );
    }
}

#[test]
fn what_lies_in_a_corner_is_found() {
    for side in [0.1, 0.01, 0.004, 0.002] {
        let [off, stated] = step_along([-1.0, -1.0], -side, 10.0);
        assert!(off <= stated.max(TOLERANCE), "{side}: {off}, {stated}");
    }
}

/// The area of the unit square that a disc covers which reaches into it from below by `depth`, at most 1.
fn tip([centre, radius, depth]: [f64; 3]) -> f64 {
    let low = radius - depth;
    let half = (radius * radius - low * low).sqrt();
    let [from, to] = [0.0, 1.0].map(|x: f64| (x - centre).clamp(-half, half));
    let up_to = |u: f64| {
        let root = (radius * radius - u * u).sqrt();
        0.5 * (u * root + radius * radius * libm::asin(u / radius)) - low * u
    };
    up_to(to) - up_to(from)
}

/// Lines across the tip of a disc have lengths with kinks where it begins, lines along its chord one that falls
/// like a root. There the difference of 15 and 7 points alone vanished at places where 15 points were off: in 145
/// of these cases by up to 137 times what was stated (draw 1124 of seed 20261131 of the search was one).
#[test]
fn the_tip_of_a_disc_is_off_by_no_more_than_stated() {
    let pixel = unit_square();
    for index in 0..4_000 {
        let radius = 2.0 + 4.0 * fraction(index, 0.754_877_666_246_692_8);
        let depth = libm::exp10(-3.0 * fraction(index, 0.569_840_290_998_053_2));
        let centre = fraction(index, 0.618_033_988_749_894_9);
        let expected = tip([centre, radius, depth]);
        let tolerance = 3e-4 * expected.max(1e-3);
        for axis in 0..2 {
            let (value, stated) = integrate(&pixel, axis, tolerance, &WORK, |x, y| {
                let [right, up] = [x - centre, y - depth + radius];
                let inside = right * right + up * up < radius * radius;
                ([if inside { 1.0 } else { 0.0 }; 3], 1)
            });
            let off = (value[0] - expected).abs();
            assert!(
                off <= stated.max(tolerance),
                "{centre} {radius} {depth}: {off}, stated {stated}"
            );
        }
    }
}

/// Points may be far dearer than others of the function were.
#[test]
fn work_is_counted_by_what_points_take() {
    const DEAR: u64 = 10_000;
    let pixel = unit_square();
    let work = Work {
        points_max: 4_000,
        evaluations_max: 400 * DEAR,
    };
    let mut spent = 0;
    let (_, stated) = integrate(&pixel, 0, 1e-9, &work, |x, y| {
        spent += DEAR;
        ([if x * x + y * y < 0.5 { 1.0 } else { 0.0 }; 3], DEAR)
    });
    // The lines that are under way end, with 17 points each.
    assert!(spent <= (FIRST_LINES * 400 + 17 * 17) * DEAR, "{spent}");
    assert!(stated > 1e-4, "{stated}");
}
