//! The reflectance model: Vidaurre, Casas, Garces and Lopez-Moreno, "BRDF Estimation of Complex
//! Materials with Nested Learning", WACV 2019, section 3, equations 1 to 5. It is Maxwell Render's
//! adaptation of Ashikhmin and Shirley's anisotropic Phong model.
//!
//! `wi` points to the light and `wo` to the viewer, as in pbrt; both are unit vectors in the frame
//! of the surface, where z is the normal. The tint depends on the viewer and Fresnel's term on the
//! light, so the model is not reciprocal by design: never swap the two.
//!
//! The printed equations carry three errata; what is implemented, and why:
//!
//! | printed | implemented | because |
//! | --- | --- | --- |
//! | sqrt((n_u+1) + (n_v+1)) | the product | the 2000 paper; the sum loses all but 4.5e-5 of the energy at R = 0 |
//! | n_v with the exponent -1 | -3 | at A = 0 the print is not isotropic |
//! | (1 - alpha) RGB0 cos_o | (1 - alpha) RGB0 / pi | a Lambert model; the print reflects up to 2.09 times what arrives |

pub mod fresnel;
pub mod lobe;
pub(crate) mod slope_plane;
pub(crate) mod specular;
mod tint;

pub(crate) use tint::LUMINANCE;
pub use tint::{TintResponse, tint};

use crate::vector::Vec3;
use crate::warp;
use dataset::{Material, specification::Tint};
use lobe::Lobe;
use std::f64::consts::FRAC_1_PI;

/// A material made ready for evaluation.
#[derive(Clone, Debug)]
pub struct Reflectance {
    /// The specular lobe.
    pub lobe: Lobe,
    /// Index of refraction.
    pub ior: f64,
    /// Reflectance at 0 degrees, linear Rec.709.
    pub rgb0: [f64; 3],
    rgb90: [f64; 3],
    tint: Tint,
    /// The share of the specular part: 1 up to a roughness of 90, then falling to 0 at 100.
    pub specular_share: f64,
}

/// A direction to the light drawn by [`Reflectance::sample`].
#[derive(Clone, Copy, Debug)]
pub struct DirectionSample {
    /// Toward the light.
    pub wi: Vec3,
    /// f cos_i / density: at most 1 in every channel.
    pub weight: [f64; 3],
    /// The density of `wi`, a steradian.
    pub density: f64,
}

impl Reflectance {
    /// The reflectance of `material`, its frame rotated counter-clockwise by `rotation_deg`.
    pub fn new(material: &Material, rotation_deg: f64, tint: Tint) -> Self {
        let specular_share = if material.roughness > 90.0 {
            (100.0 - material.roughness) / 10.0
        } else {
            1.0
        };
        Self {
            lobe: Lobe::new(
                material.roughness,
                material.anisotropy,
                material.angle_deg + rotation_deg,
            ),
            ior: material.ior,
            rgb0: material.rgb0,
            rgb90: material.rgb90,
            tint,
            specular_share,
        }
    }

    /// The BRDF f(wi, wo), a steradian, linear Rec.709; zero unless both directions lie above the
    /// surface (equation 1).
    pub fn evaluate(&self, wi: Vec3, wo: Vec3) -> [f64; 3] {
        if wi.z <= 0.0 || wo.z <= 0.0 {
            return [0.0; 3];
        }
        let mut value = [0.0; 3];
        if self.specular_share > 0.0 {
            let half = wi + wo;
            // The half vector is left unnormalised: h.wi is half its length.
            let specular = self.lobe.normalization * FRAC_1_PI / 8.0 * self.lobe.power(half)
                / (0.5 * half.length() * wi.z.max(wo.z));
            value = self
                .tint(wi.z, wo.z)
                .map(|channel| self.specular_share * channel * specular);
        }
        if self.specular_share < 1.0 {
            for (channel, rgb0) in value.iter_mut().zip(self.rgb0) {
                *channel += (1.0 - self.specular_share) * rgb0 * FRAC_1_PI;
            }
        }
        value
    }

    /// Draws a direction to the light from a point of the open unit square; `None` where the drawn
    /// direction lies below the surface, whose share of the light is lost to the model.
    pub fn sample(&self, wo: Vec3, point: [f64; 2]) -> Option<DirectionSample> {
        if wo.z <= 0.0 {
            return None;
        }
        let share = self.specular_share;
        let wi = if point[0] < share {
            let half = self.lobe.sample([point[0] / share, point[1]]);
            half * (2.0 * half.dot(wo)) - wo
        } else {
            warp::cosine_hemisphere([(point[0] - share) / (1.0 - share), point[1]])
        };
        if wi.z <= 0.0 {
            return None;
        }
        let density = self.density(wi, wo);
        // Of the lobe alone, f cos_i / density is known in closed form; as a quotient of two
        // numbers of up to 1e9 it would not be.
        let weight = if share == 1.0 {
            let foreshortening = wi.z / wi.z.max(wo.z);
            self.tint(wi.z, wo.z)
                .map(|channel| channel * foreshortening)
        } else {
            self.evaluate(wi, wo)
                .map(|channel| channel * wi.z / density)
        };
        Some(DirectionSample {
            wi,
            weight,
            density,
        })
    }

    /// The density of [`Reflectance::sample`], a steradian; zero unless both directions lie above
    /// the surface.
    pub fn density(&self, wi: Vec3, wo: Vec3) -> f64 {
        if wi.z <= 0.0 || wo.z <= 0.0 {
            return 0.0;
        }
        let half = wi + wo;
        let specular = self.lobe.density(half) / (2.0 * half.length());
        self.specular_share * specular + (1.0 - self.specular_share) * FRAC_1_PI * wi.z
    }

    /// The tint of the specular part (equation 2): Fresnel's term sees the light, the colour the
    /// viewer.
    fn tint(&self, cos_i: f64, cos_o: f64) -> [f64; 3] {
        let fresnel = fresnel::reflectance(cos_i, self.ior);
        tint(self.tint, fresnel, self.colour(cos_o))
    }

    /// At most the tint, in any channel, where the cosines lie between these.
    pub(crate) fn tint_max(&self, cos_i: [f64; 2], cos_o: [f64; 2]) -> f64 {
        // Fresnel's reflectance falls with the cosine and may rise again. The largest channel of a tint rises
        // with it and is, along a line of colours, a quotient of a convex and a linear function: both are
        // largest at an end.
        let fresnel = cos_i.map(|cosine| fresnel::reflectance(cosine, self.ior));
        let fresnel = fresnel[0].max(fresnel[1]);
        let tints = cos_o.map(|cosine| tint(self.tint, fresnel, self.colour(cosine)));
        tints.into_iter().flatten().fold(0.0, f64::max)
    }

    /// The tint toward a viewer at `cos_o`, as a function of Fresnel's reflectance.
    pub fn tint_response(&self, cos_o: f64) -> TintResponse {
        TintResponse::new(self.tint, self.colour(cos_o))
    }

    /// The kind of tint, and the reflectance at 90 degrees.
    pub(crate) fn tint_model(&self) -> (Tint, [f64; 3]) {
        (self.tint, self.rgb90)
    }

    fn colour(&self, cos_o: f64) -> [f64; 3] {
        std::array::from_fn(|channel| {
            self.rgb90[channel] * (1.0 - cos_o) + self.rgb0[channel] * cos_o
        })
    }
}
