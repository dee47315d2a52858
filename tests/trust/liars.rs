//! How workers lie.

/// A liar, and when it lies.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Liar {
    /// All it delivers is wrong.
    Always,
    /// The same, under another name as soon as it is blocked.
    Renamed,
    /// The same, as two workers of one credential that tell the same lies.
    TwoNames,
    /// It tells the truth where the coordinator knows the true digests already.
    KnowsRedundantRenders,
    /// Its images are right, and said to be better than they are.
    StatisticsOnly,
    /// Its images are right, and said to be brighter than they are.
    BrightnessOnly,
    /// It tells the truth of its first materials, those that newcomers are watched for.
    HonestAtFirst,
    /// It is honest of its own materials, and contradicts those of others.
    Slanderer,
    /// Its images have an attribute that the renderer writes none of, for whatever it holds.
    Headers,
    /// It lies about one material in ten.
    OneInTen,
}

impl Liar {
    pub const ALL: [Self; 10] = [
        Self::Always,
        Self::Renamed,
        Self::TwoNames,
        Self::KnowsRedundantRenders,
        Self::StatisticsOnly,
        Self::BrightnessOnly,
        Self::HonestAtFirst,
        Self::Slanderer,
        Self::Headers,
        Self::OneInTen,
    ];

    /// Whether none of its lies may be left in any set. Audits miss who is honest at first once in
    /// hundreds of sets, and who lies seldom more often.
    pub fn is_always_found(self) -> bool {
        !matches!(self, Self::HonestAtFirst | Self::OneInTen)
    }

    /// Whether it lies about the `number`th material that it delivers, `known` being whether the
    /// coordinator has its true images.
    pub fn lies(self, number: u32, material: u32, known: bool) -> bool {
        match self {
            Self::Always
            | Self::Renamed
            | Self::TwoNames
            | Self::StatisticsOnly
            | Self::BrightnessOnly
            | Self::Headers => true,
            Self::KnowsRedundantRenders => !known,
            Self::Slanderer => known,
            Self::HonestAtFirst => number >= limits::PROBATION,
            Self::OneInTen => material % 10 == 3,
        }
    }
}
