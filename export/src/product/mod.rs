//! The files made of one image.
//!
//! | extension | what |
//! | --- | --- |
//! | `exr` | the image as it was rendered, byte for byte |
//! | `npy` | its pixels as a NumPy array, height x width x 3, of the pixels' type |
//! | `png` | a preview: sRGB, 8 bits, clipped at white |
//! | `rectified.exr`, `.npy`, `.png` | the same of the sample warped to a square |

mod npy;
mod preview;
mod rectified_exr;

use crate::{
    error::ExportError,
    rectify::{Rectifier, RectifyError},
    selection::ChosenImage,
};
use dataset::{Specification, specification::Pixel};
use datastore::{ImageFault, ReadOnlyStore};
use imagestore::validation::decode;

/// What is made of every image, beside the image itself.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Products {
    /// Pixels as NumPy arrays.
    pub npy: bool,
    /// Previews, brightened by this many stops.
    pub png_exposure_stops: Option<f64>,
    /// Rectified images of this many pixels a side.
    pub rectified_side: Option<u32>,
}

/// A kind of file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Kind {
    /// The ending of the file's name.
    pub extension: &'static str,
    /// How the file is encoded.
    pub encoding: Encoding,
    /// Of the sample warped to a square, not of the film.
    pub rectified: bool,
}

/// How a file is encoded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Encoding {
    /// OpenEXR.
    Exr,
    /// A NumPy array.
    Npy,
    /// An 8-bit sRGB picture.
    Png,
}

impl Products {
    /// The kinds of files, the image first.
    pub fn kinds(&self) -> Vec<Kind> {
        let kind = |extension, encoding, rectified| Kind {
            extension,
            encoding,
            rectified,
        };
        let all = [
            (true, kind("exr", Encoding::Exr, false)),
            (self.npy, kind("npy", Encoding::Npy, false)),
            (
                self.png_exposure_stops.is_some(),
                kind("png", Encoding::Png, false),
            ),
        ];
        let rectified = self.rectified_side.is_some();
        let warped = [
            (true, kind("rectified.exr", Encoding::Exr, true)),
            (self.npy, kind("rectified.npy", Encoding::Npy, true)),
            (
                self.png_exposure_stops.is_some(),
                kind("rectified.png", Encoding::Png, true),
            ),
        ];
        let warped = warped
            .into_iter()
            .map(|(wanted, kind)| (wanted && rectified, kind));
        all.into_iter()
            .chain(warped)
            .filter_map(|(wanted, kind)| wanted.then_some(kind))
            .collect()
    }
}

/// Makes the files; holds the warps of the views.
#[derive(Debug)]
pub struct Factory {
    products: Products,
    specification: Specification,
    // By view; empty where nothing is rectified.
    rectifiers: Vec<Option<Rectifier>>,
}

/// One file's bytes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Product {
    /// What it is.
    pub kind: Kind,
    /// The file.
    pub bytes: Vec<u8>,
}

impl Factory {
    /// For images of `views` under `specification`.
    ///
    /// # Errors
    /// When a view cannot be rectified.
    pub fn new(
        specification: &Specification,
        views: &[u32],
        products: &Products,
    ) -> Result<Self, RectifyError> {
        let rectifiers = match products.rectified_side {
            None => Vec::new(),
            Some(side) => (0..specification.views.len() as u32)
                .map(|view| {
                    let wanted = views.contains(&view);
                    wanted
                        .then(|| Rectifier::new(specification, view, side))
                        .transpose()
                })
                .collect::<Result<_, _>>()?,
        };
        Ok(Self {
            products: products.clone(),
            specification: specification.clone(),
            rectifiers,
        })
    }

    /// Makes all files of an image of a store, given what was read of it.
    ///
    /// # Errors
    /// When the image is damaged: nothing is exported that `verify` would fault.
    pub fn make(
        &self,
        store: &ReadOnlyStore,
        image: &ChosenImage,
        read: Result<Vec<u8>, ImageFault>,
    ) -> Result<Vec<Product>, ExportError> {
        let faulty = |reason| ExportError::Image {
            path: store.image_path(&image.done.digest),
            reason,
        };
        let exr = read.map_err(|fault| faulty(fault.to_string()))?;
        let kinds = self.products.kinds();
        if let [kind] = *kinds {
            return Ok(vec![Product { kind, bytes: exr }]);
        }
        let decoded =
            decode(&exr, &self.specification).map_err(|rejection| faulty(rejection.to_string()))?;
        let rectifier = self.rectifiers.get(image.view as usize);
        let square = match rectifier.and_then(Option::as_ref) {
            Some(rectifier) => Picture {
                width: rectifier.side(),
                height: rectifier.side(),
                pixel: self.specification.image.pixel,
                values: rectifier.apply(&decoded.pixels),
            },
            None => Picture::default(),
        };
        let film = Picture {
            width: self.specification.image.width,
            height: self.specification.image.height,
            pixel: self.specification.image.pixel,
            values: decoded.pixels,
        };
        let exposure = self.products.png_exposure_stops.unwrap_or_default();
        let mut files = vec![Product {
            kind: kinds[0],
            bytes: exr,
        }];
        for &kind in &kinds[1..] {
            let picture = if kind.rectified { &square } else { &film };
            let bytes = match kind.encoding {
                Encoding::Exr => rectified_exr::encode(picture, &decoded.header, &image.done)?,
                Encoding::Npy => npy::encode(picture),
                Encoding::Png => preview::encode(picture, exposure)?,
            };
            files.push(Product { kind, bytes });
        }
        Ok(files)
    }

    /// How many bytes all files of an image of `exr_bytes` have, at most.
    pub fn bytes_max(&self, exr_bytes: u64) -> u64 {
        let film = &self.specification.image;
        let film = u64::from(film.width) * u64::from(film.height);
        let side = u64::from(self.products.rectified_side.unwrap_or_default());
        let kinds = self.products.kinds();
        let sizes = kinds.iter().map(|kind| {
            let pixels = if kind.rectified { side * side } else { film };
            match (kind.encoding, kind.rectified) {
                (Encoding::Exr, false) => exr_bytes,
                // Incompressible in the worst case, and a little more.
                (Encoding::Exr | Encoding::Npy, _) => {
                    pixels * 3 * sample_bytes(self.specification.image.pixel) * 17 / 16 + 4096
                }
                (Encoding::Png, _) => pixels * 3 * 17 / 16 + 4096,
            }
        });
        sizes.sum()
    }
}

fn sample_bytes(pixel: Pixel) -> u64 {
    match pixel {
        Pixel::Half => 2,
        Pixel::Float => 4,
    }
}

/// Pixels, linear Rec.709 in units of white, row by row from the top.
#[derive(Clone, Debug)]
pub(crate) struct Picture {
    pub width: u32,
    pub height: u32,
    /// The type that they are stored in.
    pub pixel: Pixel,
    pub values: Vec<[f32; 3]>,
}

impl Default for Picture {
    fn default() -> Self {
        Self {
            width: 0,
            height: 0,
            pixel: Pixel::Half,
            values: Vec::new(),
        }
    }
}
