//! Where in a pixel the bulb's light comes from a curved sample.
//!
//! A small bulb in a ball lies in a millionth of a pixel, and no uniform point of the film finds it. So
//! the pixel is cut into cells: first where most light would be, were the lobe as wide as the slopes of
//! the half vector differ in a cell. What is found only tells where to take more samples: half of them
//! stay uniform, and the estimate is right whatever the cells are.

use renderer::reflectance::Reflectance;
use renderer::scene::{Encounter, Scene};
use std::collections::BinaryHeap;

/// Cells that are cut, at most.
const CUTS_MAX: usize = 1500;

/// Cells along each side of a pixel to begin with.
const SIDE: u32 = 8;

/// A cell is cut no more when the slopes differ in it by less than this many widths of the lobe.
const EVEN: f64 = 0.5;

/// The thinnest cell, in pixels.
const THIN: f64 = 1e-12;

/// Points of a cell, by their offsets in halves of it.
const POINTS: [[f64; 2]; 5] = [
    [0.0, 0.0],
    [-1.0, -1.0],
    [1.0, -1.0],
    [-1.0, 1.0],
    [1.0, 1.0],
];

/// A part of a pixel: its middle, half of its sides, and what it sends, up to a factor.
#[derive(Clone, Copy)]
struct Cell {
    middle: [f64; 2],
    half: [f64; 2],
    light: f64,
    /// By how many times the lobe's widths the slopes differ along either side.
    uneven: [f64; 2],
    /// Where it stands in the tree.
    node: usize,
}

/// A cell of the tree: cut, or with its share of the light over its area.
enum Node {
    Cut {
        axis: usize,
        at: f64,
        parts: [usize; 2],
    },
    Whole(f64),
}

/// Most light first.
impl Ord for Cell {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        self.light.total_cmp(&other.light)
    }
}

impl PartialOrd for Cell {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for Cell {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other).is_eq()
    }
}

impl Eq for Cell {}

/// A density of points of a pixel.
pub struct Guide {
    cells: Vec<Cell>,
    /// The light of the cells up to each, as shares of all.
    up_to: Vec<f64>,
    /// The first ones are those of the grid.
    tree: Vec<Node>,
}

impl Guide {
    /// Of the pixel whose first corner is here on the film.
    pub fn new(scene: &Scene, reflectance: &Reflectance, pixel: [f64; 2]) -> Self {
        let cell = |middle, half| Cell::new(scene, reflectance, pixel, middle, half);
        let half = 0.5 / f64::from(SIDE);
        let first = (0..SIDE * SIDE).map(|index| {
            let middle = [index % SIDE, index / SIDE].map(|k| (2.0 * f64::from(k) + 1.0) * half);
            let node = index as usize;
            Cell {
                node,
                ..cell(middle, [half; 2])
            }
        });
        let mut open: BinaryHeap<Cell> = first.collect();
        let mut tree: Vec<Node> = open.iter().map(|_| Node::Whole(0.0)).collect();
        let mut cells = Vec::new();
        for _ in 0..CUTS_MAX {
            let Some(largest) = open.pop() else {
                break;
            };
            let axis = usize::from(largest.uneven[1] > largest.uneven[0]);
            if largest.light == 0.0 || largest.uneven[axis] < EVEN || largest.half[axis] < THIN {
                cells.push(largest);
                continue;
            }
            let mut half = largest.half;
            half[axis] *= 0.5;
            let parts = [-1.0, 1.0].map(|side| {
                let mut middle = largest.middle;
                middle[axis] += side * half[axis];
                let node = tree.len();
                tree.push(Node::Whole(0.0));
                open.push(Cell {
                    node,
                    ..cell(middle, half)
                });
                node
            });
            let at = largest.middle[axis];
            tree[largest.node] = Node::Cut { axis, at, parts };
        }
        cells.extend(open);
        cells.retain(|cell| cell.light > 0.0);
        let all: f64 = cells.iter().map(|cell| cell.light).sum();
        let mut up_to = Vec::new();
        let mut sum = 0.0;
        for Cell {
            light, half, node, ..
        } in &cells
        {
            sum += light / all;
            up_to.push(sum);
            tree[*node] = Node::Whole(light / all / (4.0 * half[0] * half[1]));
        }
        Self { cells, up_to, tree }
    }

    /// A point of the pixel from one of the unit square, and what a sample there counts.
    pub fn point(&self, [x, y]: [f64; 2]) -> ([f64; 2], f64) {
        if self.cells.is_empty() {
            return ([x, y], 1.0);
        }
        let point = if x < 0.5 {
            [2.0 * x, y]
        } else {
            let wanted = 2.0 * x - 1.0;
            let index = self.up_to.partition_point(|up_to| *up_to <= wanted);
            let index = index.min(self.cells.len() - 1);
            let before = if index == 0 {
                0.0
            } else {
                self.up_to[index - 1]
            };
            let along = ((wanted - before) / (self.up_to[index] - before)).clamp(0.0, 1.0);
            let Cell { middle, half, .. } = self.cells[index];
            [
                middle[0] + half[0] * (2.0 * along - 1.0),
                middle[1] + half[1] * (2.0 * y - 1.0),
            ]
        };
        (point, 1.0 / self.density(point))
    }

    /// Half of it uniform, half by the light of the cells.
    fn density(&self, point: [f64; 2]) -> f64 {
        let [column, row] = point
            .map(|x| (x * f64::from(SIDE)) as usize)
            .map(|k| k.min(SIDE as usize - 1));
        let mut node = row * SIDE as usize + column;
        loop {
            match &self.tree[node] {
                Node::Whole(density) => return 0.5 + 0.5 * density,
                Node::Cut { axis, at, parts } => node = parts[usize::from(point[*axis] > *at)],
            }
        }
    }
}

impl Cell {
    fn new(
        scene: &Scene,
        reflectance: &Reflectance,
        pixel: [f64; 2],
        middle: [f64; 2],
        half: [f64; 2],
    ) -> Self {
        let widths = [reflectance.lobe.n_u, reflectance.lobe.n_v].map(|n| 1.0 / n.sqrt());
        let at = |offset: [f64; 2]| [0, 1].map(|i| middle[i] + half[i] * offset[i]);
        let seen = POINTS.map(|offset| slopes(scene, reflectance, pixel, at(offset)));
        // Along a side: between the corners that differ in it alone.
        let across = |pairs: [[usize; 2]; 2]| {
            let of_pair = pairs.map(|[a, b]| match (&seen[a], &seen[b]) {
                (Some(a), Some(b)) => [0, 1].map(|i| (a.slopes[i] - b.slopes[i]).abs()),
                (None, None) => [0.0; 2],
                _ => [f64::INFINITY; 2],
            });
            [0, 1].map(|i| of_pair[0][i].max(of_pair[1][i]))
        };
        let differ = [across([[1, 2], [3, 4]]), across([[1, 3], [2, 4]])];
        let mut light = 0.0f64;
        let mut bulb = 0.0f64;
        for one in seen.iter().flatten() {
            bulb = bulb.max(one.bulb);
            let mut wide = [0.0; 2];
            let mut far = 0.0;
            for i in 0..2 {
                let differ = differ[0][i] + differ[1][i];
                let differ = if differ.is_finite() { differ } else { 1.0 };
                wide[i] = widths[i] + differ + one.bulb;
                let off = one.slopes[i] / wide[i];
                far += off * off;
            }
            light = light.max(libm::exp(-0.5 * far) / (wide[0] * wide[1]));
        }
        let uneven = differ.map(|differ| {
            let times = [0, 1].map(|i| differ[i] / (widths[i] + bulb));
            times[0].max(times[1])
        });
        Self {
            middle,
            half,
            light: light * 4.0 * half[0] * half[1],
            uneven,
            node: 0,
        }
    }
}

/// What a point of the film sees of the sample.
struct Seen {
    /// Of the half vector toward the bulb's centre, along the lobe's axes.
    slopes: [f64; 2],
    /// Half the angle that the bulb fills: how far it moves the half vector.
    bulb: f64,
}

fn slopes(
    scene: &Scene,
    reflectance: &Reflectance,
    pixel: [f64; 2],
    [x, y]: [f64; 2],
) -> Option<Seen> {
    let ray = scene.camera.ray(pixel[0] + x, pixel[1] + y);
    let Some(Encounter::Surface(surface)) = scene.encounter(&ray, None) else {
        return None;
    };
    if surface.patch.is_some() {
        return None;
    }
    let to_bulb = scene.bulb.centre - surface.position;
    let distance = to_bulb.length();
    let bulb = (scene.bulb.radius / distance).min(1.0);
    let wi = surface.frame.to_local(to_bulb * (1.0 / distance));
    let half = reflectance
        .lobe
        .to_lobe(wi + surface.frame.to_local(-ray.direction));
    // Below the horizon the bulb shows no more than its rim.
    (wi.z > -bulb && half.z > 0.0).then(|| Seen {
        slopes: [half.x / half.z, half.y / half.z],
        bulb: 0.5 * bulb,
    })
}
