//! Pictures of stored images: made off the threads that answer, a few at a time, and kept while there
//! is room.

mod cache;
mod errors;

use crate::{problem::Problem, threads::Threads};
use cache::Cache;
use dataset::{CompletedView, Specification};
use datastore::{ImageFault, check_read};
use errors::ErrorRenderings;
use imagestore::{blobs::Blobs, validation::decode};
use limits::web::{PICTURE_CACHE_BYTES, PICTURES_AT_ONCE, PICTURES_WAITING_MAX, THUMBNAIL_SIDE};
use picture::{encode_png, to_srgb8};
use std::sync::{Arc, Mutex, PoisonError};

pub use errors::ErrorMap;

/// What a picture shows, of which image.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub enum Picture {
    /// The image made small.
    Thumbnail(dataset::Digest),
    /// The image as it is, brightened by so many tenths of a stop.
    Developed(dataset::Digest, i32),
    /// The stated error of each pixel.
    Errors(dataset::Digest),
}

/// The images of a store, and pictures of them.
pub struct Images {
    specification: Arc<Specification>,
    blobs: Blobs,
    cache: Arc<Mutex<Cache<Picture>>>,
    threads: Threads,
    errors: ErrorRenderings,
}

impl Images {
    /// Pictures of the images in `blobs`.
    pub fn new(specification: Arc<Specification>, blobs: Blobs) -> Self {
        Self {
            errors: ErrorRenderings::new(Arc::clone(&specification)),
            specification,
            blobs,
            cache: Arc::new(Mutex::new(Cache::new(PICTURE_CACHE_BYTES))),
            threads: Threads::new(PICTURES_AT_ONCE, PICTURES_WAITING_MAX),
        }
    }

    /// Free bytes on the disk that images are kept on, where they are on one of this machine.
    pub fn free_bytes(&self) -> Option<u64> {
        self.blobs.room().free_bytes().ok()
    }

    /// An image's file, as it was completed.
    pub async fn file(&self, image: &CompletedView) -> Result<Vec<u8>, Problem> {
        let (blobs, image) = (self.blobs.clone(), image.clone());
        self.threads.run(move || read(&blobs, &image)).await
    }

    /// An image's pixels: linear Rec.709 in units of white, row by row from the top.
    pub async fn pixels(&self, image: &CompletedView) -> Result<Vec<[f32; 3]>, Problem> {
        let (blobs, image) = (self.blobs.clone(), image.clone());
        let specification = Arc::clone(&self.specification);
        let decoded = move || decoded(&blobs, &image, &specification);
        self.threads.run(decoded).await
    }

    /// A thumbnail as PNG.
    pub async fn thumbnail(&self, image: &CompletedView) -> Result<Arc<[u8]>, Problem> {
        let film = &self.specification.image;
        let size = [film.width, film.height];
        let picture = Picture::Thumbnail(image.digest);
        self.picture(picture, image, move |pixels| {
            let (pixels, [width, height]) = smaller(&pixels, size, THUMBNAIL_SIDE);
            develop(&pixels, width, height, 0.0)
        })
        .await
    }

    /// The image as PNG, brightened by so many tenths of a stop.
    pub async fn developed(
        &self,
        image: &CompletedView,
        tenths: i32,
    ) -> Result<Arc<[u8]>, Problem> {
        let film = &self.specification.image;
        let (width, height) = (film.width, film.height);
        let picture = Picture::Developed(image.digest, tenths);
        self.picture(picture, image, move |pixels| {
            develop(&pixels, width, height, f64::from(tenths) / 10.0)
        })
        .await
    }

    /// The stated error of each pixel as a picture. The image is rendered again for it.
    pub async fn errors(
        &self,
        material: u32,
        view: u32,
        image: &CompletedView,
    ) -> Result<Arc<[u8]>, Problem> {
        let picture = Picture::Errors(image.digest);
        if let Some(kept) = self.cache().get(&picture) {
            return Ok(kept);
        }
        let cache = Arc::clone(&self.cache);
        // A rendering may take longer than its reader waits: whoever asks again finds it.
        let keep = move |made: &Arc<[u8]>| {
            let mut cache = cache.lock().unwrap_or_else(PoisonError::into_inner);
            cache.put(picture, Arc::clone(made));
        };
        self.errors.render(material, view, image.digest, keep).await
    }

    async fn picture(
        &self,
        picture: Picture,
        image: &CompletedView,
        make: impl FnOnce(Vec<[f32; 3]>) -> Result<Vec<u8>, Problem> + Send + 'static,
    ) -> Result<Arc<[u8]>, Problem> {
        if let Some(kept) = self.cache().get(&picture) {
            return Ok(kept);
        }
        let (blobs, image) = (self.blobs.clone(), image.clone());
        let specification = Arc::clone(&self.specification);
        let made: Arc<[u8]> = self
            .threads
            .run(move || make(decoded(&blobs, &image, &specification)?))
            .await?
            .into();
        self.cache().put(picture, Arc::clone(&made));
        Ok(made)
    }

    // Nothing that runs under the lock panics half way through a change.
    fn cache(&self) -> std::sync::MutexGuard<'_, Cache<Picture>> {
        self.cache.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

fn read(blobs: &Blobs, image: &CompletedView) -> Result<Vec<u8>, Problem> {
    let read = check_read(image, blobs.read(&image.digest, image.bytes));
    read.map_err(|fault| match fault {
        ImageFault::Missing => Problem::gone("the image is missing from the store"),
        fault => Problem::broken(fault.to_string()),
    })
}

fn decoded(
    blobs: &Blobs,
    image: &CompletedView,
    specification: &Specification,
) -> Result<Vec<[f32; 3]>, Problem> {
    let decoded = decode(&read(blobs, image)?, specification);
    let decoded = decoded.map_err(|rejection| Problem::broken(rejection.to_string()))?;
    Ok(decoded.pixels)
}

fn develop(
    pixels: &[[f32; 3]],
    width: u32,
    height: u32,
    exposure_stops: f64,
) -> Result<Vec<u8>, Problem> {
    let developed: Vec<[u8; 3]> = pixels
        .iter()
        .map(|value| to_srgb8(value.map(f64::from), exposure_stops))
        .collect();
    png(width, height, &developed)
}

/// A picture as PNG.
pub(crate) fn png(width: u32, height: u32, pixels: &[[u8; 3]]) -> Result<Vec<u8>, Problem> {
    let png = encode_png(width, height, pixels, &[]);
    png.map_err(|error| Problem::broken(error.to_string()))
}

/// Averages squares of pixels until the longer side is at most `side_max`: as many pixels on a side
/// of the square as that takes, and fewer in the last column and row. Also returns the new size.
fn smaller(
    pixels: &[[f32; 3]],
    [width, height]: [u32; 2],
    side_max: u32,
) -> (Vec<[f32; 3]>, [u32; 2]) {
    let step = width.max(height).div_ceil(side_max).max(1);
    let size = [width.div_ceil(step), height.div_ceil(step)];
    let mean = |column: u32, row: u32| {
        let columns = column * step..((column + 1) * step).min(width);
        let rows = row * step..((row + 1) * step).min(height);
        let count = (columns.len() * rows.len()) as f64;
        let mut sum = [0.0; 3];
        for y in rows {
            for x in columns.clone() {
                let pixel = pixels[y as usize * width as usize + x as usize];
                for (sum, channel) in sum.iter_mut().zip(pixel) {
                    *sum += f64::from(channel);
                }
            }
        }
        sum.map(|sum| (sum / count) as f32)
    };
    let places = (0..size[1]).flat_map(|row| (0..size[0]).map(move |column| (column, row)));
    (
        places.map(|(column, row)| mean(column, row)).collect(),
        size,
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_smaller_picture_has_the_means_of_squares() {
        let pixels: Vec<[f32; 3]> = (0..15).map(|index| [index as f32, 1.0, 0.0]).collect();
        let (small, size) = smaller(&pixels, [5, 3], 3);
        assert_eq!(size, [3, 2]);
        let reds: Vec<f32> = small.iter().map(|pixel| pixel[0]).collect();
        assert_eq!(reds, [3.0, 5.0, 6.5, 10.5, 12.5, 14.0]);
        assert!(small.iter().all(|pixel| pixel[1] == 1.0));
        assert_eq!(smaller(&pixels, [5, 3], 5).0, pixels);
        assert_eq!(smaller(&pixels, [15, 1], 4).1, [4, 1]);
    }
}
