//! What views tell about parameters: J'J, Cramer-Rao bounds, observable weights.

use crate::derivatives::ViewDerivatives;
use crate::encoding::Encoding;
use crate::error::{InverseError, check_positive};
use crate::parameters::PARAMETERS;
use nalgebra::{DMatrix, DVector, SymmetricEigen};

/// The noise that observable weights are for: two steps of an 8-bit code.
pub const WEIGHT_NOISE_SD: f64 = 2.0 / 255.0;

/// One over the variance of a parameter that is uniform over its range.
const UNIFORM_PRECISION: f64 = 12.0;

/// The norm of what a derivative is off by, as a multiple of the norm of what its two steps differ
/// by. Renderings whose errors are independent give 1.2; three is a margin of 2.5.
const ERROR_PER_DISAGREEMENT: f64 = 3.0;

/// A parameter is not observed if its component of a unit direction that is not observed exceeds the
/// root of this, 0.03. Such directions are known to about the uncertainty of one column over the length
/// of another, which is less for parameters that images show well.
const UNOBSERVED_SHARE: f64 = 1e-3;

/// The most that images tell about a parameter, as the inverse of a variance.
const PRECISION_RANGE: f64 = 1e14;

/// Rounding of a sum of squares, as a share of it.
const ROUNDING: f64 = 1e-12;

/// The information that images hold about their parameters, for noise of unit variance in each
/// encoded channel: J'J, n x n, and how well each column of J is known.
///
/// The first ten parameters are a material's, in the order of [`crate::NAMES`]. Others, of a fit
/// with nuisance parameters, may follow.
#[derive(Clone, Debug, PartialEq)]
pub struct Information {
    matrix: DMatrix<f64>,
    /// Bounds of the norm of each column's error. Infinite for a column that does not exist.
    uncertainties: Vec<f64>,
}

impl Information {
    /// The information of one view about the ten parameters.
    pub fn of_view(derivatives: &ViewDerivatives, encoding: Encoding) -> Self {
        Self::of_fit(std::slice::from_ref(derivatives), encoding, &[])
    }

    /// The information of all views together about the ten parameters and about others, whose
    /// columns of J are given.
    pub(crate) fn of_fit(
        views: &[ViewDerivatives],
        encoding: Encoding,
        others: &[DVector<f64>],
    ) -> Self {
        let mut columns = Vec::new();
        let mut uncertainties = Vec::new();
        for parameter in 0..PARAMETERS {
            let pairs = views
                .iter()
                .flat_map(|view| view.encoded(parameter, encoding));
            let (column, squares): (Vec<f64>, Vec<f64>) = pairs
                .map(|[value, disagreement]| (value, disagreement * disagreement))
                .unzip();
            columns.push(DVector::from_vec(column));
            uncertainties.push(ERROR_PER_DISAGREEMENT * squares.iter().sum::<f64>().sqrt());
        }
        columns.extend_from_slice(others);
        uncertainties.resize(columns.len(), 0.0);
        Self::of_columns(&columns, uncertainties)
    }

    /// The information of the columns of J, with bounds of the norms of their errors.
    pub(crate) fn of_columns(columns: &[DVector<f64>], uncertainties: Vec<f64>) -> Self {
        let n = columns.len();
        let matrix = DMatrix::from_fn(n, n, |i, j| columns[i].dot(&columns[j]));
        Self {
            matrix,
            uncertainties,
        }
    }

    /// The sum over views of the same parameters: information of independent noise adds up. `None`
    /// without any, or where the numbers of parameters differ.
    pub fn sum<'a>(views: impl IntoIterator<Item = &'a Self>) -> Option<Self> {
        let mut views = views.into_iter();
        let mut total = views.next()?.clone();
        for view in views {
            if view.matrix.shape() != total.matrix.shape() {
                return None;
            }
            total.matrix += &view.matrix;
            let pairs = total.uncertainties.iter_mut().zip(&view.uncertainties);
            for (sum, uncertainty) in pairs {
                *sum = libm::hypot(*sum, *uncertainty);
            }
        }
        Some(total)
    }

    /// J'J, n x n, symmetric.
    pub fn matrix(&self) -> &DMatrix<f64> {
        &self.matrix
    }

    /// Bounds of the norm of each column's error: of J's columns, in codes over the parameter's range.
    /// Infinite for a column that does not exist.
    pub fn uncertainties(&self) -> &[f64] {
        &self.uncertainties
    }

    /// By how much the images change along a direction, and how far that may be off: the norm of
    /// J d, and the sum of the columns' uncertainties.
    ///
    /// A direction that has fewer components than there are parameters is 0 in the others.
    pub fn change_along(&self, direction: &[f64]) -> [f64; 2] {
        let n = self.uncertainties.len();
        let component = |index: usize| direction.get(index).copied().unwrap_or(0.0);
        let d = DVector::from_fn(n, |index, _| component(index));
        let squared = (&self.matrix * &d).dot(&d);
        let terms = self.uncertainties.iter().enumerate();
        let unsure = terms.map(|(index, uncertainty)| match component(index) {
            0.0 => 0.0,
            along => along.abs() * uncertainty,
        });
        [squared.max(0.0).sqrt(), unsure.sum()]
    }

    /// The Cramer-Rao bound of each parameter, for noise of standard deviation `noise_sd` in each
    /// encoded channel: the least standard deviation of an unbiased estimate, all others being
    /// unknown too. In the order of the parameters; units are ranges.
    ///
    /// It is the root of the diagonal of the inverse of J'J, times `noise_sd`. Some directions change
    /// the images by no more than the derivatives may be off by. The bound of a parameter that they
    /// lead along is infinite. For the other parameters the inverse counts these directions as if they
    /// changed the images by just that much. So where both are finite, the bound of a sum exceeds that
    /// of a part by a factor of the root of 2 at most.
    ///
    /// # Errors
    /// When `noise_sd` is not finite and above 0.
    pub fn bounds(&self, noise_sd: f64) -> Result<Vec<f64>, InverseError> {
        check_positive("noise_sd", noise_sd)?;
        let Some(observed) = Observed::of(self) else {
            return Ok(vec![f64::INFINITY; self.uncertainties.len()]);
        };
        let variances = observed.variances();
        Ok(variances
            .map(|variance| noise_sd * variance.sqrt())
            .collect())
    }

    /// The covariance of the parameters after images with noise of standard deviation
    /// `noise_sd` were seen, where each of the ten was uniform over its range before, and each nuisance
    /// parameter normal with variance 1; to second order about the solution. In the order of the
    /// parameters; units are ranges.
    ///
    /// It is `(J'J/noise_sd^2 + P)^-1`, where P is the diagonal of the priors' inverse variances, 12
    /// for the ten. In J'J directions that change the images by no more than the derivatives may be
    /// off by count as not observed at all. It is finite: what nothing observes has the prior's
    /// variance, 1/12. No parameter counts as known better than to 1e-7 of its range.
    ///
    /// # Errors
    /// When `noise_sd` is not finite and above 0.
    pub fn posterior_covariance(&self, noise_sd: f64) -> Result<DMatrix<f64>, InverseError> {
        check_positive("noise_sd", noise_sd)?;
        let n = self.uncertainties.len();
        // Priors come after the cut: what images do not show, a prior may.
        let mut precision = DMatrix::from_fn(n, n, |i, j| match i == j {
            true if i < PARAMETERS => UNIFORM_PRECISION,
            true => 1.0,
            false => 0.0,
        });
        if let Some(observed) = Observed::of(self) {
            let information = observed.matrix();
            // Less noise would drown the priors in rounding.
            let least = information.diagonal().max() / PRECISION_RANGE;
            precision += information / (noise_sd * noise_sd).max(least);
        }
        let Some(cholesky) = precision.cholesky() else {
            unreachable!("priors make it positive definite");
        };
        Ok(cholesky.inverse())
    }

    /// The observable weight of each parameter, in 0 to 1: by how much the images, with noise of
    /// [`WEIGHT_NOISE_SD`], narrow a uniform prior over its range. `1 - 12 [(J'J/s^2 + 12 I)^-1]_ii`.
    pub fn observable_weights(&self) -> Vec<f64> {
        self.weights(WEIGHT_NOISE_SD)
    }

    /// The same for noise of standard deviation `noise_sd`, which is finite and above 0.
    pub(crate) fn weights(&self, noise_sd: f64) -> Vec<f64> {
        let n = self.uncertainties.len();
        let precision = 1.0 / (noise_sd * noise_sd);
        let posterior = &self.matrix * precision + DMatrix::identity(n, n) * UNIFORM_PRECISION;
        match posterior.cholesky() {
            Some(cholesky) => {
                let covariance = cholesky.inverse();
                (0..n)
                    .map(|i| (1.0 - UNIFORM_PRECISION * covariance[(i, i)]).clamp(0.0, 1.0))
                    .collect()
            }
            // Only numbers that are not finite get here.
            None => vec![0.0; n],
        }
    }
}

/// The directions of parameters, split into those that images observe and those that they do not.
///
/// Each column of J is divided by its uncertainty. A unit direction whose change of the images is
/// then no longer than 1 could be all error: it is not observed.
struct Observed {
    eigen: SymmetricEigen<f64, nalgebra::Dyn>,
    /// What columns were divided by. Infinite for one that does not exist.
    scales: Vec<f64>,
}

impl Observed {
    /// `None` where the images depend on nothing.
    fn of(information: &Information) -> Option<Self> {
        let Information {
            matrix,
            uncertainties,
        } = information;
        let largest = matrix.diagonal().max();
        if !(largest > 0.0 && largest.is_finite()) {
            return None;
        }
        let least = (ROUNDING * largest).sqrt();
        let scales = uncertainties.iter().map(|scale| scale.max(least));
        let scales: Vec<f64> = scales.collect();
        let scaled = matrix.map_with_location(|i, j, value| value / (scales[i] * scales[j]));
        Some(Self {
            eigen: SymmetricEigen::new(scaled),
            scales,
        })
    }

    /// The information along the directions that are observed.
    fn matrix(&self) -> DMatrix<f64> {
        let n = self.scales.len();
        let mut matrix = DMatrix::zeros(n, n);
        for (index, &squared) in self.eigen.eigenvalues.iter().enumerate() {
            if squared > 1.0 {
                let vector = self.eigen.eigenvectors.column(index);
                let gradient = DVector::from_fn(n, |i, _| match self.scales[i].is_finite() {
                    true => self.scales[i] * vector[i],
                    false => 0.0,
                });
                matrix.ger(squared, &gradient, &gradient, 1.0);
            }
        }
        matrix
    }

    /// The variance of each parameter for noise of unit variance, infinite where a direction that is
    /// not observed leads along it.
    fn variances(&self) -> impl Iterator<Item = f64> {
        let mut variances = vec![0.0; self.scales.len()];
        for (index, &squared) in self.eigen.eigenvalues.iter().enumerate() {
            let vector = self.eigen.eigenvectors.column(index);
            let components = vector.iter().zip(&self.scales);
            let direction: Vec<f64> = components.map(|(along, scale)| along / scale).collect();
            let length2: f64 = direction.iter().map(|along| along * along).sum();
            for (variance, along) in variances.iter_mut().zip(&direction) {
                let along2 = along * along;
                *variance += along2 / squared.max(1.0);
                if squared <= 1.0 && along2 > UNOBSERVED_SHARE * length2 {
                    *variance = f64::INFINITY;
                }
            }
        }
        let scales = self.scales.iter();
        scales
            .zip(variances)
            .map(|(scale, variance)| match scale.is_finite() {
                true => variance,
                false => f64::INFINITY,
            })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn information(columns: &[&[f64]], uncertainty: f64) -> Information {
        let vectors: Vec<_> = columns
            .iter()
            .map(|column| DVector::from_column_slice(column))
            .collect();
        Information::of_columns(&vectors, vec![uncertainty; columns.len()])
    }

    #[test]
    fn bounds_are_roots_of_the_inverse() {
        let two = information(&[&[2.0, 0.0, 0.0], &[1.0, 1.0, 0.0]], 0.0);
        // J'J = [[4, 2], [2, 2]], its inverse [[1/2, -1/2], [-1/2, 1]].
        let bounds = two.bounds(3.0).unwrap();
        assert!((bounds[0] - 3.0 * 0.5f64.sqrt()).abs() < 1e-12);
        assert!((bounds[1] - 3.0).abs() < 1e-12);
        assert!(two.bounds(0.0).is_err() && two.bounds(f64::NAN).is_err());
        let more = Information::sum([&two, &two, &two, &two]).unwrap();
        assert!((more.bounds(3.0).unwrap()[1] - 1.5).abs() < 1e-12);
    }

    #[test]
    fn what_nothing_observes_has_an_infinite_bound_and_no_weight() {
        // The third column is the sum of the first two, the last is zero, the fourth is separate.
        let columns: [&[f64]; 5] = [
            &[1.0, 0.3, 0.2, 0.0],
            &[0.1, 0.7, 0.9, 0.0],
            &[1.1, 1.0, 1.1, 0.0],
            &[0.0, 0.0, 0.0, 0.5],
            &[0.0, 0.0, 0.0, 0.0],
        ];
        for uncertainty in [0.0, 1e-9, 1e-3] {
            let dependent = information(&columns, uncertainty);
            let bounds = dependent.bounds(0.01).unwrap();
            for (index, bound) in bounds.iter().enumerate() {
                assert_eq!(bound.is_finite(), index == 3, "{index}: {bound}");
            }
            assert!((bounds[3] - 0.02).abs() < 1e-12);
        }
        let weights = information(&columns, 0.0).observable_weights();
        assert!(weights[4] < 1e-12 && weights[3] > 0.99);
        assert!(weights[2] > 0.2 && weights[2] < 0.9, "{weights:?}");
        let (d, none) = ([1.0, 1.0, -1.0], information(&columns, 1e-3));
        let [change, unsure] = none.change_along(&d);
        assert!(change < 1e-7 && (unsure - 3e-3).abs() < 1e-12);
    }

    #[test]
    fn after_the_images_a_parameter_is_known_as_well_as_they_or_its_range_tell() {
        let prior = (1.0_f64 / 12.0).sqrt();
        // Both alone in one direction, the third seen by nothing.
        let columns: [&[f64]; 3] = [&[1.0, 0.0], &[0.5, 0.0], &[0.0, 0.0]];
        let deviations = |information: &Information, noise_sd: f64| -> Vec<f64> {
            let covariance = information.posterior_covariance(noise_sd).unwrap();
            covariance
                .diagonal()
                .iter()
                .map(|variance| variance.sqrt())
                .collect()
        };
        let found = deviations(&information(&columns, 1e-6), 1e-4);
        // Of x + y/2 all is known: what is left is the prior along the line, (1, -2)/root 5.
        assert!(
            (found[0] - prior * (1.0_f64 / 5.0).sqrt()).abs() < 1e-6,
            "{found:?}"
        );
        assert!((found[1] - prior * (4.0_f64 / 5.0).sqrt()).abs() < 1e-6);
        assert!((found[2] - prior).abs() < 1e-12);
        let one = deviations(&information(&[&[2.0]], 0.0), 0.1);
        assert!((one[0] - (1.0 / (400.0 + 12.0_f64)).sqrt()).abs() < 1e-12);
        // What could be all error is no information.
        let error = deviations(&information(&[&[2.0]], 3.0), 0.1);
        assert!((error[0] - prior).abs() < 1e-12);
        let sure = deviations(&information(&columns, 1e-9), 1e-300);
        assert!((sure[0] - found[0]).abs() < 1e-6 && (sure[2] - prior).abs() < 1e-12);
        assert!(
            information(&columns, 0.0)
                .posterior_covariance(0.0)
                .is_err()
        );
    }

    #[test]
    fn more_images_do_not_widen_a_finite_bound() {
        // The first images cannot tell a change of the second parameter from an error, and 2 percent of
        // such a change looks like one of the first parameter. The second images can tell.
        let part = information(&[&[1.0, 0.0], &[0.02, 0.0]], 1e-3);
        let other = information(&[&[0.0, 0.0], &[0.0, 2e-3]], 1e-3);
        let all = Information::sum([&part, &other]).unwrap();
        let [alone, together] = [&part, &all].map(|images| images.bounds(0.01).unwrap());
        assert!(alone[0].is_finite() && alone[1].is_infinite(), "{alone:?}");
        assert!(together[1].is_finite(), "{together:?}");
        assert!(
            together[0] <= 2f64.sqrt() * alone[0],
            "{together:?}, {alone:?}"
        );
    }

    #[test]
    fn a_column_that_does_not_exist_is_unobserved_and_leaves_the_others() {
        let vectors = [DVector::from_vec(vec![1.0, 0.0]), DVector::zeros(2)];
        let partly = Information::of_columns(&vectors, vec![0.0, f64::INFINITY]);
        let bounds = partly.bounds(1.0).unwrap();
        assert_eq!(bounds, [1.0, f64::INFINITY]);
    }
}
