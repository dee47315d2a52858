//! Directions that are known only to within an angle.

use crate::path::visible_part::angle_between;
use crate::vector::Vec3;
use std::f64::consts::PI;

/// All unit directions within an angle of one of them.
#[derive(Clone, Copy, Debug)]
pub struct Spread {
    /// The middle, a unit vector.
    pub axis: Vec3,
    /// The most that one turns from it, in radians, at most pi.
    pub angle: f64,
}

impl Spread {
    /// From any point to any other, where `offset` leads from one such to one such and the two move by at most
    /// `moves` in all.
    pub fn toward(offset: Vec3, moves: f64) -> Self {
        let distance = offset.length();
        let angle = if moves < distance {
            libm::asin(moves / distance)
        } else {
            PI
        };
        Self {
            axis: offset * (1.0 / distance),
            angle,
        }
    }

    /// All positive combinations of three vectors, made unit vectors; `None` where they are not all on one
    /// side of their mean.
    pub fn between(corners: [Vec3; 3]) -> Option<Self> {
        let axis = (corners[0] + corners[1] + corners[2]).normalized();
        let angles = corners.map(|corner| angle_between(axis, corner));
        let angle = angles.into_iter().fold(0.0, f64::max);
        // A cone of less than a right angle is convex: what lies between directions in it does too. A
        // comparison with NaN fails.
        (angle < 0.5 * PI).then_some(Self { axis, angle })
    }

    /// The half vectors of these directions and others; `None` where they may point anywhere.
    pub fn half(self, other: Self) -> Option<Self> {
        let sum = self.axis + other.axis;
        // A unit vector that turns by an angle moves by its chord.
        let moves = [self.angle, other.angle].map(|angle| 2.0 * libm::sin(0.5 * angle));
        let half = Self::toward(sum, moves[0] + moves[1]);
        (half.angle < 0.5 * PI).then_some(half)
    }

    /// The least and the largest angle between one of these and one of the others.
    pub fn angles(self, other: Self) -> [f64; 2] {
        let middle = angle_between(self.axis, other.axis);
        let off = self.angle + other.angle;
        [(middle - off).max(0.0), (middle + off).min(PI)]
    }

    /// How far these directions turn about a pole, which is itself known to within an angle, in radians;
    /// pi where they may be all around it.
    pub fn turn_about(self, pole: Self) -> f64 {
        let between = angle_between(self.axis, pole.axis);
        // Turn everything by the smallest rotation that takes the true pole to the axis of all poles: what is
        // measured stays, and directions move by no more than the pole does.
        let off = self.angle + pole.angle;
        let (sine, sine_off) = (libm::sin(between), libm::sin(off));
        if off < 0.5 * PI && sine_off < sine {
            libm::asin(sine_off / sine)
        } else {
            PI
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::warp::perpendiculars;
    use proptest::prelude::*;

    fn unit() -> impl Strategy<Value = Vec3> {
        let coordinates = [-1.0..1.0f64, -1.0..1.0, -1.0..1.0].prop_map(Vec3::from);
        let usable = coordinates.prop_filter("too short", |at| at.length() > 0.1);
        usable.prop_map(|at| at.normalized())
    }

    /// A spread, and one of its directions.
    fn spread() -> impl Strategy<Value = (Spread, Vec3)> {
        (unit(), 0.0..1.5f64, 0.0..1.0f64, 0.0..2.0 * PI).prop_map(
            |(axis, angle, share, around)| {
                let (x, y) = perpendiculars(axis);
                let (sin_around, cos_around) = libm::sincos(around);
                let (sin, cos) = libm::sincos(share * angle);
                let one = axis * cos + (x * cos_around + y * sin_around) * sin;
                (Spread { axis, angle }, one)
            },
        )
    }

    /// Turned by the smallest rotation that takes one unit vector to another.
    fn carried(at: Vec3, from: Vec3, to: Vec3) -> Vec3 {
        // Two reflections: in the plane across the first, and across the middle of both.
        let middle = (from + to).normalized();
        let reflected = at - from * (2.0 * from.dot(at));
        reflected - middle * (2.0 * middle.dot(reflected))
    }

    const ROUNDING: f64 = 1e-9;

    proptest! {
        #[test]
        fn directions_are_within_their_spreads(
            (a, one) in spread(), (b, other) in spread(),
            corners in [unit(), unit(), unit()], weights in [0.01..1.0f64, 0.01..1.0, 0.01..1.0],
        ) {
            let [least, most] = a.angles(b);
            let between = angle_between(one, other);
            prop_assert!(least <= between + ROUNDING && between <= most + ROUNDING);
            if let Some(half) = a.half(b) {
                let off = angle_between(half.axis, one + other);
                prop_assert!(off <= half.angle + ROUNDING, "{off} in {half:?}");
            }
            if let Some(all) = Spread::between(corners) {
                let [a, b, c] = [0, 1, 2].map(|corner| corners[corner] * weights[corner]);
                let off = angle_between(all.axis, a + b + c);
                prop_assert!(off <= all.angle + ROUNDING, "{off} in {all:?}");
            }
        }

        /// Toward points near one from points near another.
        #[test]
        fn directions_between_balls_are_within_their_spread(
            offset in unit(), moves in 0.0..1.0f64, moved in unit(), share in 0.0..1.0f64,
        ) {
            let all = Spread::toward(offset, moves);
            let off = angle_between(all.axis, offset + moved * (moves * share));
            prop_assert!(off <= all.angle + ROUNDING, "{off} in {all:?}");
        }

        #[test]
        fn directions_turn_no_more_about_a_pole_than_is_said(
            (directions, one) in spread(), (poles, pole) in spread(),
        ) {
            let turned = carried(one, pole, poles.axis);
            let x = (directions.axis - poles.axis * poles.axis.dot(directions.axis)).normalized();
            let y = poles.axis.cross(x);
            let turn = libm::atan2(y.dot(turned), x.dot(turned)).abs();
            prop_assert!(turn <= directions.turn_about(poles) + ROUNDING);
        }
    }
}
