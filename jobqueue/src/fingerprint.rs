//! What two renderings of one material are compared by.

use dataset::{CompletedView, Digest};
use serde::{Deserialize, Deserializer, Serialize, Serializer, de::Error};
use std::fmt;

/// The digest of all images' digests, and that of everything that their worker said of their errors.
///
/// As text, and in records: 64 hexadecimal digits, a colon, 64 more. Records of earlier versions have
/// the first 64 alone; of these only images can be compared.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Fingerprint {
    images: Digest,
    statistics: Option<Digest>,
}

impl Fingerprint {
    /// That of a material's views, in the specification's order.
    pub fn of(views: &[CompletedView]) -> Self {
        let images = views.iter().flat_map(|view| *view.digest.as_bytes());
        let statistics = views.iter().flat_map(|view| {
            let told = &view.statistics;
            let reals = [told.mean, told.p95, told.max, told.within_target].map(f64::to_le_bytes);
            let counts = [told.samples, told.evaluations].map(u64::to_le_bytes);
            reals.into_iter().chain(counts).flatten()
        });
        Self {
            images: Digest::of(&images.collect::<Vec<u8>>()),
            statistics: Some(Digest::of(&statistics.collect::<Vec<u8>>())),
        }
    }

    /// That of images whose statistics are not known, as earlier versions recorded it. `images` is the
    /// digest of all their digests.
    pub fn of_images(images: Digest) -> Self {
        Self {
            images,
            statistics: None,
        }
    }

    /// Whether both can be of the same rendering: images are equal, and statistics where both are
    /// known.
    pub fn agrees_with(self, other: Self) -> bool {
        let statistics = self.statistics.zip(other.statistics);
        self.images == other.images && statistics.is_none_or(|(one, other)| one == other)
    }
}

impl fmt::Display for Fingerprint {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.statistics {
            Some(statistics) => write!(f, "{}:{statistics}", self.images),
            None => self.images.fmt(f),
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
            Some((images, statistics)) => Self {
                images: digest(images)?,
                statistics: Some(digest(statistics)?),
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
        ] {
            assert!(!lie.agrees_with(honest) && !honest.agrees_with(lie));
        }
    }

    #[test]
    fn records_of_earlier_versions_are_compared_by_their_images() {
        let written = serde_json::to_string(&of(|_| {})).unwrap();
        let (images, _) = written.trim_matches('"').split_once(':').unwrap();
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
        for wrong in ["\"\"", "\":\"", "3", &format!("\"{images}:\"")] {
            assert!(
                serde_json::from_str::<Fingerprint>(wrong).is_err(),
                "{wrong}"
            );
        }
    }
}
