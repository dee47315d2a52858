//! What a mirror of one normal shows along a line of film points.

use super::batch::LANES;
use crate::instructions::kernel;
use crate::reflectance::fresnel;
use crate::vector::Vec3;

/// Panel coordinates of what does not meet the panel's front.
const FAR: f64 = -1e9;

kernel! {
    /// Where the directions through a line of film points, mirrored by `normal`, meet the panel, in
    /// patches from its corner. The camera stands at `(height, offset)`: above the sample, and from
    /// the panel's corner. `frame` holds the panel's axes over its pitch.
    pub fn meet(
        indices: &[f64],
        places: [&mut [f64]; 2],
        line: [Vec3; 2],
        normal: Vec3,
        camera: (f64, Vec3),
        frame: [Vec3; 3],
    ) {
        let [u, v] = places;
        let [start, step] = line;
        let (height, offset) = camera;
        let count = indices.len().min(u.len()).min(v.len());
        let (indices, u, v) = (&indices[..count], &mut u[..count], &mut v[..count]);
        for i in 0..count {
            let index = indices[i];
            let d = Vec3::new(start.x + step.x * index, start.y + step.y * index, start.z + step.z * index);
            // On the sample's plane.
            let reach = -height / d.z;
            let at = Vec3::new(offset.x + reach * d.x, offset.y + reach * d.y, offset.z + reach * d.z);
            let twice = 2.0 * (normal.x * d.x + normal.y * d.y + normal.z * d.z);
            let on = Vec3::new(d.x - twice * normal.x, d.y - twice * normal.y, d.z - twice * normal.z);
            let above = frame[2].x * at.x + frame[2].y * at.y + frame[2].z * at.z;
            let approach = -(frame[2].x * on.x + frame[2].y * on.y + frame[2].z * on.z);
            let way = above / approach;
            let hit = Vec3::new(at.x + way * on.x, at.y + way * on.y, at.z + way * on.z);
            let a = frame[0].x * hit.x + frame[0].y * hit.y + frame[0].z * hit.z;
            let b = frame[1].x * hit.x + frame[1].y * hit.y + frame[1].z * hit.z;
            u[i] = if approach > 0.0 { a } else { FAR };
            v[i] = if approach > 0.0 { b } else { FAR };
        }
    }
}

kernel! {
    /// The least and the largest of two lines of whole vectors.
    pub fn extent(first: &[f64], second: &[f64]) -> [f64; 2] {
        let (mut low, mut high) = ([f64::INFINITY; LANES], [f64::NEG_INFINITY; LANES]);
        for line in [first, second] {
            for block in line.as_chunks::<LANES>().0 {
                for i in 0..LANES {
                    low[i] = if block[i] < low[i] { block[i] } else { low[i] };
                    high[i] = if block[i] > high[i] { block[i] } else { high[i] };
                }
            }
        }
        let low = low.into_iter().fold(f64::INFINITY, f64::min);
        [low, high.into_iter().fold(f64::NEG_INFINITY, f64::max)]
    }
}

kernel! {
    /// What a mirror of this normal reflects: min(1, cos_i/cos_o) times Fresnel's reflectance, and
    /// times what that exceeds the tint's knee by.
    pub fn weigh(
        indices: &[f64],
        knees: &[f64],
        weights: [&mut [f64]; 2],
        line: [Vec3; 2],
        normal: Vec3,
        ior: f64,
    ) {
        let [fresnels, excesses] = weights;
        let [start, step] = line;
        let count = indices.len().min(knees.len()).min(fresnels.len()).min(excesses.len());
        let (indices, knees) = (&indices[..count], &knees[..count]);
        let (fresnels, excesses) = (&mut fresnels[..count], &mut excesses[..count]);
        for i in 0..count {
            let index = indices[i];
            let d = Vec3::new(start.x + step.x * index, start.y + step.y * index, start.z + step.z * index);
            let length = (d.x * d.x + d.y * d.y + d.z * d.z).sqrt();
            let twice = 2.0 * (normal.x * d.x + normal.y * d.y + normal.z * d.z);
            let cos_i = (d.z - twice * normal.z) / length;
            let cos_i = if cos_i > 0.0 { cos_i } else { 0.0 };
            let shade = cos_i * length / -d.z;
            let shade = if shade < 1.0 { shade } else { 1.0 };
            let reflected = fresnel::reflectance(cos_i, ior);
            let beyond = reflected - knees[i];
            let beyond = if beyond > 0.0 { beyond } else { 0.0 };
            fresnels[i] = shade * reflected;
            excesses[i] = shade * beyond;
        }
    }
}
