//! A step of damped least squares inside a box.

use nalgebra::{DMatrix, DVector};

/// The least diagonal of the damping, as a share of its largest: without it directions that nothing
/// observes would take all of a step.
const DAMPING_LEAST: f64 = 1e-3;

/// The least damping of any variable: it keeps the matrix regular where nothing changes the images.
const DAMPING_MIN: f64 = 1e-12;

/// The model `cost + 2 gradient . step + step . normal step` of a sum of squares.
pub(crate) struct Quadratic {
    pub normal: DMatrix<f64>,
    pub gradient: DVector<f64>,
}

/// Where variables are and how far they may go.
pub(crate) struct Region<'a> {
    pub at: &'a [f64],
    /// The least and the largest value of each.
    pub bounds: &'a [[f64; 2]],
    /// The largest step of each.
    pub step_max: &'a [f64],
}

impl Quadratic {
    /// The model of `|residual + jacobian step|^2`.
    pub fn new(jacobian: &DMatrix<f64>, residual: &DVector<f64>) -> Self {
        Self {
            normal: jacobian.tr_mul(jacobian),
            gradient: jacobian.tr_mul(residual),
        }
    }

    /// By how much a step lowers the cost.
    pub fn reduction(&self, step: &DVector<f64>) -> f64 {
        -(2.0 * self.gradient.dot(step) + (&self.normal * step).dot(step))
    }

    /// The damped step inside a box (Marquardt 1963; Levenberg 1944 for weakly observed variables).
    ///
    /// A variable at its bound whose step leads out stays there, and the others are solved for
    /// again. A step that is too long is shortened as a whole; what then still leaves the box is
    /// cut off.
    pub fn step(&self, damping: f64, inside: &Region<'_>) -> DVector<f64> {
        let n = inside.at.len();
        let mut free = vec![true; n];
        let mut step = DVector::zeros(n);
        // Each turn fixes a variable.
        for _ in 0..n {
            step = self.free_step(damping, &free);
            let leads_out = |index: usize| {
                let [low, high] = inside.bounds[index];
                let (at, step) = (inside.at[index], step[index]);
                (at <= low && step < 0.0) || (at >= high && step > 0.0)
            };
            let fixed: Vec<usize> = (0..n).filter(|&i| free[i] && leads_out(i)).collect();
            if fixed.is_empty() {
                break;
            }
            for index in fixed {
                free[index] = false;
            }
        }
        let lengths = step.iter().zip(inside.step_max);
        let excess = lengths
            .map(|(step, most)| step.abs() / most)
            .fold(1.0, f64::max);
        step /= excess;
        DVector::from_fn(n, |index, _| {
            let ([low, high], at) = (inside.bounds[index], inside.at[index]);
            (at + step[index]).clamp(low, high) - at
        })
    }

    /// The damped step of the free variables; 0 of the others.
    fn free_step(&self, damping: f64, free: &[bool]) -> DVector<f64> {
        let diagonal = self.normal.diagonal();
        let least = DAMPING_LEAST * diagonal.max();
        let kept: Vec<usize> = (0..free.len()).filter(|&index| free[index]).collect();
        let matrix = DMatrix::from_fn(kept.len(), kept.len(), |i, j| {
            let (row, column) = (kept[i], kept[j]);
            let damped = match i == j {
                true => damping * (diagonal[row] + least) + DAMPING_MIN,
                false => 0.0,
            };
            self.normal[(row, column)] + damped
        });
        let gradient = DVector::from_fn(kept.len(), |i, _| self.gradient[kept[i]]);
        let mut step = DVector::zeros(free.len());
        // A matrix that is not positive definite holds numbers that are not finite: no step then.
        if let Some(cholesky) = matrix.cholesky() {
            let solution = cholesky.solve(&gradient);
            for (&index, value) in kept.iter().zip(solution.iter()) {
                step[index] = -value;
            }
        }
        step
    }
}

/// Broyden's update of a Jacobian (1965, "good"): the nearest matrix that explains the residual's
/// change over a step.
pub(crate) fn broyden(jacobian: &mut DMatrix<f64>, step: &DVector<f64>, change: &DVector<f64>) {
    let square = step.norm_squared();
    if square > 0.0 {
        let missed = change - &*jacobian * step;
        jacobian.ger(1.0 / square, &missed, step, 1.0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn example() -> (DMatrix<f64>, DVector<f64>) {
        let jacobian = DMatrix::from_row_slice(3, 2, &[1.0, 0.5, 0.0, 1.0, 1.0, -1.0]);
        (jacobian, DVector::from_vec(vec![-0.2, 0.1, -0.1]))
    }

    #[test]
    fn an_undamped_step_is_the_least_squares_solution() {
        let (jacobian, residual) = example();
        let model = Quadratic::new(&jacobian, &residual);
        let free = Region {
            at: &[0.5, 0.5],
            bounds: &[[0.0, 1.0]; 2],
            step_max: &[1.0; 2],
        };
        let step = model.step(0.0, &free);
        let left = &residual + &jacobian * &step;
        assert!(jacobian.tr_mul(&left).norm() < 1e-10);
        let lowered = residual.norm_squared() - left.norm_squared();
        assert!((model.reduction(&step) - lowered).abs() < 1e-12);
        assert!(model.step(1.0, &free).norm() < step.norm());
        let short = Region {
            step_max: &[0.01, 1.0],
            ..free
        };
        let shortened = model.step(0.0, &short);
        assert!((shortened * (step[0].abs() / 0.01) - step).norm() < 1e-10);
    }

    #[test]
    fn a_variable_at_its_bound_stays_and_the_other_is_solved_for() {
        let (jacobian, residual) = example();
        let model = Quadratic::new(&jacobian, &residual);
        let cornered = Region {
            at: &[1.0, 0.5],
            bounds: &[[0.0, 1.0]; 2],
            step_max: &[1.0; 2],
        };
        let step = model.step(0.0, &cornered);
        assert_eq!(step[0], 0.0);
        let column = jacobian.column(1);
        let alone = -column.dot(&residual) / column.norm_squared();
        assert!((step[1] - alone).abs() < 1e-10);
    }

    #[test]
    fn an_update_explains_the_last_step() {
        let (mut jacobian, residual) = example();
        let step = DVector::from_vec(vec![0.3, -0.4]);
        broyden(&mut jacobian, &step, &residual);
        assert!((&jacobian * &step - &residual).norm() < 1e-14);
        let before = jacobian.clone();
        broyden(&mut jacobian, &DVector::zeros(2), &residual);
        assert_eq!(jacobian, before);
    }
}
