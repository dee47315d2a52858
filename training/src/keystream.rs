//! Randomness by purpose: nothing is drawn from a global stream, so a run that was stopped goes on
//! with the numbers of an undisturbed one, whatever its threads.

use dataset::keystream::{self, key};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

/// What random numbers are for.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Purpose {
    /// A network's first weights; the stream is the layer.
    Weights,
    /// The order of materials; the stream is the epoch.
    Order,
    /// Noise of pixels; the stream is epoch and material.
    Noise,
    /// Which activations are dropped; the stream is step and layer.
    Dropout,
    /// Noise of photographs that estimators are judged on; the stream is material and view.
    Photograph,
    /// Noise of the codes that networks are judged on; the stream is the material.
    Judged,
    /// Materials drawn from what a model says; the stream is 0.
    Draws,
    /// Bootstrap samples of the evaluation; the stream is the figure.
    Bootstrap,
}

/// The numbers of a purpose, at their beginning.
pub(crate) fn keystream(seed: u64, purpose: Purpose, stream: u64) -> ChaCha8Rng {
    let name = match purpose {
        Purpose::Weights => b"brdfarm train weights   ",
        Purpose::Order => b"brdfarm train order     ",
        Purpose::Noise => b"brdfarm train noise     ",
        Purpose::Dropout => b"brdfarm train dropout   ",
        Purpose::Photograph => b"brdfarm train photograph",
        Purpose::Judged => b"brdfarm train judged    ",
        Purpose::Draws => b"brdfarm estimate draws  ",
        Purpose::Bootstrap => b"brdfarm train bootstrap ",
    };
    let mut rng = ChaCha8Rng::from_seed(key(seed, keystream::Purpose(*name)));
    rng.set_stream(stream);
    rng
}
