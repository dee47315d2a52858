//! Trainings from end to end, in process: on rendered pairs, and on drawn ones where the pixels do
//! not matter.

#![allow(clippy::unwrap_used, reason = "a panic here is a failed test")]

mod overfit;
mod pairs;
mod twin;
