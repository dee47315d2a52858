//! Light, camera and exposure, where they are known only roughly.

use crate::error::{InverseError, check_positive};
use dataset::{
    Specification,
    specification::{View, limits},
};

/// A nuisance parameter stays within this many standard deviations of its prior.
const PRIOR_RANGE_SD: f64 = 4.0;

/// Standard deviations of Gaussian priors about what the specification says. `None` means that it
/// is exact and is not fitted.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Nuisances {
    /// The light's elevation, in degrees, one offset for all views.
    pub light_elevation_deg: Option<f64>,
    /// The light's distance, as a fraction of itself.
    pub light_distance: Option<f64>,
    /// The camera's elevation, in degrees, an offset for each view.
    pub camera_elevation_deg: Option<f64>,
    /// The logarithms of the gains of red, green and blue in each view, by which linear pixels are
    /// multiplied before they are encoded.
    pub gain: Option<f64>,
}

/// Fitted nuisance parameters. Those that are not fitted have the values of the specification.
#[derive(Clone, Debug, PartialEq)]
pub struct NuisanceValues {
    /// Degrees added to the light's elevation.
    pub light_elevation_deg: f64,
    /// Factor of the light's distance.
    pub light_distance: f64,
    /// Degrees added to the camera's elevation, for each view in the order of the observation.
    pub camera_elevation_deg: Vec<f64>,
    /// Factors of linear red, green and blue, for each view in the order of the observation.
    pub gain: Vec<[f64; 3]>,
}

/// What a variable of the fit changes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kind {
    LightElevation,
    LightDistance,
    /// Of the view at this place of the observation.
    CameraElevation(usize),
    /// Of the view at this place of the observation, and of this channel.
    Gain(usize, usize),
}

/// A variable of the fit, in standard deviations of its prior.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Nuisance {
    pub kind: Kind,
    sd: f64,
    /// The least and the largest value.
    pub bounds: [f64; 2],
}

impl Nuisances {
    /// The variables for these views, which exist.
    pub(crate) fn variables(
        &self,
        specification: &Specification,
        views: &[u32],
    ) -> Result<Vec<Nuisance>, InverseError> {
        let view = |view: u32| specification.views.get(view as usize);
        let mut variables = Vec::new();
        if let Some(sd) = self.light_elevation_deg {
            check_positive("nuisances.light_elevation_deg", sd)?;
            let elevations = views.iter().filter_map(|&index| view(index));
            let elevations: Vec<f64> = elevations.map(|view| view.light_elevation_deg).collect();
            let bounds = elevation_bounds(&elevations, sd);
            let kind = Kind::LightElevation;
            variables.push(Nuisance { kind, sd, bounds });
        }
        let whole = [-PRIOR_RANGE_SD, PRIOR_RANGE_SD];
        if let Some(sd) = self.light_distance {
            check_positive("nuisances.light_distance", sd)?;
            let (kind, bounds) = (Kind::LightDistance, whole);
            variables.push(Nuisance { kind, sd, bounds });
        }
        if let Some(sd) = self.camera_elevation_deg {
            check_positive("nuisances.camera_elevation_deg", sd)?;
            for (place, &index) in views.iter().enumerate() {
                let elevation = view(index).map(|view| view.camera_elevation_deg);
                let bounds = elevation_bounds(elevation.as_slice(), sd);
                let kind = Kind::CameraElevation(place);
                variables.push(Nuisance { kind, sd, bounds });
            }
        }
        if let Some(sd) = self.gain {
            check_positive("nuisances.gain", sd)?;
            for channel in 0..3 * views.len() {
                let (kind, bounds) = (Kind::Gain(channel / 3, channel % 3), whole);
                variables.push(Nuisance { kind, sd, bounds });
            }
        }
        Ok(variables)
    }
}

/// How far elevations may be moved together: within the prior's range and the specification's.
fn elevation_bounds(elevations_deg: &[f64], sd_deg: f64) -> [f64; 2] {
    let (least, most) = (limits::ELEVATION_DEG.start(), limits::ELEVATION_DEG.end());
    let down = elevations_deg.iter().map(|elevation| least - elevation);
    let up = elevations_deg.iter().map(|elevation| most - elevation);
    [
        down.fold(-PRIOR_RANGE_SD * sd_deg, f64::max).min(0.0) / sd_deg,
        up.fold(PRIOR_RANGE_SD * sd_deg, f64::min).max(0.0) / sd_deg,
    ]
}

/// The values of the variables at `z`, in standard deviations.
pub(crate) fn values(variables: &[Nuisance], z: &[f64], views: usize) -> NuisanceValues {
    let mut values = NuisanceValues {
        light_elevation_deg: 0.0,
        light_distance: 1.0,
        camera_elevation_deg: vec![0.0; views],
        gain: vec![[1.0; 3]; views],
    };
    for (variable, z) in variables.iter().zip(z) {
        let offset = variable.sd * z;
        match variable.kind {
            Kind::LightElevation => values.light_elevation_deg = offset,
            // A logarithm keeps it positive.
            Kind::LightDistance => values.light_distance = libm::exp(offset),
            Kind::CameraElevation(place) => values.camera_elevation_deg[place] = offset,
            Kind::Gain(place, channel) => values.gain[place][channel] = libm::exp(offset),
        }
    }
    values
}

impl Nuisance {
    /// The derivative of the logarithm of a gain by its variable.
    pub(crate) fn sd(&self) -> f64 {
        self.sd
    }
}

impl NuisanceValues {
    /// `specification` with light and cameras of `views` moved.
    ///
    /// # Errors
    /// When the result is out of range, as where the bulb gets behind the chart.
    pub fn apply(
        &self,
        specification: &Specification,
        views: &[u32],
    ) -> Result<Specification, InverseError> {
        let mut changed = specification.clone();
        changed.light.distance_m *= self.light_distance;
        for (place, &view) in views.iter().enumerate() {
            let offset = self.camera_elevation_deg.get(place).copied();
            let Some(View {
                camera_elevation_deg,
                light_elevation_deg,
                ..
            }) = changed.views.get_mut(view as usize)
            else {
                continue;
            };
            *camera_elevation_deg = elevation(*camera_elevation_deg + offset.unwrap_or(0.0));
            *light_elevation_deg = elevation(*light_elevation_deg + self.light_elevation_deg);
        }
        if changed == *specification {
            return Ok(changed);
        }
        // Reading it back is what checks it, and loads no mesh.
        let checked = Specification::from_json(&changed.to_json())?;
        Ok(checked.with_mesh_of(specification))
    }
}

/// Sums may exceed a bound by a rounding.
fn elevation(degrees: f64) -> f64 {
    degrees.clamp(*limits::ELEVATION_DEG.start(), *limits::ELEVATION_DEG.end())
}

#[cfg(test)]
mod tests {
    use super::*;
    use dataset::specification::{SampleMesh, Shape};

    const ALL: Nuisances = Nuisances {
        light_elevation_deg: Some(1.0),
        light_distance: Some(0.05),
        camera_elevation_deg: Some(1.0),
        gain: Some(0.1),
    };

    #[test]
    fn variables_move_what_they_name() {
        let preset = Specification::preset();
        let variables = ALL.variables(&preset, &[5, 8]).unwrap();
        assert_eq!(variables.len(), 10);
        let z = [-1.0, 2.0, 0.5, -3.0, 1.0, 0.0, 0.0, 0.0, 0.0, -1.0];
        let values = values(&variables, &z, 2);
        let changed = values.apply(&preset, &[5, 8]).unwrap();
        assert_eq!(changed.views[5].light_elevation_deg, 44.0);
        assert_eq!(changed.views[5].camera_elevation_deg, 30.5);
        assert_eq!(changed.views[8].camera_elevation_deg, 87.0);
        assert_eq!(changed.views[6], preset.views[6]);
        assert!((changed.light.distance_m - libm::exp(0.1)).abs() < 1e-15);
        assert!((values.gain[0][0] * values.gain[1][2] - 1.0).abs() < 1e-15);
        assert_eq!((values.gain[0][1], values.gain[1][0]), (1.0, 1.0));
    }

    #[test]
    fn a_camera_overhead_only_goes_down() {
        let preset = Specification::preset();
        let variables = ALL.variables(&preset, &[5, 8]).unwrap();
        assert_eq!(variables[2].bounds, [-4.0, 4.0]);
        assert_eq!(variables[3].bounds, [-4.0, 0.0]);
        let bad = Nuisances {
            gain: Some(-1.0),
            ..ALL
        };
        let refused = bad.variables(&preset, &[5]).unwrap_err().to_string();
        assert!(refused.contains("nuisances.gain is -1"), "{refused}");
    }

    #[test]
    fn a_changed_scene_keeps_its_mesh() {
        let mut shaped = Specification::preset();
        let mesh = SampleMesh::of_bytes(b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n".to_vec());
        shaped.sample.shape = Shape::Mesh;
        shaped.sample.mesh = Some(mesh.unwrap());
        let variables = ALL.variables(&shaped, &[5]).unwrap();
        let values = values(&variables, &vec![0.5; variables.len()], 1);
        let changed = values.apply(&shaped, &[5]).unwrap();
        assert_ne!(changed, shaped);
        let loaded = changed.sample.loaded_mesh().expect("a mesh");
        assert_eq!(loaded.mesh().triangles().len(), 1);
    }

    #[test]
    fn nothing_fitted_changes_nothing() {
        let preset = Specification::preset();
        assert!(
            Nuisances::default()
                .variables(&preset, &[5])
                .unwrap()
                .is_empty()
        );
        assert_eq!(values(&[], &[], 1).apply(&preset, &[5]).unwrap(), preset);
    }
}
