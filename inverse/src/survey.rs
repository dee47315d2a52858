//! What views, and sets of views, tell about a material's parameters, on a film small enough for
//! thousands of materials.

use crate::derivatives::Differentiator;
use crate::encoding::Encoding;
use crate::error::{InverseError, check_positive};
use crate::information::Information;
use crate::observation::check_views;
use dataset::specification::IntegratorKind;
use dataset::{Material, Specification};
use renderer::geometry::BackendChoice;

/// The longest side of a survey's film, in pixels. At 512 the derivatives of a view take 200 MB.
pub const SIDE_MAX: u32 = 512;

/// The relative accuracy of a survey's renderings, where the specification's is not coarser.
const RELATIVE_ACCURACY: f64 = 3e-3;

/// Their absolute accuracy in units of white, where the specification's is not coarser. It is that
/// of a pixel of a hundredth of white.
const ABSOLUTE_ACCURACY: f64 = 1e-2 * RELATIVE_ACCURACY;

/// Finds what views of materials of one specification tell about parameters.
///
/// What it finds is a function of the specification, the survey and the material: neither threads
/// nor other materials change a bit of it. The steps of the differences suit all views together, so
/// a survey of other views differs by as much as the uncertainties say.
#[derive(Debug)]
pub struct Survey {
    differentiator: Differentiator,
    views: Vec<u32>,
    sets: Vec<Vec<u32>>,
    noise_sd: f64,
}

/// What the images of a set of views tell about one material.
#[derive(Clone, Debug, PartialEq)]
pub struct Surveyed {
    /// The views.
    pub views: Vec<u32>,
    /// For each encoding, in the order of [`Encoding::ALL`].
    pub findings: [Finding; Encoding::ALL.len()],
}

/// What encoded images tell about the ten parameters, in the order of [`crate::NAMES`].
#[derive(Clone, Debug, PartialEq)]
pub struct Finding {
    /// J'J for noise of unit variance.
    pub information: Information,
    /// The Cramer-Rao bounds, in ranges of the parameters; infinite where nothing observes one. That
    /// of a set can be infinite where a view's is not, because uncertainties add up.
    pub bounds: Vec<f64>,
    /// The observable weights, 0 to 1.
    pub weights: Vec<f64>,
}

/// The same scene on a film whose longer side has `side` pixels, at the accuracy of a survey: 3e-3 of
/// a pixel or 3e-5 of white, or that of the specification where it is coarser. Always by the
/// hybrid integrator, because derivatives need images whose errors are far below the noise of sampled
/// paths.
///
/// # Errors
/// When `side` is 0 or more than [`SIDE_MAX`].
pub fn small(specification: &Specification, side: u32) -> Result<Specification, InverseError> {
    if !(1..=SIDE_MAX).contains(&side) {
        let most = SIDE_MAX;
        return Err(InverseError::Side { side, most });
    }
    let mut small = specification.clone();
    let longer = small.image.width.max(small.image.height).max(1);
    let scaled = |pixels: u32| ((side * pixels + longer / 2) / longer).max(1);
    small.image.width = scaled(specification.image.width);
    small.image.height = scaled(specification.image.height);
    small.accuracy.relative = small.accuracy.relative.max(RELATIVE_ACCURACY);
    small.accuracy.absolute = small.accuracy.absolute.max(ABSOLUTE_ACCURACY);
    small.integrator.kind = IntegratorKind::Hybrid;
    Ok(small)
}

impl Survey {
    /// Prepares to survey each of `views` and each of `sets`, with bounds and weights for noise of
    /// standard deviation `noise_sd` in each encoded channel. The film is that of `specification`: see
    /// [`small`].
    ///
    /// # Errors
    /// When a view does not exist or comes twice, a set is empty or has a view that is not among
    /// `views`, `noise_sd` is not finite and above 0, or the renderer refuses.
    pub fn new(
        specification: &Specification,
        views: Vec<u32>,
        sets: Vec<Vec<u32>>,
        noise_sd: f64,
    ) -> Result<Self, InverseError> {
        check_positive("noise_sd", noise_sd)?;
        check_views(specification, &views)?;
        for set in &sets {
            check_views(specification, set)?;
            if let Some(&view) = set.iter().find(|view| !views.contains(view)) {
                return Err(InverseError::NotSurveyed { view });
            }
        }
        Ok(Self {
            differentiator: Differentiator::new(specification, BackendChoice::Native)?,
            views,
            sets,
            noise_sd,
        })
    }

    /// Surveys a material: every view, then every set, in order.
    ///
    /// # Errors
    /// When a parameter lies outside the model, or the renderer refuses.
    pub fn material(&self, material: &Material) -> Result<Vec<Surveyed>, InverseError> {
        let derivatives = self.differentiator.views(material, &self.views)?;
        let by_view: Vec<[Information; 3]> = derivatives
            .iter()
            .map(|view| Encoding::ALL.map(|encoding| Information::of_view(view, encoding)))
            .collect();
        let single = self.views.iter().map(std::slice::from_ref);
        let sets = single.chain(self.sets.iter().map(Vec::as_slice));
        sets.map(|set| self.surveyed(set, &by_view)).collect()
    }

    /// Adds the information of a set's views up.
    fn surveyed(
        &self,
        set: &[u32],
        by_view: &[[Information; 3]],
    ) -> Result<Surveyed, InverseError> {
        let chosen = || {
            let pairs = self.views.iter().zip(by_view);
            pairs.filter_map(|(view, information)| set.contains(view).then_some(information))
        };
        let finding = |encoding: usize| {
            let parts = chosen().map(|information| &information[encoding]);
            let information = Information::sum(parts).ok_or(InverseError::NoViews)?;
            Ok::<_, InverseError>(Finding {
                bounds: information.bounds(self.noise_sd)?,
                weights: information.weights(self.noise_sd),
                information,
            })
        };
        Ok(Surveyed {
            views: set.to_vec(),
            findings: [finding(0)?, finding(1)?, finding(2)?],
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::information::WEIGHT_NOISE_SD;

    const NOISE_SD: f64 = 0.01;

    fn survey(views: &[u32], sets: &[&[u32]]) -> Result<Survey, InverseError> {
        let specification = small(&Specification::preset(), 6).unwrap();
        let sets = sets.iter().map(|set| set.to_vec()).collect();
        Survey::new(&specification, views.to_vec(), sets, NOISE_SD)
    }

    #[test]
    fn a_set_tells_the_sum_of_its_views() {
        let sampled = Specification::preset().material(2);
        let found = survey(&[10, 12, 13], &[&[10, 13], &[10, 12, 13]]).unwrap();
        let found = found.material(&sampled.material).unwrap();
        let views: Vec<&[u32]> = found.iter().map(|row| row.views.as_slice()).collect();
        let expected: [&[u32]; 5] = [&[10], &[12], &[13], &[10, 13], &[10, 12, 13]];
        assert_eq!(views, expected);
        for encoding in 0..Encoding::ALL.len() {
            let finding = |row: usize| &found[row].findings[encoding];
            let [a, b, c] = [0, 1, 2].map(|row| &finding(row).information);
            assert_eq!(finding(3).information.matrix(), &(a.matrix() + c.matrix()));
            let all = &finding(4).information;
            assert_eq!(all.matrix(), &(a.matrix() + b.matrix() + c.matrix()));
            for parameter in 0..10 {
                let parts = [a, b, c].map(|part| part.uncertainties()[parameter]);
                let root = parts.iter().map(|part| part * part).sum::<f64>().sqrt();
                assert!((all.uncertainties()[parameter] - root).abs() <= 1e-12 * root);
            }
            assert!(all.matrix().diagonal().max() > 0.0);
        }
    }

    #[test]
    fn bounds_and_weights_are_those_of_the_information() {
        let sampled = Specification::preset().material(3);
        let found = survey(&[11, 12], &[&[11, 12]]).unwrap();
        for row in found.material(&sampled.material).unwrap() {
            for Finding {
                information,
                bounds,
                weights,
            } in row.findings
            {
                assert_eq!(information.bounds(NOISE_SD).unwrap(), bounds);
                assert_eq!(information.weights(NOISE_SD), weights);
                assert!(weights.iter().all(|weight| (0.0..=1.0).contains(weight)));
                let of_codes = information.observable_weights();
                assert_eq!(information.weights(WEIGHT_NOISE_SD), of_codes);
            }
        }
    }

    #[test]
    fn what_cannot_be_surveyed_is_named() {
        let refusal = |views: &[u32], sets: &[&[u32]]| match survey(views, sets) {
            Ok(_) => String::new(),
            Err(error) => error.to_string(),
        };
        assert_eq!(refusal(&[5, 8], &[&[5, 8]]), "");
        assert!(refusal(&[], &[]).contains("no view"));
        assert!(refusal(&[5], &[&[]]).contains("no view"));
        assert!(refusal(&[14], &[]).contains("no view 14"));
        assert!(refusal(&[5, 8], &[&[5, 5]]).contains("twice"));
        assert!(refusal(&[5, 8], &[&[5, 9]]).contains("view 9 is in a set"));
        let preset = Specification::preset();
        assert!(Survey::new(&preset, vec![5], vec![], 0.0).is_err());
        for side in [0, SIDE_MAX + 1, u32::MAX] {
            assert!(small(&preset, side).is_err());
        }
    }

    #[test]
    fn a_small_film_keeps_the_shape_and_the_coarser_accuracy() {
        let mut wide = Specification::preset();
        (wide.image.width, wide.image.height) = (400, 100);
        wide.accuracy.absolute = 1e-2;
        let film = small(&wide, 32).unwrap();
        assert_eq!((film.image.width, film.image.height), (32, 8));
        assert_eq!(film.accuracy.absolute, 1e-2);
        assert_eq!(film.accuracy.relative, RELATIVE_ACCURACY);
        (wide.image.width, wide.image.height) = (1, 4096);
        let film = small(&wide, 16).unwrap();
        assert_eq!((film.image.width, film.image.height), (1, 16));
    }
}
