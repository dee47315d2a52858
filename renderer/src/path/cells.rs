//! The parts of a pixel that send most light, found by looking.
//!
//! Near the horizon a highlight has an outline that no formula here gives: its middle is beside the mirror image, and
//! slopes of half vectors are not linear across it. On the sample's edge only a sliver of it may be left. A pixel that
//! sees most of the sample may hold all of this in a thousandth of its area. So the pixel is cut into cells, smaller
//! ones where brightness changes.

use super::footprint::{Area, Outline};
use super::{Tracer, glint};
use crate::scene::{Encounter, Thing};
use crate::vector::Vec3;
use crate::warp::Cone;
use std::f64::consts::PI;

/// How many times as bright as a pixel is on average some place has to be for the pixel to be cut. Chosen.
const UNEVEN: f64 = 4.0;

/// Where a pixel is no brighter than this, in units of white, where it should be brightest, it is not cut. A hundredth
/// of the smallest tolerance.
const DARK: f64 = 1e-9;

/// The most that cells are cut, each into four. Chosen.
const CUTS_MAX: usize = 96;

/// Nothing more is cut where what brightness may differ by within cells is such a share of all light. Chosen.
const EVEN: f64 = 0.25;

/// By how much the bulb is taken to be larger than it is, so that cells on the rim of its image are seen to hold
/// some of it. Chosen.
const LARGER: f64 = 1.3;

/// Where of the unit square an area is looked at.
const PLACES: [[f64; 2]; 4] = [[0.25, 0.25], [0.75, 0.25], [0.25, 0.75], [0.75, 0.75]];

/// A place on a side is looked at this share of the way to the middle, too: on the side itself rounding may miss the
/// sample.
const INWARD: f64 = 1e-3;

/// The part of a rectangle of the film that sees the sample, and how bright it is at places.
#[derive(Clone, Debug)]
struct Cell {
    area: Area,
    mean: f64,
    least: f64,
    most: f64,
}

impl Cell {
    /// At most the light that its mean may be off by, as far as the places tell.
    fn doubt(&self) -> f64 {
        (self.most - self.least) * self.area.size()
    }

    fn light(&self) -> f64 {
        self.mean * self.area.size()
    }

    /// What it is taken to send: more than its mean, because the brightest place may lie between those looked at.
    fn bright(&self) -> f64 {
        0.5 * (self.mean + self.most)
    }
}

/// Cuts what a pixel sees of the sample.
struct Cutter<'a, F> {
    outline: &'a Outline,
    /// Where on the film most light is, about.
    toward: Option<[f64; 2]>,
    brightness: F,
}

impl<F: Fn([f64; 2]) -> f64> Cutter<'_, F> {
    /// Looks at places of an area, and at those nearest to where most light is: the image of a small bulb may be cut by
    /// the area's side.
    fn cell(&self, area: Area) -> Cell {
        let values = PLACES.map(|place| (self.brightness)(area.point(place)));
        let nearest = self.toward.map(|toward| {
            let (nearest, middle) = (area.nearest(toward), area.point([0.5; 2]));
            let inward = [0, 1].map(|axis| nearest[axis] + (middle[axis] - nearest[axis]) * INWARD);
            [nearest, inward]
        });
        let nearest = nearest.into_iter().flatten();
        let looked_at = values.into_iter().chain(nearest.map(&self.brightness));
        let range = [f64::INFINITY, 0.0];
        let [least, most] = looked_at.fold(range, |[least, most], value| {
            [least.min(value), most.max(value)]
        });
        Cell {
            area,
            mean: values.iter().sum::<f64>() / values.len() as f64,
            least,
            most,
        }
    }

    /// The quarters of the rectangle about an area.
    fn quarters(&self, area: &Area) -> impl Iterator<Item = Cell> {
        let [least, largest] = area.bounds();
        let middle = [0, 1].map(|axis| 0.5 * (least[axis] + largest[axis]));
        let steps = [[0, 0], [1, 0], [0, 1], [1, 1]];
        steps.into_iter().filter_map(move |steps: [usize; 2]| {
            let corner = [0, 1].map(|axis| [least, middle][steps[axis]][axis]);
            let end = [0, 1].map(|axis| [middle, largest][steps[axis]][axis]);
            Some(self.cell(self.outline.within([corner, end])?))
        })
    }
}

/// The cells of `area`, the part of a pixel within `outline`, and how bright they are, in units of white; `None` where
/// all of it is about as bright, or dark. `brightness` tells it of a place on the film; about `toward` there is much.
pub fn of(
    outline: &Outline,
    area: &Area,
    toward: Option<[f64; 2]>,
    brightness: impl Fn([f64; 2]) -> f64,
) -> Option<Vec<(Area, f64)>> {
    let cutter = Cutter {
        outline,
        toward,
        brightness,
    };
    let mut cells: Vec<Cell> = cutter.quarters(area).collect();
    let light = |cells: &[Cell]| cells.iter().map(Cell::light).sum::<f64>();
    let most = cells
        .iter()
        .fold(0.0, |most: f64, cell| most.max(cell.most));
    let is_even = most * area.size() <= UNEVEN * light(&cells);
    if is_even || (toward.is_some() && most <= DARK) {
        return None;
    }
    for _ in 0..CUTS_MAX {
        let doubt: f64 = cells.iter().map(Cell::doubt).sum();
        if doubt <= EVEN * light(&cells) {
            break;
        }
        let by_doubt = |a: &usize, b: &usize| cells[*a].doubt().total_cmp(&cells[*b].doubt());
        let index = (0..cells.len()).max_by(by_doubt)?;
        let cell = cells.swap_remove(index);
        cells.extend(cutter.quarters(&cell.area));
    }
    let lit = cells.into_iter().filter(|cell| cell.most > 0.0);
    let parts = lit.map(|cell| {
        let bright = cell.bright();
        (cell.area, bright)
    });
    Some(parts.collect())
}

impl Tracer<'_> {
    /// How bright the sample is at a place of the film, were all of the bulb where the lobe turns most of it to the
    /// camera and hidden nowhere: in the brightest channel, in units of white.
    pub(super) fn brightness(&self, [column, row]: [f64; 2]) -> f64 {
        let ray = self.scene.camera.ray(column, row);
        let Some(Encounter::Surface(surface)) = self.scene.encounter(&ray, None) else {
            return 0.0;
        };
        if surface.thing != Thing::Sample {
            return 0.0;
        }
        let bulb = &self.scene.bulb;
        let to_bulb = surface.frame.to_local(bulb.centre - surface.position);
        let wo = surface.frame.to_local(-ray.direction);
        // The place of a somewhat larger bulb that is nearest to the ray that a mirror would turn to the camera, and
        // the one that is nearest in widths of the lobe.
        let mirrored = Vec3::new(-wo.x, -wo.y, wo.z);
        let off = mirrored * mirrored.dot(to_bulb).max(0.0) - to_bulb;
        let nearest = to_bulb + off * (LARGER * bulb.radius / off.length()).min(1.0);
        let cone = Cone::new(Vec3::default(), to_bulb, LARGER * bulb.radius);
        let of_lobe = cone.and_then(|cone| {
            let narrow = cone.one_minus_cos_max();
            glint::brightest(&self.reflectance.lobe, wo, cone.axis(), narrow)
        });
        let value = |wi: Vec3| {
            let channels = self.reflectance.evaluate(wi, wo);
            channels.into_iter().fold(0.0, f64::max) * wi.z.max(0.0)
        };
        let value = value(nearest.normalized()).max(of_lobe.map_or(0.0, value));
        let solid_angle = PI * bulb.radius * bulb.radius / to_bulb.length_squared();
        bulb.radiance * solid_angle * value
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::path::strips::tests::uniform;
    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::SeedableRng;
    use std::f64::consts::TAU;

    /// The sample in a pixel that its edge cuts.
    fn cut_pixel(middle: [f64; 2], normal: [f64; 2]) -> Outline {
        let along = [-normal[1], normal[0]];
        let corners = [[-9.0, 0.0], [9.0, 0.0], [9.0, -18.0], [-9.0, -18.0]];
        let corners = corners.map(|[x, y]| {
            let [column, row] =
                [0, 1].map(|axis| middle[axis] + x * along[axis] + y * normal[axis]);
            [column, row, 1.0]
        });
        Outline::of_corners(corners.to_vec())
    }

    /// A bright spot on a pixel, and about where it is.
    struct Spot {
        middle: [f64; 2],
        width: f64,
        toward: [f64; 2],
    }

    impl Spot {
        /// Anywhere, a third of them on the pixel's border, a fifth to a hundred thousandth of a pixel wide; up to
        /// three widths from where it is said to be.
        fn drawn(draw: usize, mut draws: impl FnMut() -> f64) -> Self {
            let width = libm::exp10(-0.7 - 4.0 * draws());
            let mut middle = [draws(), draws()];
            if draw.is_multiple_of(3) {
                middle[draw % 2] = f64::from(draws() < 0.5);
            }
            let (sin, cos) = libm::sincos(TAU * draws());
            let off = 3.0 * width * draws();
            Self {
                middle,
                width,
                toward: [middle[0] + off * cos, middle[1] + off * sin],
            }
        }

        fn brightness(&self, [x, y]: [f64; 2]) -> f64 {
            let [x, y] = [x - self.middle[0], y - self.middle[1]].map(|off| off / self.width);
            libm::exp(-0.5 * (x * x + y * y))
        }

        /// A place, by its brightness.
        fn place(&self, mut draws: impl FnMut() -> f64) -> [f64; 2] {
            let (sin, cos) = libm::sincos(TAU * draws());
            let off = self.width * (-2.0 * libm::log(draws().max(f64::MIN_POSITIVE))).sqrt();
            [self.middle[0] + off * cos, self.middle[1] + off * sin]
        }
    }

    /// Cells hold all of a bright spot, and paths that are shared among them by their brightness meet it evenly: what
    /// they carry, squared, is all but always at most 2.5 times what it is in the mean. The sample's edge cuts each
    /// spot, and may leave a sliver of it.
    #[test]
    fn cells_hold_a_bright_spot() {
        const PLACES: u32 = 2_000;
        let pixel = [[0.0; 2], [1.0; 2]];
        let mut random = ChaCha8Rng::seed_from_u64(31);
        let mut draws = || uniform(&mut random);
        let (mut looked_at, mut uneven) = (0, 0);
        for draw in 0..2_000 {
            let spot = Spot::drawn(draw, &mut draws);
            let (sin, cos) = libm::sincos(TAU * draws());
            let off = 4.0 * spot.width * (draws() - 0.5);
            let edge = [spot.middle[0] + off * cos, spot.middle[1] + off * sin];
            let outline = cut_pixel(edge, [cos, sin]);
            let Some(area) = outline.within(pixel) else {
                continue;
            };
            let cells = of(&outline, &area, Some(spot.toward), |at| spot.brightness(at));
            let Some(cells) = cells else {
                continue;
            };
            let all: f64 = cells
                .iter()
                .map(|(area, bright)| bright * area.size())
                .sum();
            let (mut seen, mut lost, mut squares) = (0u32, 0, 0.0);
            for _ in 0..PLACES {
                let at = spot.place(&mut draws);
                if !area.holds(at) {
                    continue;
                }
                seen += 1;
                match cells.iter().find(|(cell, _)| cell.holds(at)) {
                    Some((_, bright)) => squares += spot.brightness(at) * all / bright,
                    None => lost += 1,
                }
            }
            if seen < 20 {
                continue;
            }
            looked_at += 1;
            assert!(lost * 500 <= seen, "draw {draw}: {lost} of {seen}");
            let light = TAU * spot.width * spot.width * f64::from(seen) / f64::from(PLACES);
            let squares = squares / f64::from(seen) / light;
            assert!(squares < 10.0, "draw {draw}: {squares}");
            uneven += u32::from(squares > 2.5);
        }
        assert!(looked_at > 1_500, "{looked_at}");
        assert!(uneven * 500 <= looked_at, "{uneven} of {looked_at}");
    }
}
