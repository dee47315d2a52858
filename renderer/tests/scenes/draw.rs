//! Admitted specifications and materials, drawn at random: a pure function of (seed, index).

use crate::case::Case;
use dataset::{
    Material, Specification,
    specification::{IntegratorKind, Pixel, Shape, Tint, View},
};
use rand_chacha::{
    ChaCha8Rng,
    rand_core::{Rng, SeedableRng},
};

/// The share of draws that change a few fields of the preset; the others draw every field.
const NEAR_SHARE: f64 = 0.4;

/// The fraction that is kept of the views that go to the path tracer.
const PATH_SHARE: f64 = 0.1;

/// Below this tolerance a rendering of many pixels takes minutes, so that films are small there.
const TIGHT: f64 = 3e-5;
const TIGHT_SIDE_MAX: u32 = 12;

/// The largest film, in pixels.
const PIXELS_MAX: u32 = 1 << 16;

/// The relative accuracies of the search at coarse ones. From the first on, tiles have fewer terms and order 1 fewer
/// nodes.
const COARSE_FROM: f64 = 1e-2;
const COARSE_TO: f64 = 1e-1;

/// Films of traced draws are small: a pixel that sees much is one in which paths miss something.
const TRACED_SIDE_MAX: u32 = 12;

/// The share of traced draws whose sample is a sphere or a cylinder, and of these the share that paths alone render,
/// without what the default integrator works out.
const CURVED_SHARE: f64 = 0.3;
const CURVED_PATH_SHARE: f64 = 0.5;

/// The roughest material of the search of streaks.
const STREAK_ROUGHNESS_MAX: f64 = 5.0;

/// Draw number `index` of the search that `seed` names.
pub fn draw(seed: u64, index: u64) -> Case {
    mostly_worked_out(seed, index, |_, _| ())
}

/// Draw number `index` of the search at coarse accuracies that `seed` names.
pub fn draw_coarse(seed: u64, index: u64) -> Case {
    mostly_worked_out(seed, index, |specification, random| {
        let relative = random.log_uniform(COARSE_FROM, COARSE_TO);
        set_accuracy(specification, random, relative);
    })
}

/// A case that the hybrid integrator works out, with few exceptions, from a specification that is changed.
fn mostly_worked_out(
    seed: u64,
    index: u64,
    change: impl Fn(&mut Specification, &mut Random),
) -> Case {
    let mut random = Random::of_draw(seed, index);
    loop {
        let mut specification = near_or_far(&mut random);
        change(&mut specification, &mut random);
        let material = material(&mut random);
        let Ok(case) = Case::admitted(&specification, material) else {
            continue;
        };
        if case.is_worked_out() || random.chance(PATH_SHARE) {
            return case;
        }
    }
}

/// Draw number `index` of the search of the path tracer that `seed` names.
pub fn draw_traced(seed: u64, index: u64) -> Case {
    traced(seed, index, |_, _, _| ())
}

/// Draw number `index` of the search of streaks that `seed` names.
pub fn draw_streaks(seed: u64, index: u64) -> Case {
    traced(seed, index, make_streak)
}

/// Draw number `index` of the search of glints that `seed` names.
pub fn draw_glints(seed: u64, index: u64) -> Case {
    traced(seed, index, |specification, material, random| {
        make_streak(specification, material, random);
        let shape = random.one_of(&[Shape::Square, Shape::Sphere, Shape::Cylinder]);
        specification.sample.shape = shape;
        let anisotropy = random.uniform(0.0, 1.0);
        material.anisotropy = match shape {
            Shape::Square => random.one_of(&[material.anisotropy, 0.0, anisotropy]),
            _ => random.one_of(&[0.0, anisotropy]),
        };
    })
}

/// A small bulb, and a curved sample that is all but smooth along one axis.
fn make_streak(specification: &mut Specification, material: &mut Material, random: &mut Random) {
    specification.sample.shape = random.one_of(&[Shape::Sphere, Shape::Cylinder]);
    let light = &mut specification.light;
    light.radius_m = (light.distance_m * random.log_uniform(1e-6, 1e-2)).max(1e-4);
    let roughness = random.uniform(0.0, STREAK_ROUGHNESS_MAX);
    material.roughness = random.one_of(&[0.0, roughness]);
    material.anisotropy = 1.0 - random.log_uniform(1e-8, 0.3);
}

/// A case that the path tracer renders, from a specification and a material that are changed.
fn traced(
    seed: u64,
    index: u64,
    change: impl Fn(&mut Specification, &mut Material, &mut Random),
) -> Case {
    let mut random = Random::of_draw(seed, index);
    loop {
        let mut specification = near_or_far(&mut random);
        let (image, integrator) = (&mut specification.image, &mut specification.integrator);
        image.width = image.width.min(TRACED_SIDE_MAX);
        image.height = image.height.min(TRACED_SIDE_MAX);
        integrator.samples_per_pixel = random.one_of(&[16, 64, 256, 1024]);
        integrator.kind = IntegratorKind::Path;
        if random.chance(CURVED_SHARE) {
            specification.sample.shape = random.one_of(&[Shape::Sphere, Shape::Cylinder]);
            if !random.chance(CURVED_PATH_SHARE) {
                specification.integrator.kind = IntegratorKind::Hybrid;
            }
        }
        let mut material = material(&mut random);
        change(&mut specification, &mut material, &mut random);
        if let Ok(case) = Case::admitted(&specification, material) {
            return case;
        }
    }
}

fn near_or_far(random: &mut Random) -> Specification {
    if random.chance(NEAR_SHARE) {
        near(random)
    } else {
        far(random)
    }
}

/// Numbers drawn at random.
pub struct Random(ChaCha8Rng);

impl Random {
    fn of_draw(seed: u64, index: u64) -> Self {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        random.set_stream(index);
        Self(random)
    }

    /// The draws of one variation of a case.
    pub fn of_variation(seed: u64) -> Self {
        Self(ChaCha8Rng::seed_from_u64(seed))
    }

    fn unit(&mut self) -> f64 {
        (self.0.next_u64() >> 11) as f64 * (1.0 / (1u64 << 53) as f64)
    }

    fn chance(&mut self, share: f64) -> bool {
        self.unit() < share
    }

    pub fn uniform(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    /// Evenly spread over the logarithm.
    pub fn log_uniform(&mut self, low: f64, high: f64) -> f64 {
        let exponent = self.uniform(libm::log(low), libm::log(high));
        libm::exp(exponent).clamp(low, high)
    }

    fn log_integer(&mut self, low: u32, high: u32) -> u32 {
        (self.log_uniform(f64::from(low), f64::from(high) + 1.0) as u32).clamp(low, high)
    }

    fn below(&mut self, end: usize) -> usize {
        ((self.unit() * end as f64) as usize).min(end - 1)
    }

    pub fn one_of<T: Copy>(&mut self, values: &[T]) -> T {
        values[self.below(values.len())]
    }
}

/// The preset in one of its views, with one to four things changed.
fn near(random: &mut Random) -> Specification {
    let mut specification = Specification::preset();
    let view = random.below(specification.views.len());
    specification.views = vec![specification.views[view].clone()];
    specification.image.pixel = Pixel::Float;
    let side = random.one_of(&[1, 2, 3, 5, 8, 8, 16, 16, 24, 32, 64, 128]);
    (specification.image.width, specification.image.height) = (side, side);
    let factor = |random: &mut Random| random.log_uniform(0.2, 5.0);
    for _ in 0..=random.below(4) {
        match random.below(14) {
            0 => specification.camera.distance_m *= factor(random),
            1 => specification.camera.film_half_width *= factor(random),
            2 => specification.light.distance_m *= factor(random),
            3 => specification.light.radius_m *= factor(random),
            4 => specification.sample.side_m *= factor(random),
            5 => specification.checker.pitch_m *= factor(random),
            6 => specification.checker.lower_edge_y_m *= random.log_uniform(1.0, 5.0),
            7 => specification.checker.tilt_deg = random.uniform(0.0, 90.0),
            8 => draw_patches(&mut specification, random),
            9 => specification.views[0].camera_elevation_deg = elevation(random),
            10 => specification.views[0].light_elevation_deg = elevation(random),
            11 => specification.integrator.max_bounces = random.log_integer(1, 16),
            12 => draw_accuracy(&mut specification, random),
            _ => specification.tint = Tint::Product,
        }
    }
    bound_work(&mut specification);
    specification
}

/// Every field drawn, lengths in proportion to each other as often as not.
fn far(random: &mut Random) -> Specification {
    let mut specification = Specification::preset();
    specification.seed = random.0.next_u64() >> 1;
    specification.image.pixel = Pixel::Float;
    specification.image.width = random.log_integer(1, 512);
    specification.image.height = if random.chance(0.5) {
        specification.image.width
    } else {
        random.log_integer(1, 512)
    };
    if random.chance(0.5) {
        draw_accuracy(&mut specification, random);
    }
    specification.tint = random.one_of(&[Tint::Hue, Tint::Hue, Tint::Product]);
    if random.chance(0.6) {
        specification.integrator.max_bounces = random.log_integer(1, 16);
    }
    draw_lengths(&mut specification, random);
    draw_view(&mut specification, random);
    draw_chart(&mut specification, random);
    bound_work(&mut specification);
    specification
}

/// The lengths of sample, camera and light.
fn draw_lengths(specification: &mut Specification, random: &mut Random) {
    let side = random.log_uniform(0.001, 10.0);
    specification.sample.side_m = side;
    specification.camera.distance_m = if random.chance(0.7) {
        (side * random.log_uniform(0.5, 30.0)).clamp(0.01, 100.0)
    } else {
        random.log_uniform(0.01, 100.0)
    };
    specification.camera.film_half_width = if random.chance(0.8) {
        let fits = side / specification.camera.distance_m;
        (fits * random.log_uniform(0.1, 3.0)).clamp(0.001, 10.0)
    } else {
        random.log_uniform(0.001, 10.0)
    };
    specification.light.distance_m = if random.chance(0.7) {
        (side * random.log_uniform(0.5, 50.0)).clamp(0.01, 100.0)
    } else {
        random.log_uniform(0.01, 100.0)
    };
    let radius = specification.light.distance_m * random.log_uniform(1e-3, 0.9);
    specification.light.radius_m = radius.clamp(1e-4, 100.0);
}

/// The angles of the one view.
fn draw_view(specification: &mut Specification, random: &mut Random) {
    let camera_elevation_deg = elevation(random);
    let light_elevation_deg = if random.chance(0.3) {
        camera_elevation_deg
    } else {
        elevation(random)
    };
    specification.views = vec![View {
        camera_elevation_deg,
        light_elevation_deg,
        rotation_deg: random.uniform(-360.0, 360.0),
        checker: random.chance(0.6),
    }];
}

/// The colour chart beside the sample.
fn draw_chart(specification: &mut Specification, random: &mut Random) {
    let side = specification.sample.side_m;
    let checker = &mut specification.checker;
    let gap = if random.chance(0.3) {
        0.0
    } else {
        random.log_uniform(1e-3, 3.0)
    };
    checker.lower_edge_y_m = 0.5 * side * (1.0 + gap);
    checker.tilt_deg = if random.chance(0.2) {
        random.one_of(&[0.0, 45.0, 80.0, 90.0])
    } else {
        random.uniform(0.0, 90.0)
    };
    if random.chance(0.7) {
        draw_patches(specification, random);
    }
    let checker = &mut specification.checker;
    let rows = f64::from(checker.rows.max(checker.columns));
    checker.pitch_m = (side * random.log_uniform(0.1, 10.0) / rows).clamp(1e-4, 10.0);
}

/// The work of a rendering grows with its pixels, and beyond bounds with the tolerance's inverse.
fn bound_work(specification: &mut Specification) {
    let image = &mut specification.image;
    let accuracy = &specification.accuracy;
    if accuracy.absolute.max(accuracy.relative) < TIGHT {
        image.width = image.width.min(TIGHT_SIDE_MAX);
        image.height = image.height.min(TIGHT_SIDE_MAX);
    }
    if image.width * image.height > PIXELS_MAX {
        image.height = (PIXELS_MAX / image.width).max(1);
    }
    if image.width * image.height > 1 << 12 {
        specification.integrator.samples_per_pixel = 16;
    }
}

fn elevation(random: &mut Random) -> f64 {
    match random.below(10) {
        0..4 => random.one_of(&[5.0, 15.0, 30.0, 45.0, 60.0, 75.0, 90.0]),
        4 => random.log_uniform(0.1, 10.0),
        _ => random.uniform(0.1, 90.0),
    }
}

fn draw_accuracy(specification: &mut Specification, random: &mut Random) {
    let coarse = random.chance(0.8);
    let relative = if coarse {
        random.log_uniform(1e-4, COARSE_TO)
    } else {
        random.log_uniform(1e-7, 1e-4)
    };
    set_accuracy(specification, random, relative);
}

/// A relative accuracy, or none, and an absolute one in proportion to it.
fn set_accuracy(specification: &mut Specification, random: &mut Random, relative: f64) {
    let ratio = random.one_of(&[0.01, 0.1, 0.1, 1.0, 10.0]);
    let accuracy = &mut specification.accuracy;
    accuracy.absolute = (relative * ratio).clamp(1e-7, 1.0);
    accuracy.relative = if random.chance(0.1) { 0.0 } else { relative };
}

fn draw_patches(specification: &mut Specification, random: &mut Random) {
    let checker = &mut specification.checker;
    checker.columns = random.log_integer(1, 64);
    checker.rows = random.log_integer(1, 64);
    let kind = random.below(4);
    checker.patches_srgb8 = (0..checker.rows * checker.columns)
        .map(|index| {
            let (row, column) = (index / checker.columns, index % checker.columns);
            let grey = |white: bool| [if white { 255 } else { 0 }; 3];
            match kind {
                0 => [(); 3].map(|()| random.below(256) as u8),
                1 => grey(random.chance(0.5)),
                2 => grey((row + column).is_multiple_of(2)),
                _ => grey(true),
            }
        })
        .collect();
}

/// A material, often at a corner of the parameter space.
pub fn material(random: &mut Random) -> Material {
    let tiny = |random: &mut Random| random.log_uniform(1e-9, 1e-2);
    let roughness = match random.below(10) {
        0 => 0.0,
        1 => tiny(random),
        2 => 100.0 - random.one_of(&[0.0, 1.0]) * tiny(random),
        3 => 90.0 + random.one_of(&[-1.0, 0.0, 1.0]) * tiny(random),
        4 => random.log_uniform(1e-2, 10.0),
        5 | 6 => random.uniform(0.0, 40.0),
        _ => random.uniform(0.0, 100.0),
    };
    let anisotropy = match random.below(10) {
        0..4 => 0.0,
        4 => 1.0,
        5 => 1.0 - tiny(random),
        6 => tiny(random),
        _ => random.uniform(0.0, 1.0),
    };
    let ior = match random.below(6) {
        0 => 1.0,
        1 | 2 => 10.0,
        3 => 1.0 + tiny(random),
        _ => random.uniform(1.0, 10.0),
    };
    let colour = |random: &mut Random| match random.below(6) {
        0 => [0.0; 3],
        1 | 2 => [1.0; 3],
        3 => {
            let mut primary = [0.0; 3];
            primary[random.below(3)] = 1.0;
            primary
        }
        _ => [(); 3].map(|()| random.unit()),
    };
    Material {
        roughness,
        anisotropy,
        angle_deg: if random.chance(0.2) {
            random.one_of(&[0.0, 90.0, 180.0])
        } else {
            random.uniform(0.0, 180.0)
        },
        ior,
        rgb0: colour(random),
        rgb90: colour(random),
    }
}
