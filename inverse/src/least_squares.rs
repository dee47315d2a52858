//! A step of damped least squares inside a box.

use nalgebra::{DMatrix, DVector};

/// The least diagonal of the damping, as a share of its largest: without it directions that nothing
/// observes would take all of a step.
const DAMPING_LEAST: f64 = 1e-3;

/// The least damping of any variable: it keeps the matrix regular where nothing changes the images.
const DAMPING_MIN: f64 = 1e-12;

/// The most turns of the search for a step, for each variable. Chosen: a few in all suffice.
const TURNS_A_VARIABLE: usize = 10;

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

    /// The damped step (Marquardt 1963; Levenberg 1944 for weakly observed variables) that lowers the
    /// cost most inside a box: variables stay within their bounds, and none moves by more than its largest
    /// step.
    ///
    /// To cut a step off at the box, or to shorten it as a whole, would leave little of it: along directions
    /// that images do not tell undamped steps are far too long. So it is a quadratic program, solved by the primal
    /// active set method (Nocedal and Wright 2006, algorithm 16.3).
    pub fn step(&self, damping: f64, inside: &Region<'_>) -> DVector<f64> {
        let n = inside.at.len();
        let matrix = self.damped(damping);
        let ends: Vec<[f64; 2]> = (0..n).map(|index| inside.ends(index)).collect();
        let mut free = vec![true; n];
        let mut step = DVector::zeros(n);
        for _ in 0..TURNS_A_VARIABLE * n {
            let Some(best) = solution(&matrix, &self.gradient, &step, &free) else {
                break;
            };
            let way = &best - &step;
            let (share, blocking) = share_inside(&step, &way, &ends);
            step += way * share;
            if let Some((index, end)) = blocking {
                step[index] = end;
                free[index] = false;
                continue;
            }
            match leads_inside(&(&matrix * &step + &self.gradient), &step, &ends, &free) {
                Some(index) => free[index] = true,
                None => break,
            }
        }
        step
    }

    /// The normal matrix with damping on its diagonal.
    fn damped(&self, damping: f64) -> DMatrix<f64> {
        let diagonal = self.normal.diagonal();
        let least = DAMPING_LEAST * diagonal.max();
        let damping = diagonal.map(|square| damping * (square + least) + DAMPING_MIN);
        &self.normal + DMatrix::from_diagonal(&damping)
    }
}

impl Region<'_> {
    /// How far a variable may go down and up.
    fn ends(&self, index: usize) -> [f64; 2] {
        let ([low, high], at, most) = (self.bounds[index], self.at[index], self.step_max[index]);
        [(low - at).clamp(-most, 0.0), (high - at).clamp(0.0, most)]
    }
}

/// The step that lowers the cost most while variables that are not free stay where `step` has them; `None` where the
/// matrix holds numbers that are not finite.
fn solution(
    matrix: &DMatrix<f64>,
    gradient: &DVector<f64>,
    step: &DVector<f64>,
    free: &[bool],
) -> Option<DVector<f64>> {
    let kept: Vec<usize> = (0..free.len()).filter(|&index| free[index]).collect();
    let mut best = DVector::from_fn(free.len(), |i, _| if free[i] { 0.0 } else { step[i] });
    let slope = matrix * &best + gradient;
    let of_kept = DMatrix::from_fn(kept.len(), kept.len(), |i, j| matrix[(kept[i], kept[j])]);
    let slope_of_kept = DVector::from_fn(kept.len(), |i, _| slope[kept[i]]);
    let moved = of_kept.cholesky()?.solve(&slope_of_kept);
    for (&index, value) in kept.iter().zip(moved.iter()) {
        best[index] = -value;
    }
    Some(best)
}

/// The share of a way that stays inside, and which variable leaves first and where.
fn share_inside(
    step: &DVector<f64>,
    way: &DVector<f64>,
    ends: &[[f64; 2]],
) -> (f64, Option<(usize, f64)>) {
    let (mut share, mut blocking) = (1.0, None);
    for (index, [low, high]) in ends.iter().enumerate() {
        let end = if way[index] < 0.0 { *low } else { *high };
        let reached = (end - step[index]) / way[index];
        if way[index] != 0.0 && reached < share {
            (share, blocking) = (reached.max(0.0), Some((index, end)));
        }
    }
    (share, blocking)
}

/// Of the variables that are not free the one for which going back inside lowers the cost most.
fn leads_inside(
    slope: &DVector<f64>,
    step: &DVector<f64>,
    ends: &[[f64; 2]],
    free: &[bool],
) -> Option<usize> {
    let inward = |index: usize| match step[index] <= ends[index][0] {
        true if ends[index][0] == ends[index][1] => 0.0,
        true => -slope[index],
        false => slope[index],
    };
    let fixed = (0..free.len()).filter(|&index| !free[index] && inward(index) > 0.0);
    fixed.max_by(|&a, &b| inward(a).total_cmp(&inward(b)))
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
    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::{Rng, SeedableRng};

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
    }

    /// A step is the best of the box where no variable that is inside has a slope, and the slopes of the
    /// others lead out.
    #[test]
    fn steps_are_the_best_of_their_boxes() {
        let mut draws = ChaCha8Rng::seed_from_u64(1);
        let mut uniform = || f64::from(draws.next_u32()) / f64::from(u32::MAX);
        let (mut at_ends, mut inside) = (0, 0);
        for n in [1, 2, 10, 14].repeat(50) {
            let mut jacobian = DMatrix::from_fn(n + 3, n, |_, _| uniform() - 0.5);
            // Columns that are alike, and one that tells next to nothing.
            if n > 2 {
                let alike = jacobian.column(0) + 1e-3 * jacobian.column(1);
                jacobian.set_column(1, &alike);
                jacobian.column_mut(2).scale_mut(1e-5);
            }
            let residual = DVector::from_fn(n + 3, |_, _| 0.3 * (uniform() - 0.5));
            let at: Vec<f64> = (0..n)
                .map(|_| (1.4 * uniform() - 0.2).clamp(0.0, 1.0))
                .collect();
            let step_max: Vec<f64> = (0..n).map(|_| 0.05 + 0.5 * uniform()).collect();
            let region = Region {
                at: &at,
                bounds: &vec![[0.0, 1.0]; n],
                step_max: &step_max,
            };
            let model = Quadratic::new(&jacobian, &residual);
            let step = model.step(1e-6, &region);
            let slope = model.damped(1e-6) * &step + &model.gradient;
            for index in 0..n {
                let [low, high] = region.ends(index);
                assert!(low <= step[index] && step[index] <= high);
                let (down, up) = (step[index] > low, step[index] < high);
                inside += usize::from(down && up);
                at_ends += usize::from(!(down && up));
                assert!(!(down && slope[index] > 1e-9), "{n}: {slope}");
                assert!(!(up && slope[index] < -1e-9), "{n}: {slope}");
            }
        }
        assert!(at_ends > 100 && inside > 100, "{at_ends} {inside}");
    }

    #[test]
    fn numbers_that_are_not_finite_lead_nowhere() {
        let (mut jacobian, residual) = example();
        jacobian[(1, 1)] = f64::NAN;
        let region = Region {
            at: &[0.5, 0.5],
            bounds: &[[0.0, 1.0]; 2],
            step_max: &[1.0; 2],
        };
        let step = Quadratic::new(&jacobian, &residual).step(0.0, &region);
        assert_eq!(step, DVector::zeros(2));
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
