//! Film points and cells side by side.

use super::glossy_chart::GlossyChart;
use crate::numerics::batch::LANES;
use crate::reflectance::fresnel;
use crate::vector::Vec3;

/// Numbers side by side.
pub type Lanes = [f64; LANES];

/// Directions through film points side by side.
#[derive(Clone, Default)]
pub struct Rays {
    /// x, y and z.
    pub direction: [Lanes; 3],
    /// Where they meet the sample's plane, from the chart's corner.
    pub at: [Lanes; 3],
    /// How far in front of the chart's plane that is.
    pub above: Lanes,
}

impl Rays {
    /// Sets the direction of a lane.
    pub fn set(&mut self, lane: usize, glossy: &GlossyChart<'_>, direction: Vec3) {
        let plane = &glossy.chart.plane;
        let camera = glossy.camera.position;
        let at = camera - plane.corner + direction * (-camera.z / direction.z);
        put(&mut self.direction, lane, direction.into());
        put(&mut self.at, lane, at.into());
        self.above[lane] = (plane.z * (1.0 / plane.pitch)).dot(at);
    }
}

/// Cells side by side, but for the normal.
#[derive(Clone)]
pub struct Cells {
    /// Whether the sample covers none of them whole.
    pub blank: bool,
    /// 1 where the sample covers a cell whole, otherwise 0.
    pub whole: Lanes,
    /// The direction through the middle, and its length.
    direction: [Lanes; 3],
    length: Lanes,
    /// The tint's response there.
    slopes: [Lanes; 3],
    bends: [Lanes; 3],
    knees: Lanes,
}

impl Default for Cells {
    /// No cell yet.
    fn default() -> Self {
        Self {
            blank: true,
            whole: [0.0; LANES],
            direction: Default::default(),
            length: [0.0; LANES],
            slopes: Default::default(),
            bends: Default::default(),
            knees: [0.0; LANES],
        }
    }
}

impl Cells {
    /// Sets the cell of a lane.
    pub fn set(&mut self, lane: usize, glossy: &GlossyChart<'_>, whole: bool, direction: Vec3) {
        let to_camera = -direction.normalized();
        let response = glossy.reflectance.tint_response(to_camera.z);
        self.blank &= !whole;
        self.whole[lane] = f64::from(u8::from(whole));
        put(&mut self.direction, lane, direction.into());
        self.length[lane] = direction.length();
        put(&mut self.slopes, lane, response.slope);
        put(&mut self.bends, lane, response.bend);
        self.knees[lane] = response.knee;
    }

    /// What a cell reflects about a normal: min(1, cos_i/cos_o) times its tint.
    #[inline(always)]
    pub fn tint(&self, lane: usize, normal: Vec3, ior: f64) -> [f64; 3] {
        let (d, length) = (at_lane(&self.direction, lane), self.length[lane]);
        let twice = 2.0 * (normal.x * d.x + normal.y * d.y + normal.z * d.z);
        let cos_i = (d.z - twice * normal.z) / length;
        let cos_i = if cos_i > 0.0 { cos_i } else { 0.0 };
        let shade = cos_i * length / -d.z;
        let shade = if shade < 1.0 { shade } else { 1.0 };
        let reflected = fresnel::reflectance(cos_i, ior);
        let beyond = reflected - self.knees[lane];
        let beyond = if beyond > 0.0 { beyond } else { 0.0 };
        let (fresnel, excess) = (shade * reflected, shade * beyond);
        let tint = |channel: usize| {
            let slope = self.slopes[channel][lane] * fresnel;
            let tint = slope + self.bends[channel][lane] * excess;
            if tint > 0.0 { tint } else { 0.0 }
        };
        [tint(0), tint(1), tint(2)]
    }
}

/// Along an axis, the middle of what of a cell from `low` to `high` lies on a patch, from its edge.
#[inline(always)]
pub fn position_on(low: f64, high: f64, patch: f64) -> f64 {
    let from = if low > patch { low } else { patch };
    let to = if high < patch + 1.0 {
        high
    } else {
        patch + 1.0
    };
    0.5 * (from + to) - patch
}

/// One of vectors side by side.
#[inline(always)]
pub fn at_lane(vectors: &[Lanes; 3], lane: usize) -> Vec3 {
    Vec3::new(vectors[0][lane], vectors[1][lane], vectors[2][lane])
}

fn put(vectors: &mut [Lanes; 3], lane: usize, value: [f64; 3]) {
    for (lanes, value) in vectors.iter_mut().zip(value) {
        lanes[lane] = value;
    }
}
