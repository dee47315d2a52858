//! Images of one dataset, inspected many a second.
//!
//! [`validation::inspect`] reads a file as one of anybody's: every attribute, then whether they are
//! those that the renderer writes. All but the last of them are the same in every image of a
//! dataset, so here they are compared as bytes. Whatever differs is read again by
//! [`validation::inspect`], which says what is wrong.

use crate::{
    exact_file::check_blocks,
    rejection::Rejection,
    validation::{self, check_pixels},
};
use dataset::{
    IMAGE_FILE_TEXT_OVERHEAD, ImageHeader, Specification, image_file_bytes_max, image_file_start,
};
use exr::{
    block::{
        UncompressedBlock,
        chunk::{Chunk, CompressedBlock, CompressedScanLineBlock},
    },
    meta::MetaData,
};
use limits::IMAGE_HEADER_BYTES_MAX;
use std::{
    panic::{self, AssertUnwindSafe},
    sync::Arc,
};

/// What an image may say of itself, and the text in its file that says so.
pub struct Likely<'a> {
    /// What it may say.
    pub header: &'a ImageHeader,
    /// [`ImageHeader::to_json`] of it.
    pub text: &'a str,
}

/// Inspects the images of one dataset.
pub struct Inspector {
    specification: Arc<Specification>,
    /// How every file begins.
    start: Vec<u8>,
    /// The same as the decoder has it.
    meta_data: MetaData,
}

impl Inspector {
    /// For the images of a specification.
    pub fn new(specification: Arc<Specification>) -> Self {
        let start = image_file_start(&specification);
        // An image of the dataset, but for the text, which the decoder does not look at.
        let empty = [&start[..], &[0; IMAGE_FILE_TEXT_OVERHEAD]].concat();
        let meta_data = MetaData::read_from_buffered(&*empty, true)
            .unwrap_or_else(|error| unreachable!("the renderer's own header: {error}"));
        Self {
            specification,
            start,
            meta_data,
        }
    }

    /// The largest file of an image whose text has `text_bytes` bytes.
    pub fn image_bytes_max(&self, text_bytes: usize) -> u64 {
        let header = self.start.len() + IMAGE_FILE_TEXT_OVERHEAD + text_bytes;
        image_file_bytes_max(&self.specification, header as u64)
    }

    /// As [`validation::inspect`]; sooner still where the image says what is likely.
    ///
    /// # Errors
    /// The same.
    pub fn inspect(
        &self,
        bytes: &[u8],
        likely: Option<&Likely<'_>>,
    ) -> Result<ImageHeader, Rejection> {
        let read = || self.read(bytes, likely);
        match panic::catch_unwind(AssertUnwindSafe(read)) {
            Ok(Some(header)) => Ok(header),
            Ok(None) | Err(_) => validation::inspect(bytes, &self.specification),
        }
    }

    /// What the image says of itself; none unless all of it is as the renderer writes it.
    fn read(&self, bytes: &[u8], likely: Option<&Likely<'_>>) -> Option<ImageHeader> {
        let rest = bytes.strip_prefix(&*self.start)?;
        let (text_bytes, rest) = rest.split_first_chunk()?;
        let text_bytes = u32::from_le_bytes(*text_bytes) as usize;
        if text_bytes > IMAGE_HEADER_BYTES_MAX {
            return None;
        }
        let (text, rest) = rest.split_at_checked(text_bytes)?;
        if rest.first() != Some(&0) {
            return None;
        }
        let header = match likely {
            Some(likely) if text == likely.text.as_bytes() => likely.header.clone(),
            _ => {
                let header: ImageHeader = serde_json::from_slice(text).ok()?;
                (header.to_json().as_bytes() == text).then_some(header)?
            }
        };
        let table = self.start.len() + IMAGE_FILE_TEXT_OVERHEAD + text_bytes;
        let checked = check_blocks(bytes, table, &self.specification, |first_line, packed| {
            self.check_block(first_line, packed)
        });
        checked.ok().map(|()| header)
    }

    fn check_block(&self, first_line: u32, packed: &[u8]) -> Result<(), Rejection> {
        let unreadable = |error: exr::error::Error| Rejection::Unreadable(error.to_string());
        let chunk = Chunk {
            layer_index: 0,
            compressed_block: CompressedBlock::ScanLine(CompressedScanLineBlock {
                y_coordinate: first_line as i32,
                compressed_pixels_le: packed.to_vec(),
            }),
        };
        let block = UncompressedBlock::decompress_chunk(chunk, &self.meta_data, true);
        check_pixels(&block.map_err(unreadable)?, &self.specification.image)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use dataset::specification::Pixel;

    /// A coordinator makes one of the specification that it is given.
    #[test]
    fn there_is_one_for_every_film_that_is_admitted() {
        for (width, height) in [
            (1, 1),
            (1, 4096),
            (4096, 1),
            (33, 17),
            (128, 128),
            (4096, 4096),
        ] {
            for pixel in [Pixel::Half, Pixel::Float] {
                let mut specification = Specification::preset();
                specification.image.width = width;
                specification.image.height = height;
                specification.image.pixel = pixel;
                let toml = specification.to_toml();
                let specification = Specification::from_toml(&toml, "test").unwrap();
                let hash = specification.hash();
                let headers = validation::expected_headers(&specification, hash, 0);
                let bytes_max = validation::image_bytes_max(&specification, &headers[3]);
                let inspector = Inspector::new(Arc::new(specification));
                let text = headers[3].to_json();
                assert_eq!(inspector.image_bytes_max(text.len()), bytes_max);
            }
        }
    }
}
