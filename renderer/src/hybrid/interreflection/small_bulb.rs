//! The bulb's light off many points of the sample at once, for lobes over which the bulb is small.

use super::super::batch::{Batch, LANES};
use super::super::elementary::{exp, log1p};
use super::Sent;
use crate::instructions::{Instructions, kernel};
use crate::reflectance::{Reflectance, TintResponse, fresnel, lobe::Lobe};
use crate::vector::Vec3;
use std::f64::consts::{FRAC_1_PI, PI};

/// Directions to the bulb at each point: the corners of the square that integrates cubics over a
/// disc, half its radius from either axis.
const DIRECTIONS: usize = 4;

/// A bulb that is small against the lobe.
pub struct SmallBulb {
    /// Its centre.
    pub centre: Vec3,
    /// Its radius in metres.
    pub radius: f64,
    /// Its radiance, in units of white.
    pub radiance: f64,
}

/// To the light, to the viewer (both unit), and the tint's knee.
type DirectionBatch = Batch<7>;

/// Buffers.
#[derive(Default)]
pub struct Buffers {
    directions: DirectionBatch,
    responses: Vec<TintResponse>,
    /// In each block the lobe times Fresnel's reflectance, and what it exceeds the knee by.
    terms: Vec<[[f64; LANES]; 2]>,
}

impl SmallBulb {
    /// The weighted sum of its light off points of the sample, and evaluations.
    pub fn off_sample(
        &self,
        reflectance: &Reflectance,
        instructions: Instructions,
        points: &[Sent],
        buffers: &mut Buffers,
    ) -> ([f64; 3], u64) {
        let Buffers {
            directions,
            responses,
            terms,
        } = buffers;
        directions.clear();
        responses.clear();
        for point in points {
            let directions_to_bulb = self.directions(point.position);
            let response = reflectance.tint_response(point.toward.z);
            responses.push(response);
            let Vec3 { x, y, z } = point.toward;
            for wi in directions_to_bulb {
                directions.push([wi.x, wi.y, wi.z, x, y, z, response.knee]);
            }
        }
        terms.clear();
        terms.resize(directions.blocks().len(), [[0.0; LANES]; 2]);
        evaluate(
            instructions,
            directions,
            terms,
            &reflectance.lobe,
            reflectance.ior,
        );
        let share = reflectance.specular_share;
        let scale = share * 0.25 * FRAC_1_PI * reflectance.lobe.normalization;
        let mut sum = [0.0; 3];
        for (index, (point, response)) in points.iter().zip(responses).enumerate() {
            let first = index * DIRECTIONS % LANES;
            let lanes = first..first + DIRECTIONS;
            let [fresnel, excess] = &terms[index * DIRECTIONS / LANES];
            let [fresnel, excess] =
                [fresnel, excess].map(|terms| terms[lanes.clone()].iter().sum::<f64>());
            let offset = self.centre - point.position;
            let sin2 = self.radius * self.radius / offset.length_squared();
            let solid_angle = 2.0 * PI * sin2 / (1.0 + (1.0 - sin2).sqrt());
            let each = scale * solid_angle / DIRECTIONS as f64;
            let specular = response.at_moments(fresnel, excess);
            let diffuse = (1.0 - share) * sin2 * offset.z / offset.length();
            for channel in 0..3 {
                let radiance = each * specular[channel] + diffuse * reflectance.rgb0[channel];
                sum[channel] += self.radiance * point.weight * radiance;
            }
        }
        (sum, directions.count() as u64)
    }

    /// Directions to the bulb.
    fn directions(&self, position: Vec3) -> [Vec3; DIRECTIONS] {
        let offset = self.centre - position;
        let distance2 = offset.length_squared();
        let sin2 = self.radius * self.radius / distance2;
        let centre = offset * (1.0 / distance2.sqrt());
        // Any frame about it; the bulb does not stand on the x axis.
        let across = Vec3::new(0.0, centre.z, -centre.y);
        let across = across * (1.0 / across.length());
        let up = centre.cross(across);
        let side = 0.5 * sin2.sqrt();
        let along = centre * (1.0 - 0.5 * sin2).sqrt();
        let corner = |x: f64, y: f64| along + across * (side * x) + up * (side * y);
        [
            corner(1.0, 1.0),
            corner(-1.0, 1.0),
            corner(-1.0, -1.0),
            corner(1.0, -1.0),
        ]
    }
}

kernel! {
    /// The lobe's power times cos_i / (|h| max(cos_i, cos_o)), and Fresnel's reflectance, at every
    /// pair of directions.
    pub fn evaluate(
        batch: &DirectionBatch,
        terms: &mut [[[f64; LANES]; 2]],
        lobe: &Lobe,
        ior: f64,
    ) {
        let (n_u, n_v) = (lobe.n_u, lobe.n_v);
        // The lobe's axes in the world's frame.
        let u = lobe.to_surface(Vec3::new(1.0, 0.0, 0.0));
        for ([x, y, z, wx, wy, wz, knee], terms) in batch.blocks().zip(terms) {
            for i in 0..LANES {
                let (hx, hy, hz) = (x[i] + wx[i], y[i] + wy[i], z[i] + wz[i]);
                let hu = u.x * hx + u.y * hy;
                let hv = u.x * hy - u.y * hx;
                let (hu2, hv2) = (hu * hu, hv * hv);
                // Lanes that hold no point are all zeros.
                let hz2 = hz * hz + f64::MIN_POSITIVE;
                let tangential = hu2 + hv2;
                let exponent = (n_u * hu2 + n_v * hv2) / (tangential + f64::MIN_POSITIVE);
                let power = exp(-0.5 * exponent * log1p(tangential / hz2));
                let cos_i = z[i];
                let larger = if cos_i > wz[i] { cos_i } else { wz[i] };
                let larger = if larger > 0.0 { larger } else { 1.0 };
                let value = power * cos_i / ((tangential + hz2).sqrt() * larger);
                let fresnel = fresnel::reflectance(cos_i, ior);
                let beyond = fresnel - knee[i];
                let beyond = if beyond > 0.0 { beyond } else { 0.0 };
                terms[0][i] = value * fresnel;
                terms[1][i] = value * beyond;
            }
        }
    }
}
