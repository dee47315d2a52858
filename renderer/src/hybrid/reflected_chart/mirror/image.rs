//! The chart's image in a mirror, and how a lobe blurs it about a pixel.
//!
//! Positions on the chart are in patches from its corner, along its axes. Of film points they are quotients of linear
//! functions, so that lines on the chart are straight on the film.

use super::blur::Edge;
use crate::hybrid::view::View;
use crate::reflectance::{Reflectance, fresnel};
use crate::scene::ChartPlane;
use crate::vector::Vec3;

/// How film points lead to the chart by a mirror, and by the facets of a lobe.
pub struct Mirror<'a> {
    view: &'a View,
    plane: ChartPlane,
    reflectance: &'a Reflectance,
    /// A position along each axis times the divisor.
    dividends: [Linear; 2],
    /// Positive where the chart's plane is met.
    divisor: Linear,
}

/// A linear function of the film.
#[derive(Clone, Copy, Debug)]
struct Linear {
    at_origin: f64,
    gradient: [f64; 2],
}

impl Linear {
    fn at(&self, film_point: [f64; 2]) -> f64 {
        self.at_origin + self.gradient[0] * film_point[0] + self.gradient[1] * film_point[1]
    }

    fn minus(&self, other: &Self, times: f64) -> Self {
        Self {
            at_origin: self.at_origin - times * other.at_origin,
            gradient: [0, 1].map(|axis| self.gradient[axis] - times * other.gradient[axis]),
        }
    }
}

/// How positions on the chart are blurred at a film point: normally.
#[derive(Clone, Copy, Debug)]
pub struct Blur {
    /// Standard deviations, in patches.
    pub widths: [f64; 2],
    pub correlation: f64,
    /// How far the mean is from the position without blur.
    pub shift: [f64; 2],
}

impl<'a> Mirror<'a> {
    pub fn new(view: &'a View, plane: ChartPlane, reflectance: &'a Reflectance) -> Self {
        let mirrored = |v: Vec3| Vec3::new(v.x, v.y, -v.z);
        let offset = mirrored(view.camera.position) - plane.corner;
        let height = plane.z.dot(offset);
        let linear = |of: &dyn Fn(Vec3) -> f64| {
            let at = |column, row| of(mirrored(view.camera.direction(column, row)));
            let at_origin = at(0.0, 0.0);
            Linear {
                at_origin,
                gradient: [at(1.0, 0.0) - at_origin, at(0.0, 1.0) - at_origin],
            }
        };
        let approach = |direction: Vec3| -plane.z.dot(direction);
        let per_pitch = 1.0 / plane.pitch;
        Self {
            view,
            plane,
            reflectance,
            dividends: [plane.x, plane.y].map(|axis| {
                linear(&|direction| {
                    (offset.dot(axis) * approach(direction) + height * direction.dot(axis))
                        * per_pitch
                })
            }),
            divisor: linear(&approach),
        }
    }

    /// Where on the chart's plane a film point leads; `None` where it misses it.
    pub fn at(&self, film_point: [f64; 2]) -> Option<[f64; 2]> {
        let divisor = self.divisor.at(film_point);
        (divisor > 0.0).then(|| {
            self.dividends
                .map(|dividend| dividend.at(film_point) / divisor)
        })
    }

    /// The film point that leads to a position on the chart; `None` where none does.
    pub fn film_point(&self, position: [f64; 2]) -> Option<[f64; 2]> {
        let lines = [0, 1].map(|axis| self.dividends[axis].minus(&self.divisor, position[axis]));
        let [[a, b], [c, d]] = lines.map(|line| line.gradient);
        let [e, f] = lines.map(|line| -line.at_origin);
        let determinant = a * d - b * c;
        let point = [(d * e - b * f) / determinant, (a * f - c * e) / determinant];
        let is_met = point.iter().all(|at| at.is_finite()) && self.divisor.at(point) > 0.0;
        is_met.then_some(point)
    }

    /// How far a position changes from column to column and from row to row, by axis.
    pub fn gradient(&self, film_point: [f64; 2], position: [f64; 2]) -> [[f64; 2]; 2] {
        let per_divisor = 1.0 / self.divisor.at(film_point);
        [0, 1].map(|axis| {
            let line = self.dividends[axis].minus(&self.divisor, position[axis]);
            line.gradient.map(|gradient| gradient * per_divisor)
        })
    }

    /// The line `index` between patches along an axis, for the pixel about a film point at which positions are blurred
    /// by `blur`; `None` where its own blur is not known.
    pub fn edge(&self, film_point: [f64; 2], axis: usize, index: f64, blur: &Blur) -> Option<Edge> {
        let line = self.dividends[axis].minus(&self.divisor, index);
        let edge = |divisor: f64, blur: &Blur| {
            let per_blur = 1.0 / (divisor * blur.widths[axis]);
            Edge {
                distance: -line.at(film_point) * per_blur - blur.shift[axis] / blur.widths[axis],
                gradient: line.gradient.map(|gradient| gradient * per_blur),
            }
        };
        // Both change over a pixel, and count where the line is.
        let foot = edge(self.divisor.at(film_point), blur).foot(0.0);
        let on_line = [0, 1].map(|axis| film_point[axis] + foot[axis]);
        let blur = self.blur(on_line, self.at(on_line)?)?;
        Some(edge(self.divisor.at(on_line), &blur))
    }

    /// How a position is blurred at a film point that leads to it: by what facets a standard deviation of the lobe off
    /// do along its axes. `None` where they miss the chart's plane.
    pub fn blur(&self, film_point: [f64; 2], at: [f64; 2]) -> Option<Blur> {
        let (position, wo) = self.view.sample_point(film_point);
        let lobe = &self.reflectance.lobe;
        let by_facet = |slopes: [f64; 2]| {
            let half = Vec3::new(slopes[0], slopes[1], 1.0);
            let half = lobe.to_surface(half) * (1.0 / half.length());
            let direction = half * (2.0 * wo.dot(half)) - wo;
            let is_up = wo.z > 0.0 && direction.z > 0.0;
            let met = self.plane.intersect(position, direction)?;
            let weight = fresnel::reflectance(wo.dot(half), self.reflectance.ior)
                * (direction.z / wo.z).min(1.0);
            is_up.then(|| (met.map(|metres| metres / self.plane.pitch), weight))
        };
        let (mut covariance, mut variances, mut shift) = (0.0, [0.0; 2], [0.0; 2]);
        for (axis, n) in [lobe.n_u, lobe.n_v].into_iter().enumerate() {
            let mut slopes = [0.0; 2];
            slopes[axis] = (1.0 / n).sqrt();
            let (high, high_weight) = by_facet(slopes)?;
            let (low, low_weight) = by_facet(slopes.map(|slope| -slope))?;
            let weights = high_weight + low_weight;
            let share = if weights > 0.0 {
                high_weight / weights
            } else {
                0.5
            };
            let reach = [0, 1].map(|of| 0.5 * (high[of] - low[of]));
            covariance += reach[0] * reach[1];
            for of in 0..2 {
                variances[of] += reach[of] * reach[of];
                shift[of] += share * high[of] + (1.0 - share) * low[of] - at[of];
            }
        }
        let widths = variances.map(f64::sqrt);
        Some(Blur {
            widths,
            correlation: covariance / (widths[0] * widths[1]),
            shift,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::BackendChoice;
    use crate::hybrid::PreparedView;
    use crate::scene::Scene;
    use dataset::Specification;

    /// Calls `visit` with views of the preset in which a near mirror shows the chart.
    fn for_each_view(visit: impl Fn(&Mirror<'_>)) {
        let specification = Specification::preset();
        let material = dataset::Material {
            roughness: 0.6,
            anisotropy: 0.1,
            angle_deg: 40.0,
            ..specification.material(7).material
        };
        for index in [4, 5] {
            let scene = Scene::new(&specification, index, BackendChoice::Native)
                .expect("a backend")
                .expect("a scene");
            let rotation = specification.views[index].rotation_deg;
            let reflectance = Reflectance::new(&material, rotation, specification.tint);
            let prepared = PreparedView::new(&scene, &specification).expect("a view for hybrid");
            let chart = prepared.chart.as_ref().expect("a chart");
            visit(&Mirror::new(&prepared.view, chart.plane, &reflectance));
        }
    }

    #[test]
    fn film_points_and_positions_on_the_chart_belong_together() {
        for_each_view(|mirror| {
            for position in [[0.5, 0.5], [3.0, 2.0], [0.1, 3.9], [5.7, 0.2]] {
                let film_point = mirror.film_point(position).expect("it shows");
                let (from, wo) = mirror.view.sample_point(film_point);
                let mirrored = Vec3::new(-wo.x, -wo.y, wo.z);
                let met = mirror.plane.intersect(from, mirrored).expect("it is met");
                let back = mirror.at(film_point).expect("it is met");
                for axis in 0..2 {
                    let expected = met[axis] / mirror.plane.pitch;
                    assert!((back[axis] - expected).abs() < 1e-9, "{back:?} {met:?}");
                    assert!((position[axis] - expected).abs() < 1e-9);
                }
                let gradient = mirror.gradient(film_point, position);
                const STEP: f64 = 1e-4;
                for along in 0..2 {
                    let mut beside = film_point;
                    beside[along] += STEP;
                    let moved = mirror.at(beside).expect("it is met");
                    for axis in 0..2 {
                        let expected = (moved[axis] - position[axis]) / STEP;
                        assert!((gradient[axis][along] - expected).abs() < 1e-5);
                    }
                }
            }
        });
    }

    /// Lines between patches are straight: the whole of one has no distance from the edge.
    #[test]
    fn an_edge_lies_where_the_patches_meet() {
        for_each_view(|mirror| {
            for axis in 0..2 {
                let film_point = mirror.film_point([2.1, 2.1]).expect("it shows");
                let blur = mirror.blur(film_point, [2.1, 2.1]).expect("it is known");
                let edge = mirror.edge(film_point, axis, 2.0, &blur).expect("it shows");
                for other in [0.1, 2.0, 3.5] {
                    let mut on_line = [other; 2];
                    on_line[axis] = 2.0;
                    let at = mirror.film_point(on_line).expect("it shows");
                    let u = [0, 1].map(|axis| at[axis] - film_point[axis]);
                    let shift = blur.shift[axis] / blur.widths[axis];
                    assert!((edge.at(u) + shift).abs() < 0.01, "{} {shift}", edge.at(u));
                }
                let [x, y] = edge.gradient;
                assert!(x * x + y * y > 1.0, "blurred by less than a pixel");
            }
        });
    }

    /// The blur of positions is that of many facets drawn from the lobe.
    #[test]
    fn positions_are_blurred_as_facets_are_turned() {
        for_each_view(|mirror| {
            let position = [2.5, 1.5];
            let film_point = mirror.film_point(position).expect("it shows");
            let blur = mirror.blur(film_point, position).expect("it is known");
            let (from, wo) = mirror.view.sample_point(film_point);
            let lobe = &mirror.reflectance.lobe;
            const SIDE: u32 = 200;
            let (mut sums, mut squares, mut product, mut count) = ([0.0; 2], [0.0; 2], 0.0, 0.0);
            for index in 0..SIDE * SIDE {
                let unit = [index % SIDE, index / SIDE]
                    .map(|index| (f64::from(index) + 0.5) / f64::from(SIDE));
                let half = lobe.sample(unit);
                let direction = half * (2.0 * wo.dot(half)) - wo;
                let met = mirror.plane.intersect(from, direction).expect("it is met");
                let off = [0, 1].map(|axis| met[axis] / mirror.plane.pitch - position[axis]);
                for axis in 0..2 {
                    sums[axis] += off[axis];
                    squares[axis] += off[axis] * off[axis];
                }
                product += off[0] * off[1];
                count += 1.0;
            }
            let widths = [0, 1].map(|axis| {
                let mean: f64 = sums[axis] / count;
                (squares[axis] / count - mean * mean).sqrt()
            });
            let mean = sums.map(|sum| sum / count);
            let correlation = (product / count - mean[0] * mean[1]) / (widths[0] * widths[1]);
            for axis in 0..2 {
                assert!(
                    (blur.widths[axis] / widths[axis] - 1.0).abs() < 0.02,
                    "{blur:?} {widths:?}"
                );
                // The share of light that facets send counts in the mean, and not here.
                assert!(
                    (blur.shift[axis] - mean[axis]).abs() < 0.02 * widths[axis],
                    "{blur:?} {mean:?}"
                );
            }
            assert!(
                (blur.correlation - correlation).abs() < 0.02,
                "{blur:?} {correlation}"
            );
        });
    }
}
