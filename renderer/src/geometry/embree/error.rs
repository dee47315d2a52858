//! Why Embree cannot be used.

/// Why Embree cannot be used.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum EmbreeError {
    /// `EMBREE_LIBRARY` is set and what it names does not work.
    #[error("EMBREE_LIBRARY names {path:?}, which cannot be used: {reason}")]
    Named {
        /// The variable's value.
        path: String,
        /// What went wrong with it.
        reason: String,
    },
    /// No path that is searched holds a library that works.
    #[error(
        "no usable Embree library was found ({tried}): run deploy/fetch-embree.sh, or set \
         EMBREE_LIBRARY to the path of libembree4.so.4"
    )]
    Missing {
        /// Each path, and what went wrong there.
        tried: String,
    },
    /// The library loads but refuses to run here.
    #[error("Embree cannot run {wanted} on this machine: {reason}")]
    Device {
        /// The instruction set that was asked for.
        wanted: String,
        /// What Embree says.
        reason: &'static str,
    },
    /// A step of building the scene failed.
    #[error("Embree could not build the scene: {call} failed: {reason}")]
    Build {
        /// The function of Embree's interface.
        call: &'static str,
        /// What Embree says.
        reason: &'static str,
    },
}
