//! What honest workers deliver, and what liars do.

use dataset::{Digest, Specification};
use proto::{ErrorStatistics, PixelStatistics, View};
use renderer::{Renderer, Rendering, encode_exr, geometry::BackendChoice};
use std::sync::Arc;

/// The images of a set, each as its message.
pub struct Images {
    pub specification: Specification,
    truth: Vec<Arc<Vec<View>>>,
    lies: Vec<Arc<Vec<View>>>,
}

fn message(data: Vec<u8>, rendering: &Rendering) -> View {
    let (statistics, pixels) = (&rendering.statistics, &rendering.pixels);
    View {
        digest: Digest::of(&data).as_bytes().to_vec(),
        size: data.len() as u64,
        statistics: Some(ErrorStatistics {
            mean: statistics.mean,
            p95: statistics.p95,
            max: statistics.max,
            within_target: statistics.within_target,
            samples: statistics.samples,
            evaluations: statistics.evaluations,
        }),
        md5: Vec::new(),
        image: data.into(),
        pixels: Some(PixelStatistics {
            sample_share: pixels.sample_share,
            brightness_mean: pixels.brightness_mean,
            brightness_p99: pixels.brightness_p99,
            dark_share: pixels.dark_share,
            above_white_share: pixels.above_white_share,
        }),
    }
}

impl Images {
    /// Those of the preset's first materials, 16 x 16.
    pub fn render(materials: u32) -> Arc<Self> {
        let text = format!("materials = {materials}\n[image]\nwidth = 16\nheight = 16\n");
        let specification = Specification::from_toml(&text, "a test").unwrap();
        let renderer = Renderer::new(&specification, BackendChoice::Native).unwrap();
        let views = specification.views.len() as u32;
        let rendered: Vec<Vec<Rendering>> = (0..materials)
            .map(|index| {
                let material = specification.material(index).material;
                let views = 0..views;
                let render = |view| renderer.render(&material, Some(index), view).unwrap();
                views.map(render).collect()
            })
            .collect();
        let truth = rendered.iter().map(|views| {
            let views = views.iter();
            Arc::new(views.map(|view| message(view.exr.clone(), view)).collect())
        });
        // The next material's pixels under this one's header.
        let lies = rendered.iter().zip(rendered.iter().cycle().skip(1));
        let lies = lies.map(|(own, other)| {
            let views = own.iter().zip(other);
            let lie = |(own, other): (&Rendering, &Rendering)| {
                let luminance = specification.white_luminance();
                let pixel = specification.image.pixel;
                let data = encode_exr(&other.film, pixel, &own.header, luminance).unwrap();
                message(data, own)
            };
            Arc::new(views.map(lie).collect())
        });
        Arc::new(Self {
            truth: truth.collect(),
            lies: lies.collect(),
            specification,
        })
    }

    pub fn truth(&self, material: u32) -> Vec<View> {
        self.truth[material as usize].to_vec()
    }

    pub fn lie(&self, material: u32) -> Vec<View> {
        self.lies[material as usize].to_vec()
    }

    /// The truth, said to be of no error.
    pub fn praise(&self, material: u32) -> Vec<View> {
        let mut views = self.truth(material);
        for view in &mut views {
            let statistics = view.statistics.as_mut().unwrap();
            statistics.mean = 0.0;
            statistics.p95 = 0.0;
        }
        views
    }

    /// The truth, said to be brighter.
    pub fn brighten(&self, material: u32) -> Vec<View> {
        let mut views = self.truth(material);
        for view in &mut views {
            let pixels = view.pixels.as_mut().unwrap();
            pixels.brightness_mean += 0.5;
            pixels.dark_share = 0.0;
        }
        views
    }

    /// The truth, with something in its files that does not belong there.
    pub fn smuggle(&self, material: u32) -> Vec<View> {
        let mut views = self.truth(material);
        for view in &mut views {
            let data = with_an_attribute(&view.image);
            view.digest = Digest::of(&data).as_bytes().to_vec();
            view.size = data.len() as u64;
            view.image = data.into();
        }
        views
    }
}

/// An OpenEXR file with one more attribute, of 100 bytes, before all others.
fn with_an_attribute(exr: &[u8]) -> Vec<u8> {
    // Magic number and version come before the header.
    let start = 8;
    let mut end = start;
    let text_end = |from: usize| from + exr[from..].iter().position(|byte| *byte == 0).unwrap() + 1;
    while exr[end] != 0 {
        let size = text_end(text_end(end));
        let bytes = u32::from_le_bytes(exr[size..size + 4].try_into().unwrap());
        end = size + 4 + bytes as usize;
    }
    let table = end + 1;
    let offset = |at: usize| u64::from_le_bytes(exr[at..at + 8].try_into().unwrap());
    let chunks = offset(table) as usize;
    let mut attribute = b"notes\0string\0".to_vec();
    attribute.extend(100_u32.to_le_bytes());
    attribute.extend([b'x'; 100]);
    let shifted = (table..chunks).step_by(8);
    let shifted = shifted.flat_map(|at| (offset(at) + attribute.len() as u64).to_le_bytes());
    let shifted: Vec<u8> = shifted.collect();
    [
        &exr[..start],
        &attribute,
        &exr[start..table],
        &shifted,
        &exr[chunks..],
    ]
    .concat()
}
