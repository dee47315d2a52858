//! Images to be explained.

use crate::encoding::Encoding;
use crate::error::{InverseError, check_positive};
use dataset::Specification;

/// The encoded image of a view.
#[derive(Clone, Debug, PartialEq)]
pub struct ObservedView {
    /// The view's index in the specification.
    pub view: u32,
    /// Codes of height x width pixels, row by row, row 0 at the top.
    pub pixels: Vec<[f64; 3]>,
    /// What linear red, green and blue were multiplied by before they were encoded, as far as it is
    /// known.
    pub gain: [f64; 3],
    /// Which pixels count.
    pub counts: Vec<bool>,
}

impl ObservedView {
    /// A film in units of white, of which every pixel counts.
    pub fn film(view: u32, pixels: Vec<[f64; 3]>) -> Self {
        Self {
            view,
            gain: [1.0; 3],
            counts: vec![true; pixels.len()],
            pixels,
        }
    }
}

/// Films of some views of one material, checked against a specification.
#[derive(Clone, Debug, PartialEq)]
pub struct Observation {
    encoding: Encoding,
    views: Vec<ObservedView>,
}

impl Observation {
    /// Takes encoded images of different views of `specification`.
    ///
    /// # Errors
    /// When there is none, a view does not exist or comes twice, an image has another size than
    /// the film, a pixel is not finite, none counts, or a gain is not above 0. The error names the
    /// view.
    pub fn new(
        specification: &Specification,
        encoding: Encoding,
        views: Vec<ObservedView>,
    ) -> Result<Self, InverseError> {
        let observation = Self { encoding, views };
        observation.check(specification)?;
        Ok(observation)
    }

    /// Checks the images against a specification.
    pub(crate) fn check(&self, specification: &Specification) -> Result<(), InverseError> {
        let indices: Vec<u32> = self.views.iter().map(|observed| observed.view).collect();
        check_views(specification, &indices)?;
        let (width, height) = (specification.image.width, specification.image.height);
        let expected = width as usize * height as usize;
        for observed in &self.views {
            let ObservedView {
                view,
                pixels,
                gain,
                counts,
            } = observed;
            let (view, found) = (*view, pixels.len());
            for gain in gain {
                check_positive("gain", *gain)?;
            }
            if !counts.contains(&true) {
                return Err(InverseError::NoPixels { view });
            }
            if found != expected || counts.len() != expected {
                return Err(InverseError::ImageSize {
                    view,
                    width,
                    height,
                    expected,
                    found,
                });
            }
            let finite = |pixel: &[f64; 3]| pixel.iter().all(|channel| channel.is_finite());
            if let Some(index) = pixels.iter().position(|pixel| !finite(pixel)) {
                return Err(InverseError::PixelNotFinite {
                    view,
                    column: index % width as usize,
                    row: index / width as usize,
                    value: pixels[index],
                });
            }
        }
        Ok(())
    }

    /// How the pixels are encoded.
    pub fn encoding(&self) -> Encoding {
        self.encoding
    }

    /// The images.
    pub fn views(&self) -> &[ObservedView] {
        &self.views
    }

    /// How many channels count in all images together.
    pub fn channels(&self) -> usize {
        let counts = self.views.iter().flat_map(|view| &view.counts);
        3 * counts.filter(|counts| **counts).count()
    }
}

/// Checks that the sample is flat, that views exist, that there is one, and that none comes twice.
pub(crate) fn check_views(
    specification: &Specification,
    views: &[u32],
) -> Result<(), InverseError> {
    let shape = specification.sample.shape;
    if !shape.is_square() {
        return Err(InverseError::Curved { shape });
    }
    if views.is_empty() {
        return Err(InverseError::NoViews);
    }
    let count = specification.views.len();
    for (place, &view) in views.iter().enumerate() {
        if view as usize >= count {
            return Err(InverseError::NoSuchView { view, count });
        }
        if views[..place].contains(&view) {
            return Err(InverseError::RepeatedView { view });
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use dataset::specification::Shape;

    fn refusal(views: Vec<ObservedView>) -> String {
        let mut specification = Specification::preset();
        (specification.image.width, specification.image.height) = (3, 2);
        match Observation::new(&specification, Encoding::Srgb, views) {
            Ok(_) => String::new(),
            Err(error) => error.to_string(),
        }
    }

    fn black(view: u32, pixels: usize) -> ObservedView {
        ObservedView::film(view, vec![[0.0; 3]; pixels])
    }

    #[test]
    fn curved_samples_are_refused() {
        let mut specification = Specification::preset();
        specification.sample.shape = Shape::Cylinder;
        let refused = check_views(&specification, &[5]).err();
        let said = refused.expect("refused").to_string();
        assert!(said.contains("images of a cylinder are traced"), "{said}");
    }

    #[test]
    fn what_does_not_fit_is_named() {
        assert_eq!(refusal(vec![black(5, 6), black(8, 6)]), "");
        assert!(refusal(vec![]).contains("no view"));
        assert_eq!(
            refusal(vec![black(5, 6), black(5, 6)]),
            "view 5 is given twice"
        );
        assert!(refusal(vec![black(14, 6)]).contains("no view 14"));
        let small = refusal(vec![black(5, 6), black(8, 5)]);
        assert!(
            small.contains("view 8 has 5 pixels") && small.contains("3 x 2"),
            "{small}"
        );
        let mut broken = black(8, 6);
        broken.pixels[4][1] = f64::NAN;
        let broken = refusal(vec![black(5, 6), broken]);
        assert!(broken.contains("pixel (1, 1) of view 8"), "{broken}");
        let mut blind = black(8, 6);
        blind.counts = vec![false; 6];
        assert!(refusal(vec![blind]).contains("no pixel of view 8"));
        let mut dark = black(8, 6);
        dark.gain[2] = 0.0;
        assert!(refusal(vec![dark]).contains("gain is 0"));
    }
}
