//! How bright the bulb's light may be off points of which only angles are known.

use super::spread::Spread;
use crate::reflectance::Reflectance;
use crate::vector::Vec3;
use std::f64::consts::{FRAC_PI_2, PI};

/// By how much a bound is raised for its rounding. Exponents go to 1e9, so an angle's rounding counts.
const ROUNDING: f64 = 1.0 + 1e-6;

/// What is known of points of the sample.
#[derive(Clone, Copy, Debug)]
pub struct Known {
    /// Directions to the camera.
    pub to_eye: Spread,
    /// Directions to the bulb's centre.
    pub to_centre: Spread,
    /// Directions to points of the bulb.
    pub to_bulb: Spread,
    /// The largest sine of the angle that the bulb's radius fills.
    pub bulb_sine: f64,
    /// Normals.
    pub normal: Spread,
    /// What the x axis of the frame is made of, by making it perpendicular to the normal; `None` where
    /// nothing is known of it.
    pub along: Option<Spread>,
}

impl Known {
    /// The same, were all normals and all x axes the middle ones.
    pub fn flat(&self) -> Self {
        let flat = |spread: Spread| Spread {
            angle: 0.0,
            ..spread
        };
        Self {
            normal: flat(self.normal),
            along: self.along.map(flat),
            ..*self
        }
    }
}

/// At most the radiance of the bulb's light off the points, in any channel. `radiance` is the bulb's.
pub fn brightest(reflectance: &Reflectance, radiance: f64, known: &Known) -> f64 {
    let Known {
        to_eye,
        to_centre,
        to_bulb,
        bulb_sine,
        normal,
        ..
    } = *known;
    let [light_min, light_max] = normal.angles(to_bulb);
    let [eye_min, eye_max] = normal.angles(to_eye);
    if light_min >= FRAC_PI_2 || eye_min >= FRAC_PI_2 {
        return 0.0;
    }
    if bulb_sine >= 1.0 {
        return radiance;
    }
    let cosine = |angle: f64| libm::cos(angle.min(FRAC_PI_2)).max(0.0);
    let cos_i = [cosine(light_max), cosine(light_min)];
    let cos_o = [cosine(eye_max), cosine(eye_min)];
    // The solid angle of a ball is pi sine^2 times this.
    let bulge = 2.0 / (1.0 + (1.0 - bulb_sine * bulb_sine).sqrt());
    let white = radiance * bulb_sine * bulb_sine;
    let share = reflectance.specular_share;
    // Of a ball that is all above the horizon, the cosine is its centre's.
    let foreshortened = if light_max < FRAC_PI_2 {
        cosine(normal.angles(to_centre)[0])
    } else {
        bulge * cos_i[1]
    };
    let rgb0 = reflectance.rgb0.into_iter().fold(0.0, f64::max);
    let diffuse = (1.0 - share) * rgb0 * white * foreshortened;
    if share == 0.0 {
        return diffuse.min(radiance) * ROUNDING;
    }
    let power = power(reflectance, known);
    let half_cosine = libm::cos(0.5 * to_eye.angles(to_bulb)[1]);
    // Equation 1, times cos_i.
    let lobe = 0.125 * reflectance.lobe.normalization * power * bulge * white / half_cosine;
    let seen = if cos_o[0] > cos_i[1] {
        cos_i[1] / cos_o[0]
    } else {
        1.0
    };
    // The lobe's mean of the bulb is no brighter than it is.
    let specular = reflectance.tint_max(cos_i, cos_o) * radiance.min(lobe * seen);
    (share * specular + diffuse).min(radiance) * ROUNDING
}

/// At most the power of the lobe at half vectors of the points.
fn power(reflectance: &Reflectance, known: &Known) -> f64 {
    let Some(half) = known.to_eye.half(known.to_bulb) else {
        return 1.0;
    };
    let [least, _] = known.normal.angles(half);
    if least >= FRAC_PI_2 {
        return 0.0;
    }
    let lobe = &reflectance.lobe;
    let exponent = azimuth(reflectance, known, half).map_or(lobe.n_u.min(lobe.n_v), |azimuth| {
        let [least, most] = azimuth;
        let at = if lobe.n_u > lobe.n_v { most } else { least };
        let (sin, cos) = libm::sincos(at);
        lobe.n_u * cos * cos + lobe.n_v * sin * sin
    });
    libm::exp(exponent * libm::log(libm::cos(least)))
}

/// The least sine of the angle between a normal and what the x axis is made of. Nearer to each other their
/// rounding decides, and a frame may have another axis.
const ACROSS_MIN: f64 = 1e-6;

/// The least and the largest angle between the lobe's u axis and half vectors, seen along the normal and
/// folded into the first quadrant; `None` where nothing is known.
fn azimuth(reflectance: &Reflectance, known: &Known, half: Spread) -> Option<[f64; 2]> {
    let along = known.along?;
    let normal = known.normal;
    let turns = half.turn_about(normal) + along.turn_about(normal);
    if turns >= PI {
        return None;
    }
    let z = normal.axis;
    let across = along.axis - z * z.dot(along.axis);
    if across.length() < ACROSS_MIN {
        return None;
    }
    let x = across.normalized();
    let y = z.cross(x);
    let local = Vec3::new(x.dot(half.axis), y.dot(half.axis), 0.0);
    let local = reflectance.lobe.to_lobe(local);
    let middle = libm::atan2(local.y.abs(), local.x.abs());
    Some([(middle - turns).max(0.0), (middle + turns).min(FRAC_PI_2)])
}

#[cfg(test)]
mod tests {
    use super::*;
    use dataset::{Specification, specification::Tint};

    /// Where tangents are along the normal, a frame has another x axis: the lobe may point anywhere.
    #[test]
    fn a_tangent_along_the_normal_says_nothing_of_the_lobe() {
        let exactly = |x: f64, y: f64, z: f64| Spread {
            axis: Vec3::new(x, y, z).normalized(),
            angle: 0.0,
        };
        let mut material = Specification::preset().material(0).material;
        (material.roughness, material.anisotropy) = (20.0, 0.9);
        let reflectance = Reflectance::new(&material, 0.0, Tint::Hue);
        let light = |along: Option<Spread>| {
            let known = Known {
                to_eye: exactly(0.4, 0.1, 1.0),
                to_centre: exactly(0.0, 0.2, 1.0),
                to_bulb: exactly(0.0, 0.2, 1.0),
                bulb_sine: 0.05,
                normal: exactly(0.0, 0.0, 1.0),
                along,
            };
            brightest(&reflectance, 100.0, &known)
        };
        let unknown = light(None);
        for off in [0.0, 1e-12, 1e-9] {
            assert_eq!(light(Some(exactly(off, 0.0, 1.0))), unknown, "{off}");
        }
        assert!(light(Some(exactly(1.0, 0.0, 0.0))) < 0.9 * unknown);
    }
}
