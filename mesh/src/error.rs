//! Why a file is no mesh that can be rendered.

/// Why a file is no mesh that can be rendered: one sentence, which names the place.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum MeshError {
    /// Nothing is left to be rendered.
    #[error("the mesh has no triangle with an area")]
    Empty,
}
