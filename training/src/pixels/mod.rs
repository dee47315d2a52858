//! From linear pixels to a network's input.
//!
//! | module | what |
//! | --- | --- |
//! | [`encoding`] | linear light as codes |
//! | [`noise`] | a camera's noise, added to codes |
//! | [`normalisation`] | codes as numbers around 0: by channel, or whitened |

pub mod encoding;
pub mod noise;
pub mod normalisation;

/// Channels of a network's input: three of the oblique photograph, then three of the one from above.
pub const CHANNELS: usize = 6;
