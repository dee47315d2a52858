//! Where on a film the sample is.

use crate::{
    Specification,
    masks::Mask,
    mesh_on_film::mask_of_view,
    specification::Shape,
    view::{ViewGeometry, film_pitch},
};

/// A film and the sample on it.
pub(crate) struct SampleOnFilm {
    geometry: ViewGeometry,
    shape: Shape,
    side_m: f64,
    /// A pixel's side at unit distance.
    pitch: f64,
    /// Half of the film's columns and rows.
    middle: [f64; 2],
    /// The pixels that see a mesh.
    mask: Option<Mask>,
}

impl SampleOnFilm {
    /// That of a view; `None` where the specification has no such view, and where its mesh is not loaded.
    pub fn new(specification: &Specification, view: u32) -> Option<Self> {
        let image = &specification.image;
        let geometry = specification.view_geometry(view as usize)?;
        let mask = match specification.sample.shape {
            Shape::Mesh => {
                let mesh = specification.sample.loaded_mesh()?;
                let pitch = film_pitch(specification);
                Some(mask_of_view(mesh, specification, &geometry, pitch))
            }
            Shape::Square | Shape::Sphere | Shape::Cylinder => None,
        };
        Some(Self {
            mask,
            geometry,
            shape: specification.sample.shape,
            side_m: specification.sample.side_m,
            pitch: film_pitch(specification),
            middle: [image.width, image.height].map(|side| 0.5 * f64::from(side)),
        })
    }

    /// Tells of each pixel of a row whether its centre lies on the front of the sample, whatever stands before it.
    pub fn mark_row(&self, row: usize, on_sample: &mut [bool]) {
        let y = row as f64 + 0.5;
        let holds = |column: usize, x: f64| match self.shape {
            Shape::Square => is_on_square(&self.geometry.sample_from_film, [x, y]),
            Shape::Mesh => {
                let place = row * (2.0 * self.middle[0]) as usize + column;
                self.mask.as_ref().is_some_and(|mask| mask[place])
            }
            Shape::Sphere => self.chord([x, y], [0, 1, 2]).is_some(),
            Shape::Cylinder => self.chord([x, y], [1, 2]).is_some_and(|near| {
                let x = self.origin(0) + near * self.direction([x, y])[0];
                x.abs() <= 0.5 * self.side_m
            }),
        };
        for (column, on_sample) in on_sample.iter_mut().enumerate() {
            *on_sample = holds(column, column as f64 + 0.5);
        }
    }

    fn origin(&self, axis: usize) -> f64 {
        self.geometry.camera_position[axis]
    }

    /// From the camera to a film point at unit depth, in the world.
    fn direction(&self, [x, y]: [f64; 2]) -> [f64; 3] {
        let right = (x - self.middle[0]) * self.pitch;
        let up = (self.middle[1] - y) * self.pitch;
        std::array::from_fn(|axis| {
            let [of_right, of_up, of_back, _] = self.geometry.world_from_camera[axis];
            of_right * right + of_up * up - of_back
        })
    }

    /// How far along its direction a film point first sees the sphere about (0, 0, -r), or with two axes
    /// the circle there in their plane; the camera is outside of both.
    fn chord<const N: usize>(&self, at: [f64; 2], axes: [usize; N]) -> Option<f64> {
        let radius = 0.5 * self.side_m;
        let direction = self.direction(at);
        let dot = |a: [f64; N], b: [f64; N]| (0..N).map(|axis| a[axis] * b[axis]).sum::<f64>();
        let direction = axes.map(|axis| direction[axis]);
        let to_centre = axes.map(|axis| {
            let centre = if axis == 2 { -radius } else { 0.0 };
            centre - self.origin(axis)
        });
        let square = dot(direction, direction);
        let along = dot(direction, to_centre);
        let beyond = dot(to_centre, to_centre) - radius * radius;
        let discriminant = along * along - square * beyond;
        (along > 0.0 && discriminant >= 0.0).then(|| beyond / (along + discriminant.sqrt()))
    }
}

/// Whether a film point shows the square. The matrix gives the position along its two sides, each times the depth, and
/// the depth.
#[inline(always)]
fn is_on_square(sample_from_film: &[[f64; 3]; 3], [x, y]: [f64; 2]) -> bool {
    let along = |[a, b, c]: [f64; 3]| a * x + b * y + c;
    let [of_u, of_v, of_w] = *sample_from_film;
    let (u, v, w) = (along(of_u), along(of_v), along(of_w));
    // Without branches: all of a row's pixels are asked for.
    (w > 0.0) & (u >= 0.0) & (u <= w) & (v >= 0.0) & (v <= w)
}
