//! What the measurements say: medians a setting, slopes, times to an error, stages.

use crate::comparison::Comparison;
use crate::plan::Setting;
use crate::statistics::{LogHistogram, Spread, quantile, slope, sorted};
use crate::survey::Measurement;
use dataset::specification::IntegratorKind;

/// Spreads are given between this quantile and one minus it.
pub const SPREAD_SHARE: f64 = 0.1;

/// A quantity that is summarised.
pub type Quantity = fn(&Measurement) -> f64;

/// Processor seconds of a rendering.
pub fn cpu_seconds(one: &Measurement) -> f64 {
    one.cost.cpu_seconds
}

/// Mean relative error of a rendering.
pub fn mean_error(one: &Measurement) -> f64 {
    one.comparison.mean_relative_error
}

/// The brightness of a view, in units of white, below which nothing is to be seen in it: the
/// preset's absolute accuracy. Such a view is right at once, and says nothing of speed.
pub const DARK: f64 = 1e-4;

/// Whether anything is to be seen in the view.
pub fn is_lit(one: &Measurement) -> bool {
    one.comparison.reference_brightest > DARK
}

/// The settings of an integrator, in the order of the plan.
pub fn settings(settings: &[Setting], kind: IntegratorKind) -> Vec<Setting> {
    settings
        .iter()
        .copied()
        .filter(|setting| setting.integrator() == kind)
        .collect()
}

/// The lit renderings at a setting.
pub fn lit(measurements: &[Measurement], setting: Setting) -> impl Iterator<Item = &Measurement> {
    measurements
        .iter()
        .filter(move |one| one.setting == setting && is_lit(one))
}

/// The spread of a quantity over materials and views at a setting.
pub fn spread(
    measurements: &[Measurement],
    setting: Setting,
    quantity: Quantity,
) -> Option<Spread> {
    Spread::new(lit(measurements, setting).map(quantity), SPREAD_SHARE)
}

/// The renderings of each material and view by an integrator, in the order of the plan: a ladder
/// a cell.
pub fn ladders(measurements: &[Measurement], kind: IntegratorKind) -> Vec<Vec<&Measurement>> {
    let mut ladders: Vec<Vec<&Measurement>> = Vec::new();
    let of_kind = |one: &&Measurement| one.setting.integrator() == kind && is_lit(one);
    for one in measurements.iter().filter(of_kind) {
        match ladders.last_mut() {
            Some(ladder) if (ladder[0].material, ladder[0].view) == (one.material, one.view) => {
                ladder.push(one);
            }
            _ => ladders.push(vec![one]),
        }
    }
    ladders
}

/// The slopes of log error over log `abscissa`, one a ladder.
pub fn slopes(ladders: &[Vec<&Measurement>], abscissa: Quantity) -> Vec<f64> {
    ladders
        .iter()
        .filter_map(|ladder| {
            let points: Vec<_> = ladder
                .iter()
                .filter(|one| mean_error(one) > 0.0)
                .map(|one| [libm::log10(abscissa(one)), libm::log10(mean_error(one))])
                .collect();
            slope(&points)
        })
        .collect()
}

/// Processor seconds until the mean relative error is `error`, between the rungs of a ladder in
/// proportion of logarithms; infinite where no rung reaches it.
pub fn seconds_to(ladder: &[&Measurement], error: f64) -> f64 {
    let reached = |one: &&Measurement| mean_error(one) <= error;
    let Some(place) = ladder.iter().position(reached) else {
        return f64::INFINITY;
    };
    let there = ladder[place];
    let before = place.checked_sub(1).map(|place| ladder[place]);
    match before {
        Some(before) if mean_error(there) > 0.0 => {
            let log = |one: &Measurement| libm::log(mean_error(one));
            let part = (log(before) - libm::log(error)) / (log(before) - log(there));
            let [from, to] = [before, there].map(|one| libm::log(cpu_seconds(one)));
            libm::exp(from + part * (to - from))
        }
        _ => cpu_seconds(there),
    }
}

/// What it takes to come to a mean relative error.
#[derive(Clone, Debug, PartialEq)]
pub struct Race {
    /// Median processor seconds of each integrator; infinite where most cells do not get there.
    pub median_seconds: [f64; 2],
    /// How many cells get there.
    pub reached: [usize; 2],
    /// How many times longer the path tracer takes: least, median and largest over the cells that
    /// the hybrid integrator brings there.
    pub factors: Option<[Factor; 3]>,
}

/// A ratio of times.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Factor {
    /// How many times longer.
    pub times: f64,
    /// Whether it is at least that: somewhere the path tracer does not get there, and the time of
    /// its last rung stands for what it would take.
    pub at_least: bool,
}

/// Compares the integrators' ladders at an error. Both have the same cells in the same order, since
/// whether a cell is lit is the reference's to say.
pub fn race(hybrid: &[Vec<&Measurement>], path: &[Vec<&Measurement>], error: f64) -> Race {
    let seconds = [hybrid, path].map(|ladders| -> Vec<f64> {
        let each = ladders.iter().map(|ladder| seconds_to(ladder, error));
        each.collect()
    });
    let mut factors: Vec<Factor> = seconds[0]
        .iter()
        .zip(path.iter().zip(&seconds[1]))
        .filter(|(hybrid, _)| hybrid.is_finite())
        .map(|(hybrid, (ladder, path))| {
            let spent = ladder
                .iter()
                .map(|one| cpu_seconds(one))
                .fold(0.0, f64::max);
            Factor {
                times: path.min(spent) / hybrid,
                at_least: path.is_infinite(),
            }
        })
        .collect();
    factors.sort_by(|a, b| a.times.total_cmp(&b.times));
    let times: Vec<f64> = factors.iter().map(|factor| factor.times).collect();
    // A quantile of lower bounds is a lower bound of the quantile.
    let at_least = factors.iter().any(|factor| factor.at_least);
    let quantile_of = |share| quantile(&times, share).map(|times| Factor { times, at_least });
    Race {
        median_seconds: seconds
            .each_ref()
            .map(|all| quantile(&sorted(all.iter().copied()), 0.5).unwrap_or(f64::INFINITY)),
        reached: seconds
            .each_ref()
            .map(|all| all.iter().filter(|one| one.is_finite()).count()),
        factors: factors
            .first()
            .copied()
            .zip(quantile_of(0.5))
            .zip(quantile_of(1.0))
            .map(|((least, median), largest)| [least, median, largest]),
    }
}

/// How the stated errors of a setting bear out, over all its pixels.
#[derive(Clone, Debug, PartialEq)]
pub struct Calibration {
    /// Pixels compared.
    pub pixels: usize,
    /// Share within the stated error.
    pub within_bound: f64,
    /// Share that meets the target.
    pub within_target: f64,
    /// True over stated error.
    pub ratios: LogHistogram,
    /// Renderings whose reference is less than three times finer, by 95th percentiles of what both
    /// state.
    pub coarse_references: usize,
}

/// Over all pixels of all renderings at a setting; `None` without pixels.
pub fn calibration(measurements: &[Measurement], setting: Setting) -> Option<Calibration> {
    let mut pooled = Calibration {
        pixels: 0,
        within_bound: 0.0,
        within_target: 0.0,
        ratios: LogHistogram::new(),
        coarse_references: 0,
    };
    for one in lit(measurements, setting) {
        let Comparison {
            pixels,
            within_bound,
            within_target,
            ratios,
            stated_p95_relative_error,
            reference_p95_relative_error,
            ..
        } = &one.comparison;
        pooled.pixels += pixels;
        pooled.within_bound += within_bound * *pixels as f64;
        pooled.within_target += within_target * *pixels as f64;
        pooled.ratios.merge(ratios);
        let coarse = 3.0 * reference_p95_relative_error > *stated_p95_relative_error;
        pooled.coarse_references += usize::from(coarse);
    }
    let pixels = pooled.pixels as f64;
    pooled.within_bound /= pixels;
    pooled.within_target /= pixels;
    (pooled.pixels > 0).then_some(pooled)
}

/// Mean seconds over materials of each stage, in the order in which they run, for each view at a
/// setting.
pub fn stages(
    measurements: &[Measurement],
    setting: Setting,
    views: &[u32],
) -> Vec<(u32, Vec<(&'static str, f64)>)> {
    views
        .iter()
        .map(|&view| {
            let here: Vec<_> = measurements
                .iter()
                .filter(|one| one.view == view && one.setting == setting)
                .collect();
            let mut sums: Vec<(&'static str, f64)> = Vec::new();
            for stage in here.iter().flat_map(|one| &one.phases) {
                let seconds = stage.seconds / here.len() as f64;
                match sums.iter_mut().find(|(name, _)| *name == stage.name) {
                    Some((_, sum)) => *sum += seconds,
                    None => sums.push((stage.name, seconds)),
                }
            }
            (view, sums)
        })
        .collect()
}

/// The names of all stages that `stages` has, in the order in which they run.
pub fn stage_names(stages: &[(u32, Vec<(&'static str, f64)>)]) -> Vec<&'static str> {
    let longest = stages.iter().max_by_key(|(_, parts)| parts.len());
    longest.map_or_else(Vec::new, |(_, parts)| {
        parts.iter().map(|(name, _)| *name).collect()
    })
}

/// The rung at which tables of one setting are given: the preset's accuracy where the plan has it,
/// the middle of the ladder elsewhere.
pub fn usual(settings: &[Setting]) -> Option<Setting> {
    const PRESET: Setting = Setting::Accuracy(1e-3);
    let there = settings.contains(&PRESET).then_some(PRESET);
    there.or_else(|| settings.get(settings.len() / 2).copied())
}

#[cfg(test)]
pub mod tests {
    use super::*;
    use crate::survey::Cost;
    use dataset::ErrorStatistics;

    /// A rendering of a cell with this cost and mean error.
    pub fn measured(material: usize, setting: Setting, seconds: f64, error: f64) -> Measurement {
        Measurement {
            material,
            view: 0,
            setting,
            cost: Cost {
                wall_seconds: seconds,
                cpu_seconds: seconds,
            },
            stated: ErrorStatistics {
                mean: 0.0,
                p95: 0.0,
                max: 0.0,
                within_target: 1.0,
                samples: 0,
                evaluations: 0,
            },
            comparison: Comparison {
                pixels: 1,
                reference_brightest: 1.0,
                relative_mse: 0.0,
                smape: 0.0,
                mean_difference: 0.0,
                mean_relative_error: error,
                p95_relative_error: error,
                stated_mean_relative_error: error,
                stated_p95_relative_error: error,
                reference_p95_relative_error: 0.0,
                within_bound: 1.0,
                within_target: 0.5,
                ratios: LogHistogram::new(),
            },
            phases: Vec::new(),
        }
    }

    #[test]
    fn a_time_to_an_error_lies_between_the_rungs() {
        let ladder = [(1.0, 1e-1), (100.0, 1e-3), (200.0, 0.0)]
            .map(|(seconds, error)| measured(0, Setting::Samples(16), seconds, error));
        let ladder: Vec<_> = ladder.iter().collect();
        let close = |found: f64, expected: f64| assert!((found / expected - 1.0).abs() < 1e-12);
        close(seconds_to(&ladder, 1e-2), 10.0);
        close(seconds_to(&ladder, 1e-3), 100.0);
        // Cheaper than the first rung cannot be told, nor where between the last two.
        close(seconds_to(&ladder, 0.5), 1.0);
        close(seconds_to(&ladder, 1e-4), 200.0);
        assert_eq!(seconds_to(&ladder[..2], 1e-4), f64::INFINITY);
    }

    #[test]
    fn a_race_counts_who_gets_there() {
        let hybrid = [
            measured(0, Setting::Accuracy(1e-3), 1.0, 1e-4),
            measured(1, Setting::Accuracy(1e-3), 2.0, 1e-4),
        ];
        let path = [
            measured(0, Setting::Samples(16), 10.0, 1e-4),
            measured(1, Setting::Samples(16), 10.0, 1e-2),
        ];
        let [hybrid, path] = [&hybrid, &path].map(|all| {
            let each = all.iter().map(|one| vec![one]);
            each.collect::<Vec<_>>()
        });
        let race = race(&hybrid, &path, 1e-3);
        assert_eq!(race.reached, [2, 1]);
        assert_eq!(race.median_seconds[0], 1.5);
        // The second cell's path tracer spends 10 s and does not get there.
        let [least, median, largest] = race.factors.unwrap();
        let factor = |times, at_least| Factor { times, at_least };
        assert_eq!(least, factor(5.0, true));
        assert_eq!(median, factor(7.5, true));
        assert_eq!(largest, factor(10.0, true));
    }

    #[test]
    fn ladders_are_cut_where_the_cell_changes() {
        let all = [
            measured(0, Setting::Samples(16), 1.0, 1e-1),
            measured(0, Setting::Accuracy(1e-2), 1.0, 1e-1),
            measured(0, Setting::Samples(64), 4.0, 5e-2),
            measured(1, Setting::Samples(16), 1.0, 1e-1),
            measured(1, Setting::Samples(64), 16.0, 1e-2),
        ];
        let ladders = ladders(&all, IntegratorKind::Path);
        assert_eq!(ladders.iter().map(Vec::len).collect::<Vec<_>>(), [2, 2]);
        let found = slopes(&ladders, cpu_seconds);
        assert!((found[0] + 0.5).abs() < 1e-12, "{found:?}");
        assert!((found[1] + libm::log(10.0) / libm::log(16.0)).abs() < 1e-12);
    }
}
