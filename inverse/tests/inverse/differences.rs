//! What differences of other steps and orders say of derivatives.

use crate::scene::films;
use dataset::Material;
use inverse::{Encoding, Theta, ViewDerivatives};
use renderer::{Discretization, Renderer};
use std::ops::AddAssign;

/// Derivatives that count: those above this, in units of white.
const NOTABLE: f64 = 1e-4;

/// What differences say of a derivative.
#[derive(Clone, Copy, Debug)]
pub struct Slope {
    value: f64,
    /// By how much the extrapolation from the longer two steps differs from that of the shorter two.
    doubt: f64,
}

/// The shorter steps that the reference takes where a longer one does not tell a notable derivative, as shares of
/// the first: images bend where the tint meets its knee.
const REFERENCE_STEPS: [f64; 3] = [1.0, 0.125, 0.015_625];

/// A share of a derivative to which a reference knows it.
const KNOWN: f64 = 0.005;

/// The derivatives of the pixels that `render` gives, from as few steps as tell all notable ones.
pub fn reference(
    render: &dyn Fn(&Material) -> Vec<[f64; 3]>,
    material: &Material,
    parameter: usize,
    step: f64,
) -> Vec<[Slope; 3]> {
    let mut found: Vec<[Slope; 3]> = Vec::new();
    for share in REFERENCE_STEPS {
        let slopes = slopes(render, material, parameter, share * step);
        if found.is_empty() {
            found = slopes;
        } else {
            let channels = found.iter_mut().flatten().zip(slopes.into_iter().flatten());
            for (slope, shorter) in
                channels.filter(|(slope, shorter)| 2.0 * shorter.doubt < slope.doubt)
            {
                *slope = shorter;
            }
        }
        let all_known = found
            .iter()
            .flatten()
            .all(|slope| !slope.is_notable() || slope.is_known());
        if all_known {
            break;
        }
    }
    found
}

impl Slope {
    fn is_notable(&self) -> bool {
        self.value.abs() > NOTABLE
    }

    fn is_known(&self) -> bool {
        self.doubt <= KNOWN * self.value.abs()
    }
}

/// The difference quotients of three steps, each half of the one before, and the extrapolation of
/// all: central ones where the range allows them, else to one side. `render` gives the pixels of a material.
pub fn slopes(
    render: &dyn Fn(&Material) -> Vec<[f64; 3]>,
    material: &Material,
    parameter: usize,
    step: f64,
) -> Vec<[Slope; 3]> {
    let theta = Theta::of(material);
    let film = |offset: f64| {
        let mut moved = theta;
        moved.0[parameter] += offset;
        let mut moved = moved.material();
        if parameter >= 4 {
            moved = *material;
            *channel_of(&mut moved, parameter) += offset;
        }
        render(&moved)
    };
    // Colours are moved as linear channels, which the images are smooth in.
    let (at, slope) = match parameter {
        4.. => {
            let channel = *channel_of(&mut material.clone(), parameter);
            // At white the slope is the one from below.
            (channel, Encoding::Srgb.derivative(channel.min(1.0 - 1e-12)))
        }
        _ => (theta.0[parameter], 1.0),
    };
    // The roughness has a kink at 0.9.
    let room_up = if parameter == 0 && at <= 0.9 {
        0.9
    } else {
        1.0
    } - at;
    let side = if room_up >= step || parameter == 2 {
        1.0
    } else {
        -1.0
    };
    let room_down = if parameter == 0 && at > 0.9 {
        at - 0.9
    } else {
        at
    };
    let central = parameter == 2 || room_down.min(room_up) >= step;
    let base = film(0.0);
    let quotient = |step: f64| -> Vec<f64> {
        let near = film(side * step);
        let (other, weights) = match central {
            true => (film(-step), [0.5, -0.5, 0.0]),
            false => (film(0.5 * side * step), [-1.0, 4.0, -3.0]),
        };
        let flat = |image: &Vec<[f64; 3]>| image.iter().flatten().copied().collect::<Vec<f64>>();
        let (near, other, base) = (flat(&near), flat(&other), flat(&base));
        let sums = near.iter().zip(&other).zip(&base);
        sums.map(|((near, other), base)| {
            (weights[0] * near + weights[1] * other + weights[2] * base) / (side * step * slope)
        })
        .collect()
    };
    let steps = [step, 0.5 * step, 0.25 * step].map(quotient);
    extrapolated(&steps, central)
}

/// The extrapolation of the quotients of three steps, channel by channel.
fn extrapolated(steps: &[Vec<f64>; 3], central: bool) -> Vec<[Slope; 3]> {
    // Central errors hold even powers of the step, others all from the second.
    let powers = if central { [4.0, 16.0] } else { [4.0, 8.0] };
    let eliminate = |coarse: &[f64], fine: &[f64], power: f64| -> Vec<f64> {
        let pairs = coarse.iter().zip(fine);
        pairs
            .map(|(coarse, fine)| (power * fine - coarse) / (power - 1.0))
            .collect()
    };
    let first = eliminate(&steps[0], &steps[1], powers[0]);
    let second = eliminate(&steps[1], &steps[2], powers[0]);
    let all = eliminate(&first, &second, powers[1]);
    let doubts = first
        .iter()
        .zip(&second)
        .map(|(one, other)| (one - other).abs());
    let slopes = all.into_iter().zip(doubts);
    let slopes: Vec<Slope> = slopes
        .map(|(value, doubt)| Slope { value, doubt })
        .collect();
    slopes
        .chunks(3)
        .map(|pixel| [pixel[0], pixel[1], pixel[2]])
        .collect()
}

fn channel_of(material: &mut Material, parameter: usize) -> &mut f64 {
    match parameter {
        ..7 => &mut material.rgb0[parameter - 4],
        _ => &mut material.rgb90[parameter - 7],
    }
}

/// The pixels of a view of any material.
pub fn rendered(renderer: &Renderer, view: u32) -> impl Fn(&Material) -> Vec<[f64; 3]> {
    move |material| films(renderer, material, &[view]).remove(0)
}

/// The pixels of some views, one after the other, of materials beside one: as it is worked out.
pub fn rendered_like(
    renderer: &Renderer,
    material: &Material,
    views: &[u32],
) -> impl Fn(&Material) -> Vec<[f64; 3]> {
    let discretization = |&view: &u32| renderer.discretization(material, view).expect("a view");
    let discretizations: Vec<Discretization> = views.iter().map(discretization).collect();
    move |material| {
        let pixels = discretizations.iter().flat_map(|like| {
            let film = renderer.film_like(material, like).expect("a film");
            film.pixels.into_iter().map(|pixel| pixel.value)
        });
        pixels.collect()
    }
}

/// The step of the reference: a share of the lobe's or the parameter's own length.
pub fn reference_step(material: &Material, parameter: usize) -> f64 {
    let theta = Theta::of(material).0;
    // The roughness goes with the logarithm of a.
    let a = 0.001 + 0.999 * theta[0];
    match parameter {
        0 => 0.05 * a,
        1 => 0.03 * libm::cbrt(a + theta[1] * theta[1] * theta[1]),
        2 => 0.002,
        3 => 0.03 * (1.0 / 9.0 + theta[3]),
        _ => 0.01 * channel_of(&mut material.clone(), parameter).max(0.01),
    }
}

/// What differs from a reference: the worst relative error of notable derivatives, and the share of
/// all that are off by more than the stated errors and the reference's own doubt.
#[derive(Clone, Copy, Debug, Default)]
pub struct Comparison {
    pub notable: usize,
    pub beyond_a_percent: usize,
    /// Notable ones that the reference itself knows to half a percent.
    pub known: usize,
    pub known_beyond_a_percent: usize,
    pub worst: f64,
    pub channels: usize,
    pub uncovered: usize,
}

impl Comparison {
    pub fn shares(&self) -> String {
        let share = |beyond: usize, all: usize| 1.0 - beyond as f64 / all.max(1) as f64;
        let within = share(self.beyond_a_percent, self.notable);
        let known = share(self.known_beyond_a_percent, self.known);
        let covered = share(self.uncovered, self.channels);
        format!(
            "{:.3} percent of {} notable within 1 percent, worst {:.1e}; {:.3} percent of the {} that \
             the reference knows to half a percent; {:.4} percent of {} within the stated error",
            100.0 * within,
            self.notable,
            self.worst,
            100.0 * known,
            self.known,
            100.0 * covered,
            self.channels
        )
    }
}

impl AddAssign for Comparison {
    fn add_assign(&mut self, other: Self) {
        self.notable += other.notable;
        self.beyond_a_percent += other.beyond_a_percent;
        self.known += other.known;
        self.known_beyond_a_percent += other.known_beyond_a_percent;
        self.worst = self.worst.max(other.worst);
        self.channels += other.channels;
        self.uncovered += other.uncovered;
    }
}

/// Compares the derivatives of views, one after the other, with the reference.
pub fn compare(
    derivatives: &[ViewDerivatives],
    parameter: usize,
    reference: &[[Slope; 3]],
) -> Comparison {
    let by = derivatives.iter().map(|view| &view.by[parameter]);
    let pixels = by.flat_map(|by| by.values.iter().zip(&by.errors));
    let mut found = Comparison::default();
    for ((values, errors), expected) in pixels.zip(reference) {
        for channel in 0..3 {
            let (value, slope) = (values[channel], expected[channel]);
            let expected = slope.value;
            if errors[channel].is_infinite() {
                // There is no derivative by the hue of black.
                continue;
            }
            let off = (value - expected).abs();
            found.channels += 1;
            // What rounding leaves of a difference is below 1e-9 of white.
            let unsure = errors[channel] + slope.doubt + 1e-9;
            found.uncovered += usize::from(off > unsure);
            if slope.is_notable() {
                found.notable += 1;
                found.worst = found.worst.max(off / expected.abs());
                let beyond = usize::from(off > 0.01 * expected.abs());
                let known = usize::from(slope.is_known());
                found.beyond_a_percent += beyond;
                found.known += known;
                found.known_beyond_a_percent += known * beyond;
            }
        }
    }
    found
}
