//! Pairs without an export.

use dataset::{RENDERER_VERSION, Specification, Split};
use export::rectify::Rectifier;
use half::f16;
use renderer::Renderer;
use renderer::geometry::BackendChoice;
use training::data::{Identity, Label, Pairs};

/// The paper's photographs: 30 and 90 degrees.
const VIEWS: [u32; 2] = [5, 8];

fn identity(specification: &Specification, side: u32) -> Identity {
    Identity {
        specification: specification.hash().to_string(),
        renderer_version: RENDERER_VERSION.to_owned(),
        views: VIEWS,
        side,
    }
}

/// The first `count` materials of the preset on a film of 64 pixels, each twice: once to train and
/// once to validate.
pub fn rendered(count: u32, side: u32) -> Pairs {
    let mut specification = Specification::preset();
    (specification.image.width, specification.image.height) = (64, 64);
    specification.accuracy.relative = 1e-2;
    let renderer = Renderer::new(&specification, BackendChoice::Native).unwrap();
    let rectifiers = VIEWS.map(|view| Rectifier::new(&specification, view, side).unwrap());
    let (mut labels, mut pixels) = (Vec::new(), Vec::new());
    for split in [Split::Train, Split::Validation] {
        for index in 0..count {
            let material = specification.material(index).material;
            labels.push(Label {
                index,
                split,
                material,
            });
        }
    }
    for index in 0..count {
        let material = specification.material(index).material;
        for (view, rectifier) in VIEWS.into_iter().zip(&rectifiers) {
            let film = renderer.render(&material, Some(index), view).unwrap().film;
            let film: Vec<[f32; 3]> = film
                .pixels
                .iter()
                .map(|pixel| pixel.value.map(|channel| channel as f32))
                .collect();
            let square = rectifier.apply(&film);
            for channel in 0..3 {
                pixels.extend(square.iter().map(|pixel| f16::from_f32(pixel[channel])));
            }
        }
    }
    let again = pixels.clone();
    pixels.extend(again);
    let identity = identity(&specification, side);
    Pairs::new(specification, identity, labels, pixels).unwrap()
}

/// Materials of the preset with pixels by a formula: eight train, four validate.
pub fn drawn(side: u32) -> Pairs {
    let specification = Specification::preset();
    let labels = (0..12).map(|index| Label {
        index,
        split: if index < 8 {
            Split::Train
        } else {
            Split::Validation
        },
        material: specification.material(index).material,
    });
    let labels: Vec<Label> = labels.collect();
    let count = labels.len() * 6 * side as usize * side as usize;
    let wave = |place: usize| libm::sin(place as f64 * 0.37) + libm::cos(place as f64 * 0.011);
    let pixels = (0..count).map(|place| f16::from_f64(0.3 * wave(place) * wave(place)));
    let pixels = pixels.collect();
    let identity = identity(&specification, side);
    Pairs::new(specification, identity, labels, pixels).unwrap()
}
