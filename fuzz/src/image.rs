//! Images that workers send.

use crate::fixtures::{SPECIFICATION, film};
use dataset::{ImageHeader, Specification, image_file_header, specification::Pixel};
use imagestore::{
    inspector::{Inspector, Likely},
    validation::{check_identity, check_size, decode, expected_headers, image_bytes_max, inspect},
};
use std::sync::Arc;

/// Reads an image as uploads, imports and `verify` do.
pub fn image(bytes: &[u8]) -> bool {
    let mut is_accepted = false;
    for pixel in [Pixel::Half, Pixel::Float] {
        let mut specification = SPECIFICATION.clone();
        specification.image = film(pixel);
        let film = &specification.image;
        let inspected = inspect(bytes, &specification);
        let decoded = decode(bytes, &specification);
        // Which of an image's faults each names is its own affair.
        let accepted = |read: &Result<ImageHeader, _>| read.as_ref().ok().cloned();
        let inspector = Inspector::new(Arc::new(specification.clone()));
        let header = decoded.as_ref().ok().map(|decoded| &decoded.header);
        let text = header.map(ImageHeader::to_json).unwrap_or_default();
        let likely = header.map(|header| Likely {
            header,
            text: &text,
        });
        for likely in [likely.as_ref(), None] {
            let sooner = inspector.inspect(bytes, likely);
            assert_eq!(
                sooner.ok(),
                accepted(&inspected),
                "the quick reader differs"
            );
        }
        assert_eq!(
            accepted(&inspected),
            decoded.as_ref().ok().map(|decoded| decoded.header.clone()),
            "two readers differ"
        );
        if let Ok(decoded) = decoded {
            is_accepted = true;
            let file_header = image_file_header(&specification, &decoded.header);
            assert!(bytes.starts_with(&file_header), "another header");
            let size = bytes.len() as u64;
            check_size(size, &specification, &decoded.header).unwrap();
            let (width, height) = (film.width as usize, film.height as usize);
            assert_eq!(decoded.pixels.len(), width * height);
            let mut values = decoded.pixels.iter().flatten();
            assert!(values.all(|value| value.is_finite() && *value >= 0.0));
        }
    }
    is_accepted
}

/// Reads the label in an image, and compares it with what it has to be.
pub fn image_header(bytes: &[u8]) -> bool {
    let Ok(header) = serde_json::from_slice::<ImageHeader>(bytes) else {
        return false;
    };
    let json = serde_json::to_vec(&header).unwrap();
    let again: ImageHeader = serde_json::from_slice(&json).unwrap();
    assert_eq!(again, header);
    let specification = Specification::preset();
    for expected in expected_headers(&specification, specification.hash(), 0) {
        let same = check_identity(&header, &expected);
        assert_eq!(same.is_ok(), header == expected);
    }
    // No file that begins as an image of this label does is read as one of another label, however
    // odd the label is.
    let file_header = image_file_header(&specification, &header);
    assert!(image_bytes_max(&specification, &header) > file_header.len() as u64);
    let mut file = file_header;
    file.extend(bytes);
    if let Ok(read) = inspect(&file, &specification) {
        assert_eq!(read, header);
    }
    true
}
