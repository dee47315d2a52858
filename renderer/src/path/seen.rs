//! What a pixel sees of a curved sample, place by place.

/// Grids reach so far beyond what they cover, as a share of their width: a streak along the border of two pixels is
/// found from both. Chosen.
pub const OUTWARD: f64 = 0.01;

/// What is seen at a place of the film.
pub trait Seen {
    /// The half vector's slope along the lobe's narrow axis; `None` beside the sample.
    fn slope(&self, at: [f64; 2]) -> Option<f64>;
    /// The largest slope at which the lobe sends light there.
    fn reach(&self, at: [f64; 2]) -> Option<f64>;
    /// How bright it is, in units of white.
    fn brightness(&self, at: [f64; 2]) -> f64;
}

/// The place between two that is nearest to the second and still on the sample, if the first is, by so many halvings.
pub fn seen_toward(seen: &impl Seen, [from, to]: [[f64; 2]; 2], steps: usize) -> [f64; 2] {
    if seen.slope(to).is_some() {
        return to;
    }
    let place = |share: f64| [0, 1].map(|axis| from[axis] + (to[axis] - from[axis]) * share);
    let (mut on, mut beside) = (0.0, 1.0);
    for _ in 0..steps {
        let between = 0.5 * (on + beside);
        if seen.slope(place(between)).is_some() {
            on = between;
        } else {
            beside = between;
        }
    }
    place(on)
}
