//! The bulb's light off the sample on films so coarse that its mirror image, or a streak of it, is
//! smaller than a pixel: the stated errors hold against the same scene on a far finer film.

use dataset::{
    Material, Specification,
    specification::{Pixel, View},
};
use renderer::{
    film::{Film, target},
    geometry::BackendChoice,
    hybrid::PreparedView,
    reflectance::Reflectance,
    scene::Scene,
};

/// What a case changes of the preset, and by how much finer its reference is.
struct Case {
    name: &'static str,
    size: [u32; 2],
    finer: u32,
    elevations_deg: [f64; 2],
    camera: [f64; 2],
    light: [f64; 2],
    side_m: f64,
    roughness: f64,
    anisotropy: f64,
}

const PRESET: Case = Case {
    name: "",
    size: [4, 4],
    finer: 24,
    elevations_deg: [45.0, 45.0],
    camera: [0.5, 0.12],
    light: [1.0, 0.03],
    side_m: 0.1,
    roughness: 0.0,
    anisotropy: 0.0,
};

const CASES: [Case; 12] = [
    Case {
        name: "a mirror",
        ..PRESET
    },
    Case {
        name: "a mirror in one pixel",
        size: [1, 1],
        finer: 64,
        ..PRESET
    },
    Case {
        name: "a streak",
        size: [2, 2],
        finer: 32,
        anisotropy: 1.0,
        ..PRESET
    },
    Case {
        name: "a short streak",
        roughness: 1.0,
        anisotropy: 0.4,
        ..PRESET
    },
    Case {
        name: "a small bulb",
        light: [1.0, 1e-3],
        roughness: 1.0,
        ..PRESET
    },
    Case {
        name: "the smallest bulb",
        size: [3, 3],
        finer: 16,
        light: [1.0, 1e-4],
        roughness: 3.0,
        ..PRESET
    },
    Case {
        name: "grazing",
        size: [3, 5],
        elevations_deg: [15.0, 15.0],
        roughness: 0.5,
        ..PRESET
    },
    Case {
        name: "overhead",
        size: [5, 5],
        elevations_deg: [90.0, 85.0],
        roughness: 2.0,
        ..PRESET
    },
    Case {
        name: "from far away",
        camera: [100.0, 0.001],
        roughness: 2.0,
        ..PRESET
    },
    Case {
        name: "a large sample",
        size: [5, 5],
        camera: [0.5, 0.6],
        side_m: 0.6,
        roughness: 6.0,
        ..PRESET
    },
    Case {
        name: "a rough large sample",
        camera: [0.5, 0.6],
        light: [0.6, 0.02],
        side_m: 0.6,
        roughness: 60.0,
        ..PRESET
    },
    Case {
        name: "a rough streak",
        size: [2, 2],
        finer: 48,
        camera: [3.0, 0.02],
        roughness: 12.0,
        anisotropy: 0.95,
        ..PRESET
    },
];

impl Case {
    fn render(&self, finer: u32) -> (Specification, Film) {
        let mut specification = Specification::preset();
        specification.image.width = self.size[0] * finer;
        specification.image.height = self.size[1] * finer;
        specification.image.pixel = Pixel::Float;
        [
            specification.camera.distance_m,
            specification.camera.film_half_width,
        ] = self.camera;
        [specification.light.distance_m, specification.light.radius_m] = self.light;
        specification.sample.side_m = self.side_m;
        let [camera_elevation_deg, light_elevation_deg] = self.elevations_deg;
        specification.views = vec![View {
            camera_elevation_deg,
            light_elevation_deg,
            rotation_deg: 0.0,
            checker: false,
        }];
        let material = Material {
            roughness: self.roughness,
            anisotropy: self.anisotropy,
            angle_deg: 30.0,
            ior: 10.0,
            rgb0: [1.0; 3],
            rgb90: [1.0; 3],
        };
        let scene = Scene::new(&specification, 0, BackendChoice::Native)
            .expect("a view")
            .expect("native geometry");
        let prepared =
            PreparedView::new(&scene, &specification).expect("a view that can be worked out");
        let reflectance = Reflectance::new(&material, 0.0, specification.tint);
        let (film, ..) = prepared.render(&reflectance, None).expect("resolved");
        (specification, film)
    }
}

/// Every pixel lies within what it and the finer film state, and states no more than the target.
#[test]
fn no_feature_below_a_pixel_is_missed() {
    for case in &CASES {
        let (specification, film) = case.render(1);
        let (_, fine) = case.render(case.finer);
        let (mut brightest, mut short) = (0.0f64, 0);
        for (index, pixel) in (0..).zip(&film.pixels) {
            let (column, row) = (index % film.width, index / film.width);
            let (mut mean, mut error) = ([0.0; 3], 0.0);
            let share = 1.0 / f64::from(case.finer * case.finer);
            for y in row * case.finer..(row + 1) * case.finer {
                for x in column * case.finer..(column + 1) * case.finer {
                    let part = &fine.pixels[(y * fine.width + x) as usize];
                    error += share * part.error;
                    for (mean, value) in mean.iter_mut().zip(part.value) {
                        *mean += share * value;
                    }
                }
            }
            let stated = pixel.error + error;
            for (value, expected) in pixel.value.into_iter().zip(mean) {
                brightest = brightest.max(expected);
                assert!(
                    (value - expected).abs() <= stated + 1e-12,
                    "{}, pixel ({column}, {row}): {value} against {expected}, stated {} and {error}",
                    case.name,
                    pixel.error,
                );
            }
            short += u32::from(pixel.error > target(&specification.accuracy, pixel.value));
        }
        assert!(brightest > 0.0, "{}", case.name);
        assert_eq!(short, 0, "{}: pixels that miss the target", case.name);
    }
}
