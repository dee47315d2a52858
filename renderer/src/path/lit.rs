//! Directions to the part of a rectangle that a near bulb lights.
//!
//! A bulb a millimetre off a metre of chart lights a thousandth of it. Paths to points that are evenly spread over the
//! chart mostly miss that, and all that do agree. So some paths go to points that are spread as the bulb's light is:
//! evenly over the solid angle of the rectangle about the bulb's centre. Ureña, Fajardo and King, "An Area-Preserving
//! Parametrization for Spherical Rectangles", Computer Graphics Forum 32 (4), 2013.

use crate::geometry::Rectangle;
use crate::scene::Bulb;
use crate::vector::Vec3;
use std::f64::consts::PI;

/// Where the brightest place of a rectangle gets no more than so many times the mean, even points do. Chosen.
const UNEVEN: f64 = 4.0;

/// A smaller solid angle is not told from none, steradians. Rounding.
const LEAST: f64 = 1e-6;

/// A rectangle that a bulb lights unevenly.
#[derive(Clone, Copy, Debug)]
pub struct Lit {
    rectangle: Rectangle,
    bulb: Vec3,
    /// How high the bulb's centre stands above the rectangle, in metres.
    height: f64,
    /// The sides along the rectangle's axes, from the foot of that height, in metres.
    u: [f64; 2],
    v: [f64; 2],
    /// The angles between the rectangle's normal and those of the planes through the bulb's centre and its sides of
    /// constant v.
    tilts: [f64; 2],
    /// What the solid angle up to some u and the angle in that formula differ by.
    offset: f64,
    solid_angle: f64,
}

impl Lit {
    /// The front of a rectangle, if the bulb lights it unevenly.
    pub fn new(rectangle: &Rectangle, bulb: &Bulb) -> Option<Self> {
        let from = bulb.centre - rectangle.corner;
        let height = from.dot(rectangle.normal);
        if height <= bulb.radius {
            return None;
        }
        let sides = [
            (from.dot(rectangle.u_axis), rectangle.u_length),
            (from.dot(rectangle.v_axis), rectangle.v_length),
        ];
        let [u, v] = sides.map(|(foot, length)| [-foot, length - foot]);
        let ([u0, u1], [v0, v1]) = (u, v);
        // The angles of the rectangle as it is seen on a sphere.
        let [a, b, c, d] = [[-v0, u1], [u1, v1], [v1, -u0], [-u0, -v0]].map(|[one, other]| {
            let from_bulb = (one * one + other * other + height * height).sqrt();
            libm::atan2(height * from_bulb, -one * other)
        });
        let lit = Self {
            rectangle: *rectangle,
            bulb: bulb.centre,
            height,
            u,
            v,
            tilts: [-v0, v1].map(|side| libm::atan2(height, side)),
            offset: 2.0 * PI - c - d,
            solid_angle: a + b + c + d - 2.0 * PI,
        };
        let [nearest_u, nearest_v] = [u, v].map(|[low, high]| 0.0f64.clamp(low, high));
        let area = rectangle.u_length * rectangle.v_length;
        let is_uneven = lit.solid_angle > LEAST
            && lit.per_area(nearest_u * nearest_u + nearest_v * nearest_v) * area > UNEVEN;
        is_uneven.then_some(lit)
    }

    /// The density of points at a squared distance from the foot, a square metre.
    fn per_area(&self, squared: f64) -> f64 {
        let squared = squared + self.height * self.height;
        self.height / (squared * squared.sqrt() * self.solid_angle)
    }

    /// A point of the rectangle, from one of the open unit square.
    pub fn point(&self, [x, y]: [f64; 2]) -> Vec3 {
        let angle = x * self.solid_angle + self.offset;
        let [low, high] = self.tilts;
        // cos(angle) cos(low) - cos(high), without its cancellation.
        let sin = |turn: f64, other: f64| {
            let sum = angle + turn;
            libm::sincos(0.5 * (sum + other)).0 * libm::sincos(0.5 * (sum - other)).0
        };
        let f = -(sin(low, high) + sin(-low, high)) / libm::sincos(angle).0;
        let least = libm::sincos(low).0;
        let squared = (f.abs() - least) * (f.abs() + least);
        let along_u = (self.height / squared.max(0.0).sqrt()).copysign(f);
        // At the far ends of a rectangle rounding may leave it.
        let along_u = along_u.clamp(self.u[0], self.u[1]);
        let squared = along_u * along_u + self.height * self.height;
        let ends = self.v.map(|side| side / (squared + side * side).sqrt());
        let share = ends[0] + y * (ends[1] - ends[0]);
        let along_v = share * (squared / (1.0 - share * share)).sqrt();
        let along_v = along_v.clamp(self.v[0], self.v[1]);
        self.rectangle.corner
            + self.rectangle.u_axis * (along_u - self.u[0])
            + self.rectangle.v_axis * (along_v - self.v[0])
    }

    /// The density at `direction` (unit) of the directions from `origin` to such points, a steradian. For a direction
    /// that misses the rectangle, the density about a larger one.
    pub fn density(&self, origin: Vec3, direction: Vec3) -> f64 {
        let normal = self.rectangle.normal;
        let cosine = normal.dot(direction);
        let height = normal.dot(origin - self.rectangle.corner);
        if cosine * height >= 0.0 {
            return 0.0;
        }
        let distance = -height / cosine;
        let from_bulb = origin + direction * distance - self.bulb;
        let squared = from_bulb.length_squared() - self.height * self.height;
        self.per_area(squared.max(0.0)) * distance * distance / cosine.abs()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// The solid angle of the points of a plane at distance `height` up to (u, v) from its nearest point.
    fn corner(height: f64, u: f64, v: f64) -> f64 {
        libm::atan2(u * v, height * (u * u + v * v + height * height).sqrt())
    }

    fn solid_angle(height: f64, [u0, u1]: [f64; 2], [v0, v1]: [f64; 2]) -> f64 {
        corner(height, u1, v1) - corner(height, u1, v0) - corner(height, u0, v1)
            + corner(height, u0, v0)
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(10_000))]

        /// The points up to any u, and of these up to any v, are those of the solid angle's share; what is evenly spread
        /// in the unit square and seen from anywhere has the density that is said.
        #[test]
        fn points_are_spread_as_the_light_is(
            (width, length) in (-3.0..2.8f64, -3.0..2.8f64),
            (u, v) in (-1.0..2.0f64, -1.0..2.0f64),
            height in -4.0..0.5f64,
            (x, y) in (1e-6..1.0f64, 1e-6..1.0f64),
        ) {
            let [width, length] = [width, length].map(libm::exp10);
            let axes = [Vec3::new(0.6, 0.8, 0.0), Vec3::new(0.0, 0.0, 1.0)];
            let rectangle = Rectangle::new(Vec3::new(1.0, 2.0, 3.0), axes[0], axes[1], width, length);
            let height = libm::exp10(height);
            let bulb = Bulb {
                centre: rectangle.point(u, v) + rectangle.normal * height,
                radius: 0.5 * height,
                radiance: 1.0,
            };
            let Some(lit) = Lit::new(&rectangle, &bulb) else {
                return Ok(());
            };
            let point = lit.point([x, y]);
            let offset = point - rectangle.corner;
            let at = axes.map(|axis| offset.dot(axis));
            let (low, foot) = ([-u * width, -v * length], [u * width, v * length]);
            let (to_u, to_v) = (at[0] - foot[0], at[1] - foot[1]);
            let sides = [[low[0], low[0] + width], [low[1], low[1] + length]];
            let all = solid_angle(height, sides[0], sides[1]);
            prop_assert!((lit.solid_angle - all).abs() <= 1e-7 * all.max(1e-3), "{lit:?}: {all}");
            let share = solid_angle(height, [low[0], to_u], sides[1]) / all;
            // A point is told from its neighbours to some 1e-16 of the sides.
            prop_assert!((share - x).abs() < 1e-6, "{share} of the light up to {x}");
            let strip = |to: f64| to / (to_u * to_u + to * to + height * height).sqrt();
            let share = (strip(to_v) - strip(low[1])) / (strip(sides[1][1]) - strip(low[1]));
            prop_assert!((share - y).abs() < 1e-6, "{share} of the strip up to {y}");

            // The density is how many points there are in a small square about one.
            let side = 1e-4 * height;
            let [square_u, square_v] = [to_u, to_v].map(|to| [to - 0.5 * side, to + 0.5 * side]);
            let inside = |[low, high]: [f64; 2], of: [f64; 2]| of[0] <= low && high <= of[1];
            if inside(square_u, sides[0]) && inside(square_v, sides[1]) {
                let origin = point + Vec3::new(0.3, -0.2, 0.4);
                let to = point - origin;
                let (distance, direction) = (to.length(), to.normalized());
                let per_steradian =
                    distance * distance / rectangle.normal.dot(direction).abs();
                let squared = to_u * to_u + to_v * to_v + height * height;
                let expected = height / (squared * squared.sqrt() * all) * per_steradian;
                let found = lit.density(origin, direction);
                prop_assert!((found / expected - 1.0).abs() < 1e-6, "{found} for {expected}");
            }
        }
    }
}
