//! Curves of the slope plane on which a linear function of the light's direction vanishes.

use super::lanes::Lanes;
use crate::numerics::batch::LANES;
use crate::vector::Vec3;

/// c(p, q), a polynomial of degree two in the slopes of the half vector.
///
/// The direction to the light, times |h|^2 for h = (p, q, 1), is W = 2 (wo.h) h - wo |h|^2. So a
/// linear function m.W of it is such a polynomial, and a straight edge of the chart, which lies in
/// a plane through the sample's point, is one of its zeros: a conic.
#[derive(Clone, Copy, Debug, Default)]
pub struct Conic {
    pp: f64,
    pq: f64,
    qq: f64,
    p: f64,
    q: f64,
    one: f64,
}

impl Conic {
    /// m.W for the viewer `wo`; both vectors in the lobe's frame.
    pub fn of(m: Vec3, wo: Vec3) -> Self {
        let along = m.dot(wo);
        Self {
            pp: 2.0 * wo.x * m.x - along,
            pq: 2.0 * (wo.x * m.y + wo.y * m.x),
            qq: 2.0 * wo.y * m.y - along,
            p: 2.0 * (wo.x * m.z + wo.z * m.x),
            q: 2.0 * (wo.y * m.z + wo.z * m.y),
            one: 2.0 * wo.z * m.z - along,
        }
    }

    /// The light's cosine less `cos_i`, times |h|^2.
    pub fn level(cos_i: f64, wo: Vec3) -> Self {
        let mut conic = Self::of(Vec3::new(0.0, 0.0, 1.0), wo);
        conic.pp -= cos_i;
        conic.qq -= cos_i;
        conic.one -= cos_i;
        conic
    }

    /// The polynomials in p on lines of these q.
    #[inline(always)]
    pub fn on_lines(&self, q: &[f64; LANES]) -> Quadratics {
        let (mut c0, mut c1) = ([0.0; LANES], [0.0; LANES]);
        for i in 0..LANES {
            c0[i] = self.one + q[i] * (self.q + q[i] * self.qq);
            c1[i] = self.p + self.pq * q[i];
        }
        Quadratics {
            c0,
            c1,
            c2: self.pp,
        }
    }

    /// The polynomial in q on the line p = 0.
    pub fn on_axis(&self) -> Quadratic {
        Quadratic {
            c0: self.one,
            c1: self.q,
            c2: self.qq,
        }
    }

    /// Its values at (0, q).
    #[inline(always)]
    pub fn values_on_axis(&self, q: &Lanes) -> Lanes {
        let mut values = [0.0; LANES];
        for i in 0..LANES {
            values[i] = self.one + q[i] * (self.q + q[i] * self.qq);
        }
        values
    }
}

/// Conics side by side, one a lane, near the line p = 0.
pub struct Conics {
    pp: Lanes,
    pq: Lanes,
    qq: Lanes,
    p: Lanes,
    q: Lanes,
    one: Lanes,
}

impl Conics {
    /// One conic less each of these factors times another.
    #[inline(always)]
    pub fn less(conic: &Conic, factors: &Lanes, other: &Conic) -> Self {
        Self {
            pp: less(conic.pp, factors, other.pp),
            pq: less(conic.pq, factors, other.pq),
            qq: less(conic.qq, factors, other.qq),
            p: less(conic.p, factors, other.p),
            q: less(conic.q, factors, other.q),
            one: less(conic.one, factors, other.one),
        }
    }

    /// Where they vanish on the line p = 0; infinite for each zero that there is not.
    #[inline(always)]
    pub fn zeros_on_axis(&self) -> [Lanes; 2] {
        zeros(&self.one, &self.q, &self.qq)
    }

    /// Where their zeros lie this far from the line p = 0.
    #[inline(always)]
    pub fn zeros_beside_axis(&self, distance: f64) -> [Lanes; 2] {
        let [c0, c1] = self.beside_axis(distance);
        zeros(&c0, &c1, &self.qq)
    }

    /// Which have zeros this far from the line p = 0.
    #[inline(always)]
    pub fn cross_beside_axis(&self, distance: f64) -> [bool; LANES] {
        let [c0, c1] = self.beside_axis(distance);
        let mut cross = [false; LANES];
        for i in 0..LANES {
            cross[i] = c1[i] * c1[i] >= 4.0 * c0[i] * self.qq[i];
        }
        cross
    }

    /// The constant and the linear coefficient in q this far from the line p = 0.
    #[inline(always)]
    fn beside_axis(&self, distance: f64) -> [Lanes; 2] {
        let [mut c0, mut c1] = [[0.0; LANES]; 2];
        for i in 0..LANES {
            c0[i] = self.one[i] + distance * (self.p[i] + distance * self.pp[i]);
            c1[i] = self.q[i] + distance * self.pq[i];
        }
        [c0, c1]
    }

    /// The p of their zeros nearest to p = 0 at these q, about.
    #[inline(always)]
    pub fn near_axis(&self, q: &Lanes) -> Lanes {
        let [by_p, _] = self.gradient(q);
        let mut near = [0.0; LANES];
        for i in 0..LANES {
            let value = self.one[i] + q[i] * (self.q[i] + q[i] * self.qq[i]);
            near[i] = -value / by_p[i];
        }
        near
    }

    /// By how much their zeros bend along p over these distances from q, at (0, q).
    #[inline(always)]
    pub fn bend(&self, q: &Lanes, distance: &Lanes) -> Lanes {
        let [by_p, _] = self.gradient(q);
        let mut bend = [0.0; LANES];
        for i in 0..LANES {
            bend[i] = (self.qq[i] * distance[i] * distance[i] / by_p[i]).abs();
        }
        bend
    }

    /// How their zeros bend along q from (0, q) on: half the second derivative of q by p.
    #[inline(always)]
    pub fn bend_along_q(&self, q: &Lanes) -> Lanes {
        let [by_p, by_q] = self.gradient(q);
        let mut bend = [0.0; LANES];
        for i in 0..LANES {
            let slope = -by_p[i] / by_q[i];
            bend[i] = -(self.pp[i] + slope * (self.pq[i] + slope * self.qq[i])) / by_q[i];
        }
        bend
    }

    /// How fast their zeros move along p with q, at (0, q): |dp/dq|, infinite where they run along p.
    #[inline(always)]
    pub fn drift(&self, q: &Lanes) -> Lanes {
        let [by_p, by_q] = self.gradient(q);
        let mut drift = [0.0; LANES];
        for i in 0..LANES {
            // Where neither is anything the edge stands still. A choice of quotients would be a branch.
            let along = if by_q[i] == 0.0 { 1.0 } else { by_p[i] };
            drift[i] = (by_q[i] / along).abs();
        }
        drift
    }

    /// The derivatives by p and by q, at (0, q).
    #[inline(always)]
    fn gradient(&self, q: &Lanes) -> [Lanes; 2] {
        let [mut by_p, mut by_q] = [[0.0; LANES]; 2];
        for i in 0..LANES {
            by_p[i] = self.p[i] + self.pq[i] * q[i];
            by_q[i] = self.q[i] + 2.0 * self.qq[i] * q[i];
        }
        [by_p, by_q]
    }
}

/// A coefficient less each of these factors times another's.
#[inline(always)]
fn less(own: f64, factors: &Lanes, other: f64) -> Lanes {
    let mut less = [0.0; LANES];
    for i in 0..LANES {
        less[i] = own - factors[i] * other;
    }
    less
}

/// The zeros of c0 + c1 x + c2 x^2; infinite for each that there is not.
#[inline(always)]
fn zeros(c0: &Lanes, c1: &Lanes, c2: &Lanes) -> [Lanes; 2] {
    let mut zeros = [[0.0; LANES]; 2];
    for i in 0..LANES {
        let discriminant = c1[i] * c1[i] - 4.0 * c0[i] * c2[i];
        // The sum that does not cancel; the other zero is the quotient of the two ends. Of a negative discriminant it
        // is not a number.
        let root = discriminant.sqrt();
        let sum = -0.5 * (c1[i] + if c1[i] < 0.0 { -root } else { root });
        let (one, other) = (c0[i] / sum, sum / c2[i]);
        zeros[0][i] = if one.abs() < f64::INFINITY {
            one
        } else {
            f64::INFINITY
        };
        zeros[1][i] = if other.abs() < f64::INFINITY {
            other
        } else {
            f64::INFINITY
        };
    }
    zeros
}

/// c0 + c1 x + c2 x^2.
#[derive(Clone, Copy, Debug)]
pub struct Quadratic {
    c0: f64,
    c1: f64,
    c2: f64,
}

impl Quadratic {
    /// Its zeros; infinite for each that there is not.
    #[inline(always)]
    pub fn zeros(&self) -> [f64; 2] {
        let discriminant = self.c1 * self.c1 - 4.0 * self.c0 * self.c2;
        if discriminant < 0.0 {
            return [f64::INFINITY; 2];
        }
        // The sum that does not cancel; the other zero is the quotient of the two ends.
        let root = discriminant.sqrt();
        let sum = -0.5 * (self.c1 + if self.c1 < 0.0 { -root } else { root });
        let finite = |zero: f64| {
            if zero.is_finite() {
                zero
            } else {
                f64::INFINITY
            }
        };
        [finite(self.c0 / sum), finite(sum / self.c2)]
    }
}

/// c0 + c1 x + c2 x^2 for lines side by side, which share c2.
#[derive(Clone, Copy, Debug)]
pub struct Quadratics {
    c0: [f64; LANES],
    c1: [f64; LANES],
    c2: f64,
}

impl Quadratics {
    /// Their values.
    #[inline(always)]
    pub fn values(&self, x: &[f64; LANES]) -> [f64; LANES] {
        let mut values = [0.0; LANES];
        for i in 0..LANES {
            values[i] = self.c0[i] + x[i] * (self.c1[i] + x[i] * self.c2);
        }
        values
    }

    /// These less `factor` times others.
    #[inline(always)]
    pub fn less(&self, factor: f64, other: &Self) -> Self {
        let (mut c0, mut c1) = ([0.0; LANES], [0.0; LANES]);
        for i in 0..LANES {
            c0[i] = self.c0[i] - factor * other.c0[i];
            c1[i] = self.c1[i] - factor * other.c1[i];
        }
        Self {
            c0,
            c1,
            c2: self.c2 - factor * other.c2,
        }
    }

    /// Whether any may vanish within `reach` of 0.
    #[inline(always)]
    pub fn may_vanish(&self, reach: &[f64; LANES]) -> bool {
        let mut any = false;
        for i in 0..LANES {
            let slope = self.c1[i].abs() + reach[i] * self.c2.abs();
            any |= self.c0[i].abs() <= reach[i] * slope;
        }
        any
    }

    /// Which of them have this sign everywhere within `reach` of 0, by a bound.
    #[inline(always)]
    pub fn keep_sign(&self, reach: &[f64; LANES], sign: f64) -> [bool; LANES] {
        let mut keep = [false; LANES];
        for i in 0..LANES {
            let slope = self.c1[i].abs() + reach[i] * self.c2.abs();
            keep[i] = sign * self.c0[i] > reach[i] * slope;
        }
        keep
    }

    /// Their zeros; not finite for each that there is not.
    #[inline(always)]
    pub fn zeros(&self) -> [[f64; LANES]; 2] {
        let mut zeros = [[0.0; LANES]; 2];
        for i in 0..LANES {
            let discriminant = self.c1[i] * self.c1[i] - 4.0 * self.c0[i] * self.c2;
            // The sum that does not cancel; the other zero is the quotient of the two ends. Of a
            // negative discriminant it is not a number.
            let root = discriminant.sqrt();
            let sum = -0.5 * (self.c1[i] + if self.c1[i] < 0.0 { -root } else { root });
            zeros[0][i] = self.c0[i] / sum;
            zeros[1][i] = sum / self.c2;
        }
        zeros
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn value(conic: &Conic, p: f64, q: f64) -> f64 {
        conic.on_lines(&[q; LANES]).values(&[p; LANES])[0]
    }

    /// Against each conic's own value.
    #[test]
    fn conics_side_by_side_are_near_the_axis_what_each_is() {
        let wo = Vec3::new(0.3, -0.8, 0.52).normalized();
        let along = Conic::of(Vec3::new(0.2, 0.7, -0.4), wo);
        let depth = Conic::of(Vec3::new(-0.1, 0.5, 0.9), wo);
        let lines: Lanes = std::array::from_fn(|i| 0.3 * i as f64 - 1.0);
        let edges = Conics::less(&along, &lines, &depth);
        let of_line =
            |i: usize, p: f64, q: f64| value(&along, p, q) - lines[i] * value(&depth, p, q);
        let (mut crossings, off) = (0, 1e-6);
        for zeros in edges.zeros_on_axis() {
            let (drift, far) = (edges.drift(&zeros), edges.bend(&zeros, &[off; LANES]));
            let bend_along_q = edges.bend_along_q(&zeros);
            let beside = zeros.map(|q| q + off);
            let (moved, back) = (
                edges.near_axis(&beside),
                edges.near_axis(&zeros.map(|q| q - off)),
            );
            for i in 0..LANES {
                if zeros[i].abs() > 3.0 {
                    continue;
                }
                crossings += 1;
                assert!(of_line(i, 0.0, zeros[i]).abs() < 1e-12, "{i}");
                // Bends along p do not count.
                let moved_by = off * (1.0 + drift[i]);
                let left = of_line(i, moved[i], beside[i]).abs();
                assert!(left < 5.0 * moved_by * moved_by, "{i}: {left} {}", drift[i]);
                let rate = 0.5 * (moved[i] - back[i]).abs() / off;
                assert!(
                    (rate / drift[i] - 1.0).abs() < 1e-3,
                    "{i}: {rate} {}",
                    drift[i]
                );
                assert!(far[i] < 1e-6, "{i}: {}", far[i]);
                // The zero at a small p, by the slope and the bend there.
                let p = 1e-4;
                let slope = (moved[i] - back[i]) / (2.0 * off);
                let q = zeros[i] + p / slope + bend_along_q[i] * p * p;
                let nearest = edges.zeros_beside_axis(p).map(|zeros| (zeros[i] - q).abs());
                let left = nearest[0].min(nearest[1]);
                assert!(left < 1e-3 * (bend_along_q[i] * p * p).abs(), "{i}: {left}");
            }
        }
        assert!(crossings >= LANES, "{crossings}");
        for distance in [1e-3, -1e-3] {
            for zeros in edges.zeros_beside_axis(distance) {
                for (i, q) in zeros.into_iter().enumerate().filter(|(_, q)| q.is_finite()) {
                    assert!(of_line(i, distance, q).abs() < 1e-12, "{i}");
                }
            }
        }
    }

    #[test]
    fn a_conic_is_the_linear_function_of_the_light() {
        let wo = Vec3::new(0.3, -0.8, 0.52).normalized();
        let m = Vec3::new(0.2, 0.7, -0.4);
        let conic = Conic::of(m, wo);
        for (p, q) in [(0.0, 0.0), (0.1, -0.3), (-0.7, 0.4)] {
            let half = Vec3::new(p, q, 1.0);
            let length2 = half.length_squared();
            let light = half * (2.0 * half.dot(wo)) - wo * length2;
            assert!((value(&conic, p, q) - m.dot(light)).abs() < 1e-14);
            let level = Conic::level(0.3, wo);
            let expected = light.z - 0.3 * length2;
            assert!((value(&level, p, q) - expected).abs() < 1e-14);
        }
    }

    #[test]
    fn zeros_keep_their_digits() {
        let found = |c0: f64, c1: f64, c2: f64| {
            let alone = Quadratic { c0, c1, c2 }.zeros();
            let beside = zeros(&[c0; LANES], &[c1; LANES], &[c2; LANES]);
            assert_eq!(beside, alone.map(|zero| [zero; LANES]));
            alone
        };
        // (x - 1e-12)(x + 1)
        let [a, b] = found(-1e-12, 1.0 - 1e-12, 1.0);
        assert!((a / 1e-12 - 1.0).abs() < 1e-12 && (b + 1.0).abs() < 1e-12);
        assert_eq!(found(1.0, 0.0, 1.0), [f64::INFINITY; 2]);
        assert_eq!(found(-2.0, 1.0, 0.0), [2.0, f64::INFINITY]);
        assert_eq!(found(1.0, 0.0, 0.0), [f64::INFINITY; 2]);
    }
}
