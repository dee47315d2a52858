//! The integrals of light over the directions of a cubature, for a lobe that is not glossy.

use crate::numerics::batch::{FOUR, LANES, total};
use crate::numerics::instructions::{Instructions, kernel};
use crate::reflectance::{lobe::Lobe, specular};
use crate::vector::Vec3;

/// Directions that are gathered before the light from them is added up: a narrow lobe beside many patches has
/// tens of thousands, which took megabytes. Chosen so that a batch stays in the nearest cache.
const FULL: usize = 512;

/// Room for one block more.
const ROOM: usize = FULL + LANES;

/// Directions of a cubature and the light from them: a unit vector to the light, and radiance times the rule's weight
/// in each channel. Number by number, in room that does not move: it is written to for every four points.
pub struct LightBatch {
    numbers: Box<[[f64; ROOM]; 6]>,
    count: usize,
}

impl Default for LightBatch {
    fn default() -> Self {
        Self {
            numbers: Box::new([[0.0; ROOM]; 6]),
            count: 0,
        }
    }
}

impl LightBatch {
    /// Adds the first `count` of four points, and the others where the next ones will be.
    #[inline(always)]
    fn push_of_four(&mut self, points: [[f64; FOUR]; 6], count: usize) {
        let room = self.count..self.count + FOUR;
        for (numbers, values) in self.numbers.iter_mut().zip(points) {
            numbers[room.clone()].copy_from_slice(&values);
        }
        self.count += count;
    }

    /// A block of points.
    #[inline(always)]
    fn block(&self, block: usize) -> [&[f64; LANES]; 6] {
        let mut numbers = [&[0.0; LANES]; 6];
        for (numbers, column) in numbers.iter_mut().zip(&*self.numbers) {
            *numbers = &column.as_chunks().0[block];
        }
        numbers
    }

    /// Takes the first blocks out.
    fn drop_blocks(&mut self, blocks: usize) {
        let points = blocks * LANES;
        for numbers in &mut *self.numbers {
            numbers.copy_within(points..self.count, 0);
        }
        self.count -= points;
    }

    /// Fills the last block up with what weighs nothing.
    fn fill_up(&mut self) {
        let end = self.count.next_multiple_of(LANES);
        for numbers in &mut *self.numbers {
            numbers[self.count..end].fill(0.0);
        }
    }
}

/// What the light is multiplied by.
pub struct Integrand<'a> {
    pub wo: Vec3,
    pub lobe: &'a Lobe,
    pub ior: f64,
    pub knee: f64,
    pub instructions: Instructions,
}

/// In each channel three integrals, lane by lane.
type Sums = [[[f64; LANES]; 3]; 3];

/// In each channel the integrals of the light times the lobe's power, cos_i / (|h| max(cos_i, cos_o)) and Fresnel's
/// reflectance; of the same with what that exceeds the tint's knee by; and of the light times cos_i.
pub struct Integrals<'a> {
    integrand: Integrand<'a>,
    batch: &'a mut LightBatch,
    sums: Sums,
    /// Directions added up.
    added: usize,
}

impl<'a> Integrals<'a> {
    /// Over no directions yet. `batch` is emptied.
    pub fn new(integrand: Integrand<'a>, batch: &'a mut LightBatch) -> Self {
        batch.count = 0;
        Self {
            integrand,
            batch,
            sums: Sums::default(),
            added: 0,
        }
    }

    /// Takes the first `count` of four directions in. The others must be finite and weigh nothing.
    #[inline(always)]
    pub fn push_of_four(&mut self, points: [[f64; FOUR]; 6], count: usize) {
        self.batch.push_of_four(points, count);
        if self.batch.count >= FULL {
            self.add_whole_blocks();
        }
    }

    /// The integrals, and over how many directions.
    pub fn finish(mut self) -> ([[f64; 3]; 3], u32) {
        let count = self.batch.count;
        self.batch.fill_up();
        self.add(count.div_ceil(LANES));
        let count = self.added + count;
        (self.sums.map(|channels| channels.map(total)), count as u32)
    }

    /// Adds up what fills blocks. Which directions share a lane does not depend on when that happens.
    #[inline(never)]
    fn add_whole_blocks(&mut self) {
        let blocks = self.batch.count / LANES;
        self.add(blocks);
        self.batch.drop_blocks(blocks);
        self.added += blocks * LANES;
    }

    fn add(&mut self, blocks: usize) {
        let Integrand { instructions, .. } = self.integrand;
        add(
            instructions,
            self.batch,
            blocks,
            &self.integrand,
            &mut self.sums,
        );
    }
}

kernel! {
    /// Adds up the first blocks of a batch.
    pub fn add(batch: &LightBatch, blocks: usize, integrand: &Integrand<'_>, sums: &mut Sums) {
        let &Integrand { wo, lobe, ior, knee, .. } = integrand;
        let exponents = [lobe.n_u, lobe.n_v];
        // The lobe's axes in the world's frame.
        let u = lobe.to_surface(Vec3::new(1.0, 0.0, 0.0));
        let mut added = *sums;
        for block in 0..blocks {
            let [x, y, z, r, g, b] = batch.block(block);
            let mut terms = [[0.0; LANES]; 3];
            for i in 0..LANES {
                let (hx, hy, hz) = (x[i] + wo.x, y[i] + wo.y, z[i] + wo.z);
                let hu = u.x * hx + u.y * hy;
                let hv = u.x * hy - u.y * hx;
                let half2 = [hu * hu, hv * hv, hz * hz];
                let cos_i = z[i];
                let larger = if cos_i > wo.z { cos_i } else { wo.z };
                let value = specular::at_half_vector(1.0, exponents, half2, cos_i, larger);
                let [fresnel, beyond] = specular::fresnel_moments(cos_i, ior, knee);
                terms[0][i] = value * fresnel;
                terms[1][i] = value * beyond;
                terms[2][i] = cos_i;
            }
            for (sums, term) in added.iter_mut().zip(&terms) {
                for (sum, light) in sums.iter_mut().zip([r, g, b]) {
                    for i in 0..LANES {
                        sum[i] += term[i] * light[i];
                    }
                }
            }
        }
        *sums = added;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::reflectance::Reflectance;
    use dataset::Specification;

    /// A narrow lobe beside many patches has tens of thousands of directions at a point. They are added up in parts, and
    /// each counts once.
    #[test]
    fn many_directions_take_no_more_room_than_a_batch() {
        let specification = Specification::preset();
        let material = specification.material(7).material;
        let reflectance = Reflectance::new(&material, 0.0, specification.tint);
        let integrand = Integrand {
            wo: Vec3::new(0.0, -0.6, 0.8),
            lobe: &reflectance.lobe,
            ior: reflectance.ior,
            knee: 2.0,
            instructions: Instructions::widest(),
        };
        let mut batch = LightBatch::default();
        let mut integrals = Integrals::new(integrand, &mut batch);
        let (mut directions, mut diffuse) = (0, [0.0; 3]);
        for step in 0..50_000u32 {
            let [azimuth, height] = [0.618_034, 0.754_878].map(|by| (f64::from(step) * by).fract());
            let (sin, cos) = libm::sincos(std::f64::consts::TAU * azimuth);
            let across = (1.0 - height * height).sqrt();
            let light = [1.0, 0.25, height];
            let [r, g, b] = light;
            let count = 1 + step as usize % FOUR;
            // Those beyond the count weigh nothing.
            let weights: [f64; FOUR] = std::array::from_fn(|index| f64::from(index < count));
            let direction = [across * cos, across * sin, height].map(|number| [number; FOUR]);
            let [x, y, z] = direction;
            let [r, g, b] = [r, g, b].map(|light| weights.map(|weight| weight * light));
            integrals.push_of_four([x, y, z, r, g, b], count);
            assert!(integrals.batch.count < FULL);
            directions += count;
            for (sum, light) in diffuse.iter_mut().zip(light) {
                *sum += count as f64 * height * light;
            }
        }
        let ([_, _, found], evaluations) = integrals.finish();
        assert_eq!(evaluations as usize, directions);
        for (found, expected) in found.into_iter().zip(diffuse) {
            assert!((found / expected - 1.0).abs() < 1e-12, "{found} {expected}");
        }
    }
}
