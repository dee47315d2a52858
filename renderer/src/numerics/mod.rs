//! Quadrature, series, polygons and elementary functions, and the instruction sets that kernels are
//! compiled for. Knows nothing of light.

pub mod batch;
pub mod channels;
pub mod chebyshev;
pub mod elementary;
pub mod gauss;
pub mod instructions;
pub mod polygon;
pub mod tolerance;
