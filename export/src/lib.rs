//! The dataset outside its store: what leaves the farm, and how it comes back.
//!
//! | module | what |
//! | --- | --- |
//! | [`manifest`] | one row an image as JSON Lines, CSV and Parquet, written and read |
//! | [`selection`] | which materials and views leave |
//! | [`layout`] | images and metadata as folders of files, WebDataset shards or Hugging Face's Parquet |
//! | [`product`] | the files made of one image: EXR, NumPy array, preview, rectified |
//! | [`rectify`] | the sample warped to a square |
//! | [`card`] | README, plots and Croissant metadata of an export |
//! | [`mod@file`] | files that are there whole or not at all |
//! | [`import`] | a manifest and its images into a store |
//! | [`diff`] | two stores or manifests compared |
//! | [`observability`] | what images tell about parameters, as Parquet; how it goes on where it was stopped |
//! | [`statistics`] | what is in a store, in numbers |
//!
//! What is exported is a function of the store's images and of the options: no times, no hosts, no
//! order of threads. Never imports the renderer.

pub mod card;
pub mod diff;
mod error;
pub mod file;
pub mod import;
pub mod layout;
pub mod manifest;
pub mod observability;
mod plan_difference;
pub mod product;
pub mod rectify;
pub mod selection;
pub mod statistics;

pub use error::ExportError;
