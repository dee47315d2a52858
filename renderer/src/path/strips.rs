//! Where a streak crosses a pixel that sees a curved sample, found by looking.
//!
//! On a sphere or a cylinder no formula here gives the line p = 0 of the slope plane ([`super::streak`]), and it may be
//! a thousandth of a pixel wide: neither paths over the pixel nor [`super::cells`] meet it. But the slope changes its
//! sign across it. So the places where it does are found on a grid over the pixel, and the line is followed between
//! them, by strips that are cut until they are nearly straight and evenly bright.

use super::edge_slopes::{REACH, bulb_slopes};
use super::footprint::{Area, Outline};
use super::highlight::Highlight;
use super::seen::{OUTWARD, Seen, seen_toward};
use super::{Tracer, flank};
use crate::scene::{Encounter, Thing};
use crate::vector::Vec3;

/// Cells along a side of the grid on which a streak is looked for. Chosen.
const GRID: usize = 4;

/// A place is in the streak's middle where the slope is such a share of its reach. Chosen.
const MIDDLE: f64 = 0.05;

/// Places along a side of an area whose middle is beside the sample, among which one on it is looked for. Chosen.
const PLACES: usize = 8;

/// Parts of the limb in a cell, each of which is taken to be straight. Chosen.
const LIMB_PARTS: usize = 4;

/// Halvings by which the sample's limb is found.
const LIMB_STEPS: usize = 12;

/// The most steps to a place in a streak's middle.
const STEPS: usize = 40;

/// The step over which the slope's derivative across a strip is taken, as a share of the strip's length.
const DIFFERENCE: f64 = 1e-3;

/// The most that strips are cut, each in two. Chosen.
const CUTS_MAX: usize = 48;

/// Cutting ends where the light in doubt, because strips bend or are unevenly bright, is such a share of all. Chosen.
const EVEN: f64 = 0.25;

/// The half of a strip's width, in pixels, below which rounding would leave none.
const WIDTH_MIN: f64 = 1e-9;

/// Strips get paths of their own if they are a smaller share than this of what a pixel sees of the sample. It is larger
/// than for other highlights, because strips overlap and each knows how bright it is. Chosen.
const SHARE_MAX: f64 = 0.5;

/// A part of a streak between two places in its middle.
#[derive(Clone, Copy, Debug)]
struct Strip {
    ends: [[f64; 2]; 2],
    /// The place in the streak's middle beside that of the chord.
    middle: [f64; 2],
    /// How far it lies to the chord's left.
    sag: f64,
    half_width: f64,
    /// The brightness at the ends and at the middle between them.
    values: [f64; 3],
}

impl Strip {
    /// Between two places in the middle; `None` where the streak cannot be followed from one to the other.
    fn between(seen: &impl Seen, ends: [[f64; 2]; 2]) -> Option<Self> {
        let [from, to] = ends;
        let (along, length) = direction(ends);
        let across = [-along[1], along[0]];
        let chord_middle = [0, 1].map(|axis| 0.5 * (from[axis] + to[axis]));
        let beside = |at: [f64; 2], off: f64| [0, 1].map(|axis| at[axis] + off * across[axis]);
        let step = DIFFERENCE * length;
        let mut sag = 0.0f64;
        for _ in 0..STEPS {
            if sag.is_nan() || sag.abs() > length {
                return None;
            }
            let middle = beside(chord_middle, sag);
            let slope = seen.slope(middle)?;
            let derivative = change(seen, middle, across.map(|across| step * across))? / step;
            let reach = seen.reach(middle)?;
            if slope.abs() <= MIDDLE * reach {
                return Some(Self {
                    ends,
                    middle,
                    sag,
                    half_width: (reach / derivative.abs()).clamp(WIDTH_MIN, 1.0),
                    values: [from, middle, to].map(|at| seen.brightness(at)),
                });
            }
            sag -= slope / derivative;
        }
        None
    }

    /// The two strips that its middle parts it into; as an error, a straight one where the streak cannot be followed.
    fn halves(&self, seen: &impl Seen) -> [Result<Self, Self>; 2] {
        let [from, to] = self.ends;
        [[from, self.middle], [self.middle, to]]
            .map(|ends| Self::between(seen, ends).ok_or_else(|| self.straight(seen, ends)))
    }

    /// A strip along a chord, as wide as this one.
    fn straight(&self, seen: &impl Seen, ends: [[f64; 2]; 2]) -> Self {
        let [from, to] = ends;
        let middle = [0, 1].map(|axis| 0.5 * (from[axis] + to[axis]));
        Self {
            ends,
            middle,
            sag: 0.0,
            half_width: self.half_width,
            values: [from, middle, to].map(|at| seen.brightness(at)),
        }
    }

    fn most(&self) -> f64 {
        self.values.into_iter().fold(0.0, f64::max)
    }

    fn mean(&self) -> f64 {
        let [from, middle, to] = self.values;
        (from + 4.0 * middle + to) / 6.0
    }

    fn light(&self) -> f64 {
        let (_, length) = direction(self.ends);
        self.mean() * 2.0 * self.half_width * length
    }

    /// The share of it that lies beside the streak, because that bends.
    fn beside(&self) -> f64 {
        self.sag.abs() / (2.0 * self.half_width + self.sag.abs())
    }

    /// At most the light that its mean may be off by, as far as the places tell, and as much more as it is bent.
    fn doubt(&self) -> f64 {
        let least = self.values.into_iter().fold(f64::INFINITY, f64::min);
        let (_, length) = direction(self.ends);
        (self.most() - least + self.most() * self.beside()) * 2.0 * self.half_width * length
    }

    /// The rectangle about it in part of the film, and how bright that is.
    fn area(&self, bounds: [[f64; 2]; 2]) -> Option<(Area, f64)> {
        let (along, length) = direction(self.ends);
        let across = [-along[1], along[0]];
        let [right, left] = [
            self.sag.min(0.0) - self.half_width,
            self.sag.max(0.0) + self.half_width,
        ];
        // Where strips meet at an angle they leave no gap.
        let beyond = self.half_width.min(length);
        let [from, to] = self.ends;
        let corner = |end: [f64; 2], forward: f64, off: f64| {
            let [column, row] =
                [0, 1].map(|axis| end[axis] + forward * along[axis] + off * across[axis]);
            [column, row, 1.0]
        };
        let corners = vec![
            corner(from, -beyond, right),
            corner(to, beyond, right),
            corner(to, beyond, left),
            corner(from, -beyond, left),
        ];
        let bright = 0.5 * (self.mean() + self.most()) * (1.0 - self.beside());
        Some((Outline::of_corners(corners).within(bounds)?, bright))
    }
}

/// The unit vector from one place to another, and how far that is.
fn direction([from, to]: [[f64; 2]; 2]) -> ([f64; 2], f64) {
    let offset = [0, 1].map(|axis| to[axis] - from[axis]);
    let length = libm::hypot(offset[0], offset[1]);
    (offset.map(|offset| offset / length), length)
}

/// By how much the slope changes over an offset from a place; `None` where only the place is on the sample.
fn change(seen: &impl Seen, at: [f64; 2], offset: [f64; 2]) -> Option<f64> {
    let beside = |times: f64| [0, 1].map(|axis| at[axis] + times * offset[axis]);
    match [-1.0, 1.0].map(|times| seen.slope(beside(times))) {
        [Some(before), Some(after)] => Some(0.5 * (after - before)),
        [Some(before), None] => Some(seen.slope(at)? - before),
        [None, Some(after)] => Some(after - seen.slope(at)?),
        [None, None] => None,
    }
}

/// Where the streak crosses the line between two places with slopes of different signs, by regula falsi (Illinois).
fn crossing(seen: &impl Seen, ends: [([f64; 2], Option<f64>); 2]) -> Option<[f64; 2]> {
    let [(from, Some(mut first)), (to, Some(mut last))] = ends else {
        return None;
    };
    if (first < 0.0) == (last < 0.0) {
        return None;
    }
    let place = |share: f64| [0, 1].map(|axis| from[axis] + (to[axis] - from[axis]) * share);
    let mut shares = [0.0, 1.0];
    for _ in 0..STEPS {
        let share = shares[0] + (shares[1] - shares[0]) * (first / (first - last));
        let at = place(share);
        let slope = seen.slope(at)?;
        if slope.abs() <= MIDDLE * seen.reach(at)? {
            return Some(at);
        }
        if (slope < 0.0) == (first < 0.0) {
            (shares[0], first, last) = (share, slope, 0.5 * last);
        } else {
            (shares[1], last, first) = (share, slope, 0.5 * first);
        }
    }
    None
}

/// A place of `area` on the sample, in the middle of it if it can be: the outline of a sample close to the camera holds
/// much beside it.
fn middle_of(seen: &impl Seen, area: &Area, image: Option<[f64; 2]>) -> Option<[f64; 2]> {
    let is_seen = |at: &[f64; 2]| seen.slope(*at).is_some();
    let middle = area.point([0.5; 2]);
    if is_seen(&middle) {
        return Some(middle);
    }
    let places = (0..PLACES * PLACES)
        .map(|place| [place % PLACES, place / PLACES].map(|k| (k as f64 + 0.5) / PLACES as f64));
    let seen: Vec<[f64; 2]> = places.map(|at| area.point(at)).filter(is_seen).collect();
    let mean = [0, 1].map(|axis| seen.iter().map(|at| at[axis]).sum::<f64>() / seen.len() as f64);
    let nearest = image.map(|image| area.nearest(image));
    [Some(mean), nearest, seen.first().copied()]
        .into_iter()
        .flatten()
        .find(is_seen)
}

/// A place, and the slope there if it is on the sample.
type Node = ([f64; 2], Option<f64>);

/// The nodes of the grid over an area, row by row. The outer ones are a little outside of it. If none is on the sample,
/// each is moved to the limb, toward `middle`, which is on it.
fn nodes_of_grid(seen: &impl Seen, area: &Area, middle: [f64; 2]) -> Vec<Node> {
    let [least, largest] = area.bounds();
    let place = |index: usize| {
        let steps = [index % (GRID + 1), index / (GRID + 1)];
        [0, 1].map(|axis| {
            let share = steps[axis] as f64 / GRID as f64;
            let outward = OUTWARD * (2.0 * share - 1.0);
            least[axis] + (largest[axis] - least[axis]) * (share + outward)
        })
    };
    let node = |at: [f64; 2]| (at, seen.slope(at));
    let places = || (0..(GRID + 1) * (GRID + 1)).map(place);
    let nodes: Vec<_> = places().map(node).collect();
    if nodes.iter().any(|(_, slope)| slope.is_some()) {
        return nodes;
    }
    let pulled = places().map(|at| seen_toward(seen, [middle, at], LIMB_STEPS));
    pulled.map(node).collect()
}

/// The outline of what is on the sample of a cell with these corners: these, and the limb between them.
fn on_sample(seen: &impl Seen, corners: [Node; 4]) -> Vec<Node> {
    let node = |at: [f64; 2]| (at, seen.slope(at));
    // Each place, and whether it is one of the limb.
    let mut outline = Vec::new();
    for side in 0..4 {
        let [from, to] = [corners[side], corners[(side + 1) % 4]];
        if from.1.is_some() {
            outline.push((from, false));
        }
        let limb = match [from.1, to.1] {
            [Some(_), None] => seen_toward(seen, [from.0, to.0], LIMB_STEPS),
            [None, Some(_)] => seen_toward(seen, [to.0, from.0], LIMB_STEPS),
            _ => continue,
        };
        outline.push((node(limb), true));
    }
    let count = outline.len();
    let sums = outline.iter().fold([0.0; 2], |sums, ((at, _), _)| {
        [0, 1].map(|axis| sums[axis] + at[axis])
    });
    let middle = sums.map(|sum| sum / count as f64);
    let with_limb = (0..count).flat_map(|place| {
        let [(from, leaves), (to, enters)] =
            [place, (place + 1) % count].map(|place| outline[place]);
        let parts = if leaves && enters { LIMB_PARTS } else { 1 };
        // The limb bends outward.
        let bent = (1..parts).map(move |part| {
            let share = part as f64 / parts as f64;
            let to = [0, 1].map(|axis| {
                let chord = from.0[axis] + (to.0[axis] - from.0[axis]) * share;
                2.0 * chord - middle[axis]
            });
            node(seen_toward(seen, [middle, to], LIMB_STEPS))
        });
        std::iter::once(from).chain(bent)
    });
    with_limb.collect()
}

/// The strips between the crossings of the sides of each of the grid's cells; in the cell of `image`, those from there.
/// `middle` is a place of the area on the sample.
fn of_grid(seen: &impl Seen, area: &Area, middle: [f64; 2], image: Option<[f64; 2]>) -> Vec<Strip> {
    let nodes = nodes_of_grid(seen, area, middle);
    let cells = (0..GRID * GRID).map(|cell| cell + cell / GRID);
    let mut strips = Vec::new();
    for first in cells {
        let corners = [first, first + 1, first + GRID + 2, first + GRID + 1];
        let outline = on_sample(seen, corners.map(|corner| nodes[corner]));
        let next = outline.iter().cycle().skip(1);
        let sides = outline.iter().zip(next);
        let crossings = sides.filter_map(|(from, to)| crossing(seen, [*from, *to]));
        let crossings: Vec<[f64; 2]> = crossings.collect();
        let [least, largest] = [nodes[first].0, nodes[first + GRID + 2].0];
        let is_inside = |at: &[f64; 2]| (0..2).all(|i| (least[i]..=largest[i]).contains(&at[i]));
        if let Some(image) = image.filter(is_inside) {
            let from_image = |to: [f64; 2]| Strip::between(seen, [image, to]);
            strips.extend(crossings.into_iter().filter_map(from_image));
            continue;
        }
        let ends = crossings.chunks_exact(2);
        strips.extend(ends.filter_map(|ends| Strip::between(seen, [ends[0], ends[1]])));
    }
    strips
}

/// The parts of `area` that the streak crosses, and how bright they are, in units of white. A bulb's image may be so
/// small that none but strips from the middle of its `image` show it.
fn of(seen: &impl Seen, area: &Area, image: Option<[f64; 2]>) -> Vec<(Area, f64)> {
    let Some(middle) = middle_of(seen, area, image) else {
        return Vec::new();
    };
    let mut strips = of_grid(seen, area, middle, image);
    let mut whole = Vec::new();
    for _ in 0..CUTS_MAX {
        let all = || strips.iter().chain(&whole);
        let doubt: f64 = strips.iter().map(Strip::doubt).sum();
        if doubt <= EVEN * all().map(Strip::light).sum::<f64>() {
            break;
        }
        let by_doubt = |a: &usize, b: &usize| strips[*a].doubt().total_cmp(&strips[*b].doubt());
        let Some(index) = (0..strips.len()).max_by(by_doubt) else {
            break;
        };
        let strip = strips.swap_remove(index);
        match strip.halves(seen) {
            [Err(_), Err(_)] => whole.push(strip),
            halves => {
                for half in halves {
                    match half {
                        Ok(half) => strips.push(half),
                        Err(straight) => whole.push(straight),
                    }
                }
            }
        }
    }
    let lit = strips
        .iter()
        .chain(&whole)
        .filter(|strip| strip.most() > 0.0);
    let mut parts: Vec<_> = lit.filter_map(|strip| strip.area(area.bounds())).collect();
    parts.extend(flank::of(seen, area, middle));
    parts
}

impl Seen for Tracer<'_> {
    fn slope(&self, at: [f64; 2]) -> Option<f64> {
        let (wo, to_bulb) = self.on_sample(at)?;
        let half = self.reflectance.lobe.to_lobe(wo + to_bulb.normalized());
        Some(half.x / half.z)
    }

    fn reach(&self, at: [f64; 2]) -> Option<f64> {
        let (wo, to_bulb) = self.on_sample(at)?;
        let lobe = &self.reflectance.lobe;
        let half = lobe.to_lobe(wo + to_bulb.normalized());
        let q = half.y / half.z;
        let [p, _] = bulb_slopes(wo, to_bulb, self.scene.bulb.radius, lobe);
        let extent = p - (half.x / half.z).abs();
        // At this q the lobe is as narrow as exp(-n p^2 / (2 (1 + q^2))).
        Some(extent + REACH * ((1.0 + q * q) / lobe.n_u).sqrt())
    }

    fn brightness(&self, at: [f64; 2]) -> f64 {
        Tracer::brightness(self, at)
    }
}

impl Tracer<'_> {
    /// The directions to the camera, a unit, and to the bulb's centre, in metres, in the frame of the sample at a
    /// place of the film.
    fn on_sample(&self, [column, row]: [f64; 2]) -> Option<(Vec3, Vec3)> {
        let ray = self.scene.camera.ray(column, row);
        match self.scene.encounter(&ray, None)? {
            Encounter::Surface(surface) if surface.thing == Thing::Sample => {
                let to_bulb = self.scene.bulb.centre - surface.position;
                let directions = [-ray.direction, to_bulb].map(|to| surface.frame.to_local(to));
                Some(directions.into())
            }
            _ => None,
        }
    }

    /// The streak in the part of a pixel that sees a curved sample; `None` where the lobe makes none, none crosses it
    /// or it is no small share of it.
    pub(super) fn streak_in(&self, area: &Area, image: Option<[f64; 2]>) -> Option<Highlight> {
        let strips = of(self, area, image);
        let size: f64 = strips.iter().map(|(strip, _)| strip.size()).sum();
        let is_small = size < SHARE_MAX * area.size();
        is_small.then(|| Highlight::new(strips))?
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::{Rng, SeedableRng};

    /// A streak along part of a circle, on a sample that ends at another circle.
    struct Arc {
        centre: [f64; 2],
        radius: f64,
        half_width: f64,
        limb: Option<f64>,
    }

    impl Seen for Arc {
        fn slope(&self, [x, y]: [f64; 2]) -> Option<f64> {
            if self
                .limb
                .is_some_and(|limb| libm::hypot(x - 0.5, y + 1.0) > limb)
            {
                return None;
            }
            let off = libm::hypot(x - self.centre[0], y - self.centre[1]) - self.radius;
            // Slopes are not linear in the place.
            Some(off * (1.0 + 0.3 * off))
        }

        fn reach(&self, _: [f64; 2]) -> Option<f64> {
            Some(self.half_width)
        }

        fn brightness(&self, [x, y]: [f64; 2]) -> f64 {
            1.0 + x + y
        }
    }

    /// A number in 0 to 1.
    pub fn uniform(random: &mut ChaCha8Rng) -> f64 {
        f64::from(random.next_u32()) / f64::from(u32::MAX)
    }

    /// The pixel in column and row 0, all of which sees the sample.
    pub fn pixel() -> Area {
        let corners = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]].map(|[x, y]| [x, y, 1.0]);
        let outline = Outline::of_corners(corners.to_vec());
        outline.within([[0.0; 2], [1.0; 2]]).expect("a pixel")
    }

    /// However narrow it is, a streak is found and held up to the limb, from a bulb's image on it or without one, by
    /// strips that are hardly larger but where it is narrower than they can be.
    #[test]
    fn the_strips_of_a_streak_hold_it() {
        let area = pixel();
        let mut random = ChaCha8Rng::seed_from_u64(23);
        let (mut looked_at, mut missed, mut images) = (0, 0, 0);
        for draw in 0..3000 {
            let mut draws = || uniform(&mut random);
            let radius = 0.5 + 5.0 * draws();
            let turn = std::f64::consts::TAU * draws();
            let (sin, cos) = libm::sincos(turn);
            let arc = Arc {
                centre: [
                    0.3 + 0.4 * draws() + radius * cos,
                    0.3 + 0.4 * draws() + radius * sin,
                ],
                radius,
                half_width: libm::exp10(-2.0 - 4.0 * draws()),
                limb: (draw % 2 == 0).then(|| 1.5 + 0.5 * draws()),
            };
            let (sin, cos) = libm::sincos(std::f64::consts::TAU * draws());
            let image = [arc.centre[0] + radius * cos, arc.centre[1] + radius * sin];
            let is_seen = |at: &[f64; 2]| {
                at.iter().all(|at| (0.0..1.0).contains(at)) && arc.slope(*at).is_some()
            };
            let image = is_seen(&image).then_some(image);
            images += u32::from(image.is_some());
            let strips = of(&arc, &area, image);
            let size: f64 = strips.iter().map(|(strip, _)| strip.size()).sum();
            let (mut inside, steps) = (0, 4000);
            for step in 0..steps {
                let (sin, cos) =
                    libm::sincos(std::f64::consts::TAU * f64::from(step) / f64::from(steps));
                let off = radius + 1.8 * (draws() - 0.5) * arc.half_width;
                let at = [arc.centre[0] + off * cos, arc.centre[1] + off * sin];
                if at.iter().all(|at| (0.0..1.0).contains(at)) && arc.slope(at).is_some() {
                    inside += 1;
                    missed += u32::from(!strips.iter().any(|(strip, _)| strip.holds(at)));
                }
            }
            looked_at += inside;
            let length = std::f64::consts::TAU * radius * f64::from(inside) / f64::from(steps);
            let own = 2.0 * arc.half_width * (length + 0.1);
            // Bands along the limb may be deeper than a narrow streak is wide.
            assert!(
                size < 2.0 * own + 1e-3,
                "draw {draw}: strips of {size} about {own}"
            );
        }
        assert!(looked_at > 500_000, "{looked_at}");
        assert!(images > 200, "{images}");
        assert!(missed * 10_000 < looked_at, "{missed} of {looked_at}");
    }
}
