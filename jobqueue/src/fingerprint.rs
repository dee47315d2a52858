//! What two renderings of one material are compared by.

use dataset::{CompletedView, Digest, ParseDigestError, PixelStatistics};
use serde::{Deserialize, Deserializer, Serialize, Serializer, de::Error};
use std::fmt;

/// The digest of all images' digests, and those of what their worker said of their errors and of their
/// brightness.
///
/// As text, and in records: 64 hexadecimal digits, a colon, 32 more, a colon, 32 more. Earlier versions
/// recorded nothing of brightness, or the first 64 digits alone; what one of two lacks is not compared.
/// Whoever says nothing of brightness hides nothing: it is a function of the images.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Fingerprint {
    images: Digest,
    told: Option<Told>,
}

/// What a worker said of its images.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Told {
    errors: Half,
    pixels: Option<Half>,
}

/// The first half of a digest. There is one for each of millions of jobs; and who lies has to meet that
/// of an honest worker, which takes 2^128 attempts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Half([u8; 16]);

impl Half {
    fn of(told: &[u8]) -> Self {
        Self::first(&Digest::of(told))
    }

    fn first(digest: &Digest) -> Self {
        Self(std::array::from_fn(|place| digest.as_bytes()[place]))
    }

    /// Of 32 hexadecimal digits, or of the 64 of a whole digest, which earlier versions recorded.
    fn parse(text: &str) -> Result<Self, ParseDigestError> {
        match text.len() {
            32 => Ok(Self::first(&format!("{text}{text}").parse()?)),
            _ => Ok(Self::first(&text.parse()?)),
        }
    }
}

impl fmt::Display for Half {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.iter().try_for_each(|byte| write!(f, "{byte:02x}"))
    }
}

impl Fingerprint {
    /// That of a material's views, in the specification's order.
    pub fn of(views: &[CompletedView]) -> Self {
        let images = views.iter().flat_map(|view| *view.digest.as_bytes());
        let errors: Vec<u8> = views.iter().flat_map(errors).collect();
        let pixels: Option<Vec<[u8; 40]>> = views.iter().map(pixels).collect();
        Self {
            images: Digest::of(&images.collect::<Vec<u8>>()),
            told: Some(Told {
                errors: Half::of(&errors),
                pixels: pixels.map(|pixels| Half::of(pixels.as_flattened())),
            }),
        }
    }

    /// That of images of which nothing was said, as earlier versions recorded it. `images` is the
    /// digest of all their digests.
    pub fn of_images(images: Digest) -> Self {
        Self { images, told: None }
    }

    /// Whether both can be of the same rendering: images are equal, and what was said of them where
    /// both said it.
    pub fn agrees_with(self, other: Self) -> bool {
        let said_the_same = self.told.zip(other.told).is_none_or(|(one, other)| {
            let pixels = one.pixels.zip(other.pixels);
            one.errors == other.errors && pixels.is_none_or(|(one, other)| one == other)
        });
        self.images == other.images && said_the_same
    }
}

fn errors(view: &CompletedView) -> impl Iterator<Item = u8> {
    let told = &view.statistics;
    let reals = [told.mean, told.p95, told.max, told.within_target].map(f64::to_le_bytes);
    let counts = [told.samples, told.evaluations].map(u64::to_le_bytes);
    reals.into_iter().chain(counts).flatten()
}

fn pixels(view: &CompletedView) -> Option<[u8; 40]> {
    let PixelStatistics {
        sample_share,
        brightness_mean,
        brightness_p99,
        dark_share,
        above_white_share,
    } = view.pixels?;
    let numbers = [
        sample_share,
        brightness_mean,
        brightness_p99,
        dark_share,
        above_white_share,
    ];
    let mut bytes = [0; 40];
    for (place, number) in bytes.chunks_exact_mut(8).zip(numbers) {
        place.copy_from_slice(&number.to_le_bytes());
    }
    Some(bytes)
}

impl fmt::Display for Fingerprint {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.images.fmt(f)?;
        let Some(Told { errors, pixels }) = &self.told else {
            return Ok(());
        };
        write!(f, ":{errors}")?;
        pixels.map_or(Ok(()), |pixels| write!(f, ":{pixels}"))
    }
}

impl Serialize for Fingerprint {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

impl<'de> Deserialize<'de> for Fingerprint {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let text = String::deserialize(deserializer)?;
        let mut parts = text.splitn(3, ':');
        let images = parts.next().unwrap_or_default();
        let mut half = || parts.next().map(Half::parse).transpose();
        let errors = half().map_err(D::Error::custom)?;
        let pixels = half().map_err(D::Error::custom)?;
        Ok(Self {
            images: images.parse().map_err(D::Error::custom)?,
            told: errors.map(|errors| Told { errors, pixels }),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Completion;

    fn of(change: impl FnOnce(&mut CompletedView)) -> Fingerprint {
        let mut completion = Completion::sample(1, b"image");
        change(&mut completion.views[0]);
        completion.fingerprint()
    }

    fn told(lie: impl FnOnce(&mut PixelStatistics)) -> Fingerprint {
        of(|view| lie(view.pixels.as_mut().unwrap()))
    }

    #[test]
    fn every_number_that_a_worker_tells_counts() {
        let honest = of(|_| {});
        assert!(honest.agrees_with(of(|_| {})));
        for lie in [
            of(|view| view.digest = Digest::of(b"other")),
            of(|view| view.statistics.mean = 0.0),
            of(|view| view.statistics.p95 = 0.0),
            of(|view| view.statistics.max = 0.0),
            of(|view| view.statistics.within_target = 1.0),
            of(|view| view.statistics.samples += 1),
            of(|view| view.statistics.evaluations += 1),
            told(|pixels| pixels.sample_share += 0.1),
            told(|pixels| pixels.brightness_mean += 0.1),
            told(|pixels| pixels.brightness_p99 += 0.1),
            told(|pixels| pixels.dark_share += 0.1),
            told(|pixels| pixels.above_white_share += 0.1),
        ] {
            assert!(!lie.agrees_with(honest) && !honest.agrees_with(lie));
        }
    }

    /// Who leaves its brightness out is compared by all the rest, whichever of the two it is.
    #[test]
    fn saying_less_hides_no_lie() {
        let honest = of(|_| {});
        let silent = of(|view| view.pixels = None);
        assert!(silent.agrees_with(honest) && honest.agrees_with(silent));
        let lie = of(|view| {
            view.pixels = None;
            view.statistics.mean = 0.0;
        });
        assert!(!lie.agrees_with(honest) && !honest.agrees_with(lie));
    }

    #[test]
    fn records_of_earlier_versions_are_compared_by_what_they_have() {
        let written = serde_json::to_string(&of(|_| {})).unwrap();
        let read = |text: &str| serde_json::from_str::<Fingerprint>(&format!("\"{text}\""));
        assert_eq!(read(written.trim_matches('"')).unwrap(), of(|_| {}));
        let parts: Vec<&str> = written.trim_matches('"').split(':').collect();
        let [images, errors, pixels] = parts[..] else {
            panic!("{written}");
        };
        assert_eq!([images.len(), errors.len(), pixels.len()], [64, 32, 32]);

        let images_alone = read(images).unwrap();
        assert!(images_alone.agrees_with(of(|view| view.statistics.mean = 0.0)));
        assert!(!images_alone.agrees_with(of(|view| view.digest = Digest::of(b"other"))));
        assert_eq!(images_alone.to_string(), images);

        // A whole digest of what was said of errors, as versions wrote it that recorded no brightness.
        let whole = format!("{images}:{errors}{}", "0".repeat(32));
        let without_pixels = read(&whole).unwrap();
        assert!(without_pixels.agrees_with(of(|_| {})));
        assert!(without_pixels.agrees_with(told(|pixels| pixels.dark_share += 0.1)));
        assert!(!without_pixels.agrees_with(of(|view| view.statistics.mean = 0.0)));
        for wrong in [
            String::new(),
            ":".to_owned(),
            "3".to_owned(),
            format!("{images}:"),
            format!("{images}:{errors}:"),
            format!("{images}:{errors}0"),
            format!("{images}:{errors}:{pixels}:{pixels}"),
            format!("{images}::{pixels}"),
            format!("{images}:{}", "é".repeat(16)),
        ] {
            assert!(read(&wrong).is_err(), "{wrong}");
        }
    }
}
