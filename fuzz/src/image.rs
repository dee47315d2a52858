//! Images that workers send.

use crate::fixtures::film;
use dataset::{ImageHeader, Specification, specification::Pixel};
use imagestore::validation::{check_identity, decode, expected_headers, inspect};

/// Reads an image as uploads, imports and `verify` do.
pub fn image(bytes: &[u8]) -> bool {
    let mut accepted = false;
    for pixel in [Pixel::Half, Pixel::Float] {
        let film = film(pixel);
        let inspected = inspect(bytes, &film);
        let decoded = decode(bytes, &film);
        // Which of an image's faults each names is its own affair.
        assert_eq!(
            inspected.ok(),
            decoded.as_ref().ok().map(|decoded| decoded.header.clone()),
            "two readers differ"
        );
        if let Ok(decoded) = decoded {
            accepted = true;
            let (width, height) = (film.width as usize, film.height as usize);
            assert_eq!(decoded.pixels.len(), width * height);
            let mut values = decoded.pixels.iter().flatten();
            assert!(values.all(|value| value.is_finite() && *value >= 0.0));
        }
    }
    accepted
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
    true
}
