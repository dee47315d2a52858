//! The bulb's light off a curved sample and the chart, where all of the bulb is seen: no path has to find
//! it.

use super::Scratch;
use crate::hybrid::direct::BulbLight;
use crate::numerics::{instructions::Instructions, tolerance::Tolerance};
use crate::reflectance::Reflectance;
use crate::scene::{Scene, Surface};
use crate::vector::Vec3;
use dataset::specification::Accuracy;

/// The share of the relative tolerance that the rule over the bulb aims at. A rule's error is a share of
/// the lobe's largest value on the bulb, of which the mean may be a tenth.
const RULE_SHARE: f64 = 0.01;

/// The light of a rule is taken to be off by so many times its difference from the next finer rule's.
const DIFFERENCES: f64 = 2.0;

/// The bulb's light in a view.
#[derive(Debug)]
pub struct WorkedOut<'a> {
    scene: &'a Scene,
    light: BulbLight<'a>,
}

impl<'a> WorkedOut<'a> {
    /// For a view of a curved sample.
    pub fn new(
        scene: &'a Scene,
        reflectance: &'a Reflectance,
        accuracy: &Accuracy,
        instructions: Instructions,
    ) -> Self {
        let light = BulbLight {
            reflectance,
            radius: scene.bulb.radius,
            radiance: scene.bulb.radiance,
            tolerance: Tolerance::new(RULE_SHARE * accuracy.relative),
            instructions,
        };
        Self { scene, light }
    }

    /// The bulb's light off a surface toward `wo`, in the frame of the surface. `None` on the sample
    /// where the horizon cuts the bulb and where the chart may stand before it, and after the first of
    /// a path's surfaces, where it is not worth the time. The first path of each replicate notes how far
    /// the rule is off.
    pub fn toward(
        &self,
        surface: &Surface,
        wo: Vec3,
        [bounce, path]: [u32; 2],
        scratch: &mut Scratch,
    ) -> Option<[f64; 3]> {
        let to_bulb = surface
            .frame
            .to_local(self.scene.bulb.centre - surface.position);
        if to_bulb.z < self.light.radius {
            return None;
        }
        if let Some(colour) = surface.patch {
            // A curved sample is below the chart's lower edge and so before no part of the bulb.
            let distance2 = to_bulb.length_squared();
            let sine2 = self.light.radius * self.light.radius / distance2;
            let light = self.light.radiance * sine2 * to_bulb.z / distance2.sqrt();
            return Some(colour.map(|channel| light * channel));
        }
        if bounce > 0 || self.is_behind_chart(surface.position) {
            return None;
        }
        let light = off_sample(&self.light, wo, to_bulb, scratch);
        if path == 0 {
            let finer = BulbLight {
                tolerance: self.light.tolerance.finer(),
                ..self.light
            };
            let finer = off_sample(&finer, wo, to_bulb, scratch);
            for (channel, finer) in light.into_iter().zip(finer) {
                let off = DIFFERENCES * scratch.weight * (channel - finer).abs();
                scratch.rule_error = scratch.rule_error.max(off);
            }
        }
        Some(light)
    }

    /// The bulb is in front of the chart's plane: what is too, sees it past the chart.
    fn is_behind_chart(&self, position: Vec3) -> bool {
        let Some(chart) = &self.scene.chart else {
            return false;
        };
        let plane = chart.plane();
        plane.z.dot(position - plane.corner) < 0.0
    }
}

/// The bulb's light off a point of the sample; counts evaluations.
fn off_sample(light: &BulbLight<'_>, wo: Vec3, to_bulb: Vec3, scratch: &mut Scratch) -> [f64; 3] {
    let (found, spent) = light.toward(wo, to_bulb, &mut scratch.batch);
    scratch.evaluations += u64::from(spent);
    let scale = libm::exp(found.log);
    found.tint.map(|channel| scale * channel)
}

#[cfg(test)]
mod tests {
    use super::*;
    use dataset::{Material, specification::Tint};
    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::{Rng, SeedableRng};

    /// Evenly between 0 and 1.
    fn uniform(random: &mut ChaCha8Rng) -> f64 {
        f64::from(random.next_u32()) / f64::from(u32::MAX)
    }

    const TRIALS: usize = 4000;

    /// What a rule is off by, against one of 11 digits, is what is stated for it: for narrow and wide lobes
    /// and bulbs small and large, high and on the horizon. It is part of a 95 percent interval.
    #[test]
    fn the_rule_over_the_bulb_keeps_what_is_stated_for_it() {
        let mut random = ChaCha8Rng::seed_from_u64(19);
        let mut scratch = Scratch::default();
        let mut held = 0;
        for _ in 0..TRIALS {
            let mut draw = || uniform(&mut random);
            let material = Material {
                roughness: 100.0 * draw() * draw(),
                anisotropy: draw(),
                angle_deg: 180.0 * draw(),
                ior: 1.2 + 5.0 * draw(),
                rgb0: [0.8, 0.4, 0.1],
                rgb90: [0.9, 0.9, 0.6],
            };
            let reflectance = Reflectance::new(&material, 0.0, Tint::Hue);
            let radius = 0.6 * draw() * draw() + 1e-3;
            let to_bulb = Vec3::new(2.0 * draw() - 1.0, 2.0 * draw() - 1.0, radius + draw());
            // About the mirror direction, where there is light.
            let [x, y] = [draw(), draw()].map(|x| 0.4 * (x - 0.5) * x);
            let wo = Vec3::new(-to_bulb.x + x, -to_bulb.y + y, to_bulb.z).normalized();
            let relative = libm::exp10(-1.0 - 5.0 * draw());
            let light = |error: f64| BulbLight {
                reflectance: &reflectance,
                radius,
                radiance: 1.0,
                tolerance: Tolerance::new(error),
                instructions: Instructions::widest(),
            };
            let mut value = |light: BulbLight<'_>| off_sample(&light, wo, to_bulb, &mut scratch);
            let rule = light(RULE_SHARE * relative);
            let tolerance = rule.tolerance.finer();
            let [found, finer, exact] =
                [rule, BulbLight { tolerance, ..rule }, light(1e-11)].map(&mut value);
            held += usize::from((0..3).all(|channel| {
                let stated = DIFFERENCES * (found[channel] - finer[channel]).abs();
                (found[channel] - exact[channel]).abs() <= stated + 1e-13
            }));
        }
        assert!(held * 100 >= TRIALS * 97, "{held} of {TRIALS} hold");
    }
}
