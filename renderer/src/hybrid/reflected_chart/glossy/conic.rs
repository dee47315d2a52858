//! Curves of the slope plane on which a linear function of the light's direction vanishes.

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

    /// This less `factor` times another.
    pub fn less(&self, factor: f64, other: &Self) -> Self {
        Self {
            pp: self.pp - factor * other.pp,
            pq: self.pq - factor * other.pq,
            qq: self.qq - factor * other.qq,
            p: self.p - factor * other.p,
            q: self.q - factor * other.q,
            one: self.one - factor * other.one,
        }
    }

    /// Its value.
    #[inline(always)]
    pub fn value(&self, p: f64, q: f64) -> f64 {
        self.one + q * (self.q + q * self.qq) + p * (self.p + self.pq * q + p * self.pp)
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

    /// The polynomials in q where its zero lies this far from p = 0, to either side; next to that, bends along p do
    /// not count.
    pub fn beside_axis(&self, distance: f64) -> [Quadratic; 2] {
        let on_axis = self.on_axis();
        [distance, -distance].map(|distance| Quadratic {
            c0: on_axis.c0 + distance * self.p,
            c1: on_axis.c1 + distance * self.pq,
            ..on_axis
        })
    }

    /// The p of its zero nearest to p = 0 at q, about.
    pub fn near_axis(&self, q: f64) -> f64 {
        -(self.one + q * (self.q + q * self.qq)) / (self.p + self.pq * q)
    }

    /// By how much its zero bends along p over this distance from q, at (0, q).
    pub fn bend(&self, q: f64, distance: f64) -> f64 {
        (self.qq * distance * distance / (self.p + self.pq * q)).abs()
    }

    /// How fast its zero moves along p with q, at (0, q): |dp/dq|, infinite where it runs along p.
    pub fn drift(&self, q: f64) -> f64 {
        let along = (self.p + self.pq * q).abs();
        let across = (self.q + 2.0 * self.qq * q).abs();
        if across == 0.0 { 0.0 } else { across / along }
    }
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

    #[test]
    fn a_conic_is_the_linear_function_of_the_light() {
        let wo = Vec3::new(0.3, -0.8, 0.52).normalized();
        let m = Vec3::new(0.2, 0.7, -0.4);
        let conic = Conic::of(m, wo);
        for (p, q) in [(0.0, 0.0), (0.1, -0.3), (-0.7, 0.4)] {
            let half = Vec3::new(p, q, 1.0);
            let length2 = half.length_squared();
            let light = half * (2.0 * half.dot(wo)) - wo * length2;
            assert!((conic.value(p, q) - m.dot(light)).abs() < 1e-14);
            let level = Conic::level(0.3, wo);
            let expected = light.z - 0.3 * length2;
            assert!((level.value(p, q) - expected).abs() < 1e-14);
        }
    }

    #[test]
    fn zeros_keep_their_digits() {
        let found = |c0, c1, c2| Quadratic { c0, c1, c2 }.zeros();
        // (x - 1e-12)(x + 1)
        let [a, b] = found(-1e-12, 1.0 - 1e-12, 1.0);
        assert!((a / 1e-12 - 1.0).abs() < 1e-12 && (b + 1.0).abs() < 1e-12);
        assert_eq!(found(1.0, 0.0, 1.0), [f64::INFINITY; 2]);
        assert_eq!(found(-2.0, 1.0, 0.0), [2.0, f64::INFINITY]);
        assert_eq!(found(1.0, 0.0, 0.0), [f64::INFINITY; 2]);
    }
}
