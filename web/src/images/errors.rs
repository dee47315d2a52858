//! The stated error of each pixel, as a map in colours. A store keeps statistics of it alone, so the
//! image is rendered again, to the same bytes: one at a time and on one thread, so that leases and
//! completions have the other cores.

use super::png;
use crate::{problem::Problem, threads::Threads};
use dataset::{Digest, Specification};
use limits::web::RENDERINGS_WAITING_MAX;
use rayon::{ThreadPool, ThreadPoolBuilder};
use renderer::{Renderer, Rendering, film::target, geometry::BackendChoice};
use std::sync::{Arc, OnceLock};

/// Renders images again for their stated errors.
pub struct ErrorRenderings {
    specification: Arc<Specification>,
    engine: Arc<OnceLock<Result<Engine, String>>>,
    threads: Threads,
}

/// A renderer, and the one thread that it works on.
struct Engine {
    renderer: Renderer,
    thread: ThreadPool,
}

impl Engine {
    fn new(specification: &Specification) -> Result<Self, String> {
        let renderer = Renderer::new(specification, BackendChoice::Native);
        let thread = ThreadPoolBuilder::new().num_threads(1).build();
        Ok(Self {
            renderer: renderer.map_err(|error| error.to_string())?,
            thread: thread.map_err(|error| error.to_string())?,
        })
    }
}

/// The colours of the map: from nothing over the tolerance to ten times it.
pub struct ErrorMap;

impl ErrorMap {
    /// Errors over the tolerance at which a colour stands, and the colour: black to blue-green below
    /// the tolerance, red to yellow above it. Between two of them colours are mixed by the logarithm.
    pub const STOPS: [(f64, [u8; 3]); 5] = [
        (0.001, [0, 0, 0]),
        (0.1, [16, 78, 139]),
        (1.0, [120, 200, 190]),
        (1.000_001, [190, 30, 45]),
        (10.0, [255, 225, 90]),
    ];

    /// The colour of an error over the tolerance.
    pub fn colour(over_tolerance: f64) -> [u8; 3] {
        let (first, last) = (Self::STOPS[0], Self::STOPS[Self::STOPS.len() - 1]);
        if over_tolerance.is_nan() || over_tolerance >= last.0 {
            return last.1;
        }
        for pair in Self::STOPS.windows(2) {
            let [(low, from), (high, to)] = [pair[0], pair[1]];
            if (low..high).contains(&over_tolerance) {
                let share = libm::log(over_tolerance / low) / libm::log(high / low);
                let mix = |index: usize| {
                    let [from, to] = [from[index], to[index]].map(f64::from);
                    (from + share * (to - from)).round() as u8
                };
                return [mix(0), mix(1), mix(2)];
            }
        }
        first.1
    }
}

impl ErrorRenderings {
    /// Renderings of a dataset.
    pub fn new(specification: Arc<Specification>) -> Self {
        Self {
            specification,
            engine: Arc::default(),
            threads: Threads::new(1, RENDERINGS_WAITING_MAX),
        }
    }

    /// The map of one image as PNG, which `keep` is given as soon as it is there. Refused where the
    /// rendering has another digest than the image.
    pub async fn render(
        &self,
        material: u32,
        view: u32,
        digest: Digest,
        keep: impl FnOnce(&Arc<[u8]>) + Send + 'static,
    ) -> Result<Arc<[u8]>, Problem> {
        let specification = Arc::clone(&self.specification);
        let engine = Arc::clone(&self.engine);
        let work = move || {
            let engine = engine.get_or_init(|| Engine::new(&specification));
            let Engine { renderer, thread } = engine.as_ref().map_err(Problem::broken)?;
            let sampled = specification.material(material).material;
            let rendering = thread.install(|| renderer.render(&sampled, Some(material), view));
            let rendering = rendering.map_err(|error| Problem::broken(error.to_string()))?;
            if Digest::of(&rendering.exr) != digest {
                return Err(Problem::gone(
                    "the image does not come out the same when it is rendered again: check it with \
                     `brdfarm dataset verify --rerender`",
                ));
            }
            let map: Arc<[u8]> = map(&rendering, &specification)?.into();
            keep(&map);
            Ok(map)
        };
        self.threads.run(work).await
    }
}

fn map(rendering: &Rendering, specification: &Specification) -> Result<Vec<u8>, Problem> {
    let film = &rendering.film;
    let colours: Vec<[u8; 3]> = film
        .pixels
        .iter()
        .map(|pixel| ErrorMap::colour(pixel.error / target(&specification.accuracy, pixel.value)))
        .collect();
    png(film.width, film.height, &colours)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_rise_with_the_error_and_turn_red_at_the_tolerance() {
        assert_eq!(ErrorMap::colour(0.0), [0, 0, 0]);
        assert_eq!(ErrorMap::colour(0.1), [16, 78, 139]);
        assert_eq!(ErrorMap::colour(0.999_999), [120, 200, 190]);
        assert_eq!(ErrorMap::colour(1.000_001), [190, 30, 45]);
        for over in [10.0, 1e9, f64::INFINITY, f64::NAN] {
            assert_eq!(ErrorMap::colour(over), [255, 225, 90]);
        }
        let below = ErrorMap::colour(0.03);
        assert!(below[2] > below[0] && below[2] < 139);
    }
}
