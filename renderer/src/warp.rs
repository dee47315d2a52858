//! Maps from the unit square to directions, each beside its density.

use crate::vector::Vec3;
use std::f64::consts::{FRAC_1_PI, PI};

/// A unit direction about +z with density cos / pi, from a point of the open unit square.
pub fn cosine_hemisphere(point: [f64; 2]) -> Vec3 {
    let radius = point[1].sqrt();
    let (sin, cos) = libm::sincos(2.0 * PI * point[0]);
    Vec3::new(radius * cos, radius * sin, (1.0 - point[1]).sqrt())
}

/// The density of [`cosine_hemisphere`], a steradian.
pub fn cosine_hemisphere_density(cosine: f64) -> f64 {
    cosine.max(0.0) * FRAC_1_PI
}

/// The cone of directions from a point to a sphere outside it, uniformly sampled.
#[derive(Clone, Copy, Debug)]
pub struct Cone {
    axis: Vec3,
    distance: f64,
    radius: f64,
    /// One minus the cosine of the half angle, kept as such: the cosine of a narrow cone has lost
    /// it.
    one_minus_cos_max: f64,
}

impl Cone {
    /// The cone from `apex` to the sphere about `centre`; `None` from inside the sphere.
    pub fn new(apex: Vec3, centre: Vec3, radius: f64) -> Option<Self> {
        let offset = centre - apex;
        let distance = offset.length();
        if distance <= radius {
            return None;
        }
        let sin2 = (radius / distance) * (radius / distance);
        Some(Self {
            axis: offset * (1.0 / distance),
            distance,
            radius,
            one_minus_cos_max: sin2 / (1.0 + (1.0 - sin2).sqrt()),
        })
    }

    /// The density of [`Cone::sample`] inside the cone, a steradian.
    pub fn density(&self) -> f64 {
        FRAC_1_PI / (2.0 * self.one_minus_cos_max)
    }

    /// The unit vector to the sphere's centre.
    pub fn axis(&self) -> Vec3 {
        self.axis
    }

    /// One minus the cosine of the half angle.
    pub fn one_minus_cos_max(&self) -> f64 {
        self.one_minus_cos_max
    }

    /// A unit direction of the cone, from a point of the open unit square.
    pub fn sample(&self, point: [f64; 2]) -> Vec3 {
        let one_minus_cos = self.one_minus_cos_max * point[1];
        let cos = 1.0 - one_minus_cos;
        let sin = (one_minus_cos * (2.0 - one_minus_cos)).sqrt();
        let (sin_turn, cos_turn) = libm::sincos(2.0 * PI * point[0]);
        let (x, y) = perpendiculars(self.axis);
        x * (sin * cos_turn) + y * (sin * sin_turn) + self.axis * cos
    }

    /// Whether it holds a unit direction.
    pub fn holds(&self, direction: Vec3) -> bool {
        1.0 - self.axis.dot(direction) <= self.one_minus_cos_max
    }

    /// The sphere's lowest and highest point above a plane through the apex with the unit normal `z`.
    pub fn heights(&self, z: Vec3) -> [f64; 2] {
        let middle = self.axis.dot(z) * self.distance;
        [middle - self.radius, middle + self.radius]
    }

    /// From the apex to the sphere along a unit direction of the cone.
    pub fn distance(&self, direction: Vec3) -> f64 {
        let along = self.axis.dot(direction);
        let across = (direction - self.axis * along).length() * self.distance;
        let half_chord2 = (self.radius - across) * (self.radius + across);
        self.distance * along - half_chord2.max(0.0).sqrt()
    }
}

/// Two unit vectors that make a right-handed frame with the unit vector `z`. Crossing with the
/// axis most nearly perpendicular to `z` keeps the quotient away from zero.
pub fn perpendiculars(z: Vec3) -> (Vec3, Vec3) {
    let (ax, ay, az) = (z.x.abs(), z.y.abs(), z.z.abs());
    let axis = if ax <= ay && ax <= az {
        Vec3::new(1.0, 0.0, 0.0)
    } else if ay <= az {
        Vec3::new(0.0, 1.0, 0.0)
    } else {
        Vec3::new(0.0, 0.0, 1.0)
    };
    let x = axis.cross(z).normalized();
    (x, z.cross(x))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_density_of_a_narrow_cone_keeps_its_digits() {
        // 1 - cos = r^2/2 to first order; computed from the cosine it would round to 0.
        let cone = Cone::new(Vec3::default(), Vec3::new(0.0, 0.0, 1.0), 1e-9)
            .map(|cone| cone.density() * PI * 1e-18);
        assert!(cone.is_some_and(|ratio| (ratio - 1.0).abs() < 1e-9));
    }

    #[test]
    fn a_point_inside_the_sphere_sees_no_cone() {
        assert!(Cone::new(Vec3::default(), Vec3::new(0.0, 0.0, 0.5), 0.5).is_none());
    }

    #[test]
    fn sampled_points_lie_on_the_sphere() {
        let (apex, centre) = (Vec3::new(0.04, -0.03, 0.0), Vec3::new(0.0, 0.7, 0.7));
        let cone = Cone::new(apex, centre, 0.03).expect("outside");
        for i in 0..1000 {
            let u = (f64::from(i) + 0.5) / 1000.0;
            let direction = cone.sample([(u * 37.0) % 1.0, u]);
            let point = apex + direction * cone.distance(direction);
            assert!(((point - centre).length() - 0.03).abs() < 1e-12);
            assert!((direction.length() - 1.0).abs() < 1e-14);
        }
    }
}
