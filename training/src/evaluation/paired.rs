//! Estimators compared pair by pair, material by material.

use super::statistics::{Interval, median_ratio};
use super::tables::mean_errors;
use super::{Estimates, Judged};

/// The seed of the bootstrap.
const BOOTSTRAP_SEED: u64 = 2;

/// One estimator, or several trainings of it that differ by their seeds alone.
#[derive(Clone, Debug, PartialEq)]
pub struct Group {
    /// The estimator's name, without the number of the seed.
    pub name: String,
    /// How many trainings.
    pub trainings: usize,
    /// By material: the mean over trainings and views of the squared difference of sRGB codes.
    errors: Vec<f64>,
}

/// Estimators whose names differ by a number behind their last hyphen are trainings of one, in the
/// order of their first.
pub fn groups(all: &[Estimates], judged: &[Vec<Judged>]) -> Vec<Group> {
    let mut groups: Vec<Group> = Vec::new();
    for (estimates, judged) in all.iter().zip(judged) {
        let errors = mean_errors(judged);
        let name = without_number(&estimates.name);
        match groups.iter_mut().find(|group| group.name == name) {
            None => groups.push(Group {
                name: name.to_owned(),
                trainings: 1,
                errors,
            }),
            Some(group) => {
                group.trainings += 1;
                for (sum, error) in group.errors.iter_mut().zip(errors) {
                    *sum += error;
                }
            }
        }
    }
    for group in &mut groups {
        for error in &mut group.errors {
            *error /= group.trainings as f64;
        }
    }
    groups
}

/// An estimator's name without the number of a seed.
pub(super) fn without_number(name: &str) -> &str {
    let parts = name.rsplit_once('-');
    let numbered =
        parts.filter(|(_, end)| !end.is_empty() && end.bytes().all(|b| b.is_ascii_digit()));
    numbered.map_or(name, |(start, _)| start)
}

impl Group {
    /// The median over materials of the ratio of its error to another's, with an interval of 95
    /// percent by the bootstrap over materials.
    pub fn ratio_to(&self, other: &Self) -> Interval {
        median_ratio(&self.errors, &other.errors, BOOTSTRAP_SEED)
    }
}

#[cfg(test)]
mod tests {
    use super::super::rerender::ImageError;
    use super::*;
    use dataset::Specification;

    fn judged(errors: [f64; 3]) -> Vec<Judged> {
        let material = Specification::preset().material(0).material;
        let one = |(index, srgb): (usize, f64)| Judged {
            index: index as u32,
            estimate: material,
            truth: material,
            views: vec![ImageError { srgb, log: 0.0 }],
        };
        errors.into_iter().enumerate().map(one).collect()
    }

    fn estimates(name: &str) -> Estimates {
        Estimates {
            name: name.to_owned(),
            materials: Vec::new(),
        }
    }

    #[test]
    fn trainings_of_one_estimator_are_one_group() {
        let names = ["refine-off", "nested-0", "flat-0", "nested-1", "a-"];
        let all = names.map(estimates);
        let errors = [
            [1.0; 3],
            [1.0, 2.0, 3.0],
            [2.0; 3],
            [3.0, 2.0, 1.0],
            [4.0; 3],
        ];
        let groups = groups(&all, &errors.map(judged));
        let found: Vec<(&str, usize)> = groups
            .iter()
            .map(|group| (group.name.as_str(), group.trainings))
            .collect();
        assert_eq!(
            found,
            [("refine-off", 1), ("nested", 2), ("flat", 1), ("a-", 1)]
        );
        let ratio = groups[1].ratio_to(&groups[3]);
        assert_eq!((ratio.value, ratio.low, ratio.high), (0.5, 0.5, 0.5));
    }
}
