//! Axes: where numbers stand, and at which of them labels do.

/// One axis, linear or by decades.
pub struct Axis {
    low: f64,
    high: f64,
    is_logarithmic: bool,
}

impl Axis {
    /// An axis that holds these values; a single one stands in its middle. A logarithmic one ends at
    /// whole decades and takes positive values.
    pub fn holding(values: impl IntoIterator<Item = f64>, is_logarithmic: bool) -> Self {
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        for value in values.into_iter().filter(|value| value.is_finite()) {
            if value > 0.0 || !is_logarithmic {
                (low, high) = (low.min(value), high.max(value));
            }
        }
        if low > high {
            (low, high) = if is_logarithmic {
                (0.1, 1.0)
            } else {
                (0.0, 1.0)
            };
        }
        let mut axis = Self {
            low: axis_value(low, is_logarithmic),
            high: axis_value(high, is_logarithmic),
            is_logarithmic,
        };
        if is_logarithmic {
            (axis.low, axis.high) = (axis.low.floor(), axis.high.ceil());
        }
        if axis.high - axis.low < 1e-9 * axis.high.abs().max(1.0) {
            let half = if is_logarithmic { 1.0 } else { 0.5 };
            (axis.low, axis.high) = (axis.low - half, axis.high + half);
        }
        axis
    }

    /// A linear axis from one value to another.
    pub fn linear(low: f64, high: f64) -> Self {
        Self {
            low,
            high,
            is_logarithmic: false,
        }
    }

    /// Where a value stands: 0 at the axis' begin, 1 at its end. What is beyond stands at an end.
    pub fn share(&self, value: f64) -> f64 {
        let at = axis_value(value, self.is_logarithmic);
        let share = (at - self.low) / (self.high - self.low);
        if share.is_nan() {
            0.0
        } else {
            share.clamp(0.0, 1.0)
        }
    }

    /// The values that get labels, with their labels.
    pub fn labels(&self) -> Vec<(f64, String)> {
        if self.is_logarithmic {
            let step = (((self.high - self.low) / 6.0).ceil() as i64).max(1);
            let decades = (self.low as i64..=self.high as i64).step_by(step as usize);
            return decades
                .map(|decade| (libm::exp10(decade as f64), decade_label(decade)))
                .collect();
        }
        let step = round_step((self.high - self.low) / 5.0);
        let first = (self.low / step).ceil() as i64;
        let last = (self.high / step + 1e-9).floor() as i64;
        (first..=last)
            .map(|index| {
                let value = index as f64 * step;
                (value, crate::pages::numbers::significant(value))
            })
            .collect()
    }
}

fn axis_value(value: f64, is_logarithmic: bool) -> f64 {
    if is_logarithmic {
        libm::log10(value.max(1e-300))
    } else {
        value
    }
}

fn decade_label(decade: i64) -> String {
    match decade {
        -3..=-1 => format!("{}", libm::exp10(decade as f64)),
        0..=4 => format!("{}", libm::exp10(decade as f64)),
        _ => format!("1e{decade}").replace('-', "−"),
    }
}

/// 1, 2 or 5 times a power of ten, the first that is no smaller.
fn round_step(step: f64) -> f64 {
    let power = libm::exp10(libm::log10(step).floor());
    let steps = [1.0, 2.0, 5.0, 10.0];
    let found = steps
        .into_iter()
        .find(|times| times * power >= step * (1.0 - 1e-9));
    found.unwrap_or(10.0) * power
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn labels_are_round() {
        let labels = |axis: Axis| -> Vec<String> {
            axis.labels().into_iter().map(|(_, label)| label).collect()
        };
        assert_eq!(
            labels(Axis::holding([0.0, 100.0], false)),
            ["0", "20", "40", "60", "80", "100"]
        );
        assert_eq!(
            labels(Axis::holding([2e-4, 0.5], true)),
            ["1e−4", "0.001", "0.01", "0.1", "1"]
        );
        assert_eq!(Axis::holding([3.0], false).share(3.0), 0.5);
    }

    proptest! {
        #[test]
        fn every_value_has_a_place_and_there_are_a_few_labels(
            values in proptest::collection::vec(any::<f64>(), 0..20), is_logarithmic: bool,
        ) {
            let finite = values.iter().copied().map(|value| value.clamp(-1e9, 1e9));
            let finite: Vec<f64> = finite.filter(|value| !value.is_nan()).collect();
            let axis = Axis::holding(finite.iter().copied(), is_logarithmic);
            for value in values {
                prop_assert!((0.0..=1.0).contains(&axis.share(value)));
            }
            let labels = axis.labels();
            prop_assert!(labels.len() <= 12, "{labels:?}");
        }
    }
}
