//! What two renderings of one material are compared by.

use dataset::{CompletedView, Digest, PixelStatistics};
use serde::{Deserialize, Deserializer, Serialize, Serializer, de::Error};
use std::fmt;

/// The digest of all images' digests, and that of everything that their worker said of them.
///
/// As text, and in records: 64 hexadecimal digits, two colons, 64 more. Earlier versions recorded nothing
/// of brightness and have one colon, or the first 64 digits alone. What was said is compared where both
/// said it of the same things; images are always.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Fingerprint {
    images: Digest,
    told: Told,
}

/// What a worker said of its images.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Told {
    Nothing,
    Errors(Digest),
    ErrorsAndPixels(Digest),
}

impl Fingerprint {
    /// That of a material's views, in the specification's order.
    pub fn of(views: &[CompletedView]) -> Self {
        let images = views.iter().flat_map(|view| *view.digest.as_bytes());
        let mut told: Vec<u8> = views.iter().flat_map(errors).collect();
        let pixels: Option<Vec<[u8; 40]>> = views.iter().map(pixels).collect();
        Self {
            images: Digest::of(&images.collect::<Vec<u8>>()),
            told: match pixels {
                None => Told::Errors(Digest::of(&told)),
                Some(pixels) => {
                    told.extend(pixels.as_flattened());
                    Told::ErrorsAndPixels(Digest::of(&told))
                }
            },
        }
    }

    /// That of images of which nothing was said, as earlier versions recorded it. `images` is the
    /// digest of all their digests.
    pub fn of_images(images: Digest) -> Self {
        Self {
            images,
            told: Told::Nothing,
        }
    }

    /// Whether both can be of the same rendering: images are equal, and what was said of them where
    /// both said it of the same things.
    pub fn agrees_with(self, other: Self) -> bool {
        let said_the_same = match (self.told, other.told) {
            (Told::Errors(one), Told::Errors(other))
            | (Told::ErrorsAndPixels(one), Told::ErrorsAndPixels(other)) => one == other,
            _ => true,
        };
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
        match &self.told {
            Told::Nothing => self.images.fmt(f),
            Told::Errors(told) => write!(f, "{}:{told}", self.images),
            Told::ErrorsAndPixels(told) => write!(f, "{}::{told}", self.images),
        }
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
        let digest = |text: &str| text.parse().map_err(D::Error::custom);
        Ok(match text.split_once(':') {
            None => Self::of_images(digest(&text)?),
            Some((images, told)) => Self {
                images: digest(images)?,
                told: match told.strip_prefix(':') {
                    None => Told::Errors(digest(told)?),
                    Some(told) => Told::ErrorsAndPixels(digest(told)?),
                },
            },
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

    #[test]
    fn records_of_earlier_versions_are_compared_by_their_images() {
        let written = serde_json::to_string(&of(|_| {})).unwrap();
        let (images, _) = written.trim_matches('"').split_once("::").unwrap();
        let without_pixels = |told: fn(&mut CompletedView)| {
            let written = of(|view| {
                view.pixels = None;
                told(view);
            });
            let written = serde_json::to_string(&written).unwrap();
            assert!(written.contains(':') && !written.contains("::"));
            serde_json::from_str::<Fingerprint>(&written).unwrap()
        };
        let honest = without_pixels(|_| {});
        assert!(honest.agrees_with(of(|_| {})));
        assert!(!honest.agrees_with(of(|view| view.digest = Digest::of(b"other"))));
        assert!(!honest.agrees_with(without_pixels(|view| view.statistics.mean = 0.0)));
        let earlier: Fingerprint = serde_json::from_str(&format!("\"{images}\"")).unwrap();
        assert!(earlier.agrees_with(of(|view| view.statistics.mean = 0.0)));
        assert!(!earlier.agrees_with(of(|view| view.digest = Digest::of(b"other"))));
        assert_eq!(
            serde_json::to_string(&earlier).unwrap(),
            format!("\"{images}\"")
        );
        assert_eq!(
            serde_json::from_str::<Fingerprint>(&written).unwrap(),
            of(|_| {})
        );
        for wrong in [
            "\"\"",
            "\":\"",
            "3",
            &format!("\"{images}:\""),
            &format!("{}:{images}\"", &written[..written.len() - 1]),
        ] {
            assert!(
                serde_json::from_str::<Fingerprint>(wrong).is_err(),
                "{wrong}"
            );
        }
    }
}
