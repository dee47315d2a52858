//! `brdfarm dataset export`.

use super::{StoreOptions, show};
use crate::failure::BadInput;
use crate::plural::count;
use crate::{cores, picture, progress};
use clap::{Args, ValueEnum};
use dataset::condition::Condition;
use dataset::{IndexList, Split};
use datastore::ReadOnlyStore;
use export::card::{Licence, Publication};
use export::layout::{self, Layout, Place, SHARD_BYTES, export};
use export::manifest::Exported;
use export::product::Products;
use export::rectify::SIDE_PIXELS_MAX;
use export::selection::Selection;
use imagestore::{Bucket, BucketUrl};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// Materials on the picture of the dataset card.
const EXAMPLE_MATERIALS_MAX: usize = 6;

/// Export images and labels so that stock loaders open them
///
/// Writes the images, a manifest, a dataset card with plots, Croissant metadata and the
/// specification into a folder. The same images and options give the same bytes. If the export is
/// stopped, the same command resumes it.
#[derive(Debug, Args)]
pub struct Options {
    #[command(flatten)]
    store: StoreOptions,
    /// Where to write: an empty or a new folder, a place in a bucket such as s3://BUCKET/PREFIX, or
    /// an unfinished export to resume
    #[arg(value_name = "DIR|URL")]
    folder: PathBuf,
    /// The layout of the files
    #[arg(long, value_enum)]
    layout: LayoutName,
    /// The views to export, as in 5,8 or 0-3 [default: all]
    #[arg(long, value_name = "LIST")]
    views: Option<IndexList>,
    /// The split to export [default: all]
    #[arg(long, value_enum)]
    split: Option<SplitName>,
    /// The materials to export, by their labels, as in "roughness < 20 and split == 'train'". The
    /// condition may use and, or, not, parentheses, and the labels material, roughness, anisotropy,
    /// angle_deg, ior, split, and colours such as rgb0_linear_0 or rgb90_lab_2 [default: all]
    #[arg(long = "where", value_name = "CONDITION")]
    condition: Option<Condition>,
    /// Also write pixels as NumPy arrays of the images' type, which need no EXR reader
    #[arg(long)]
    npy: bool,
    /// Also write previews: sRGB, 8 bits, clipped at white
    #[arg(long)]
    png: bool,
    /// Brightness of the previews, in stops: each doubles it
    #[arg(long, default_value_t = 0.0, value_name = "STOPS", allow_negative_numbers = true,
          requires = "png", value_parser = picture::parse_exposure)]
    exposure: f64,
    /// Also write the sample of each image, warped to a square of N pixels a side with area weighting
    #[arg(long, value_name = "N",
          value_parser = clap::value_parser!(u32).range(1..=i64::from(SIDE_PIXELS_MAX)))]
    rectified: Option<u32>,
    /// Export the complete materials even if others are missing
    #[arg(long)]
    partial: bool,
    /// Make hard links to the store's images instead of copies (layout files, one file system). To
    /// change such a file changes the store
    #[arg(long)]
    links: bool,
    /// Replace another export in the same folder. Only what an export writes is removed; if the folder
    /// holds anything else, it is refused
    #[arg(long)]
    overwrite: bool,
    /// Approximate size of a shard, in megabytes
    #[arg(long, default_value_t = SHARD_BYTES / MEGABYTE, value_name = "MB",
          value_parser = clap::value_parser!(u64).range(1..=1 << 20))]
    shard_megabytes: u64,
    /// The images' licence: an SPDX expression such as CC-BY-4.0, or the https:// address of its text
    #[arg(long, default_value = "unknown", value_name = "SPDX|URL")]
    licence: Licence,
    /// Who publishes the set
    #[arg(long, value_name = "NAME", value_parser = parse_line)]
    creator: Option<String>,
    /// Where the set is published
    #[arg(long, value_name = "URL", value_parser = parse_line)]
    url: Option<String>,
    /// When it is published, as YYYY-MM-DD
    #[arg(long, value_name = "DATE", value_parser = parse_date)]
    published: Option<String>,
    /// Threads; 0 takes one for each core
    #[arg(long, default_value_t = 0, value_name = "N",
          value_parser = clap::value_parser!(u64).range(..=cores::COUNT_MAX))]
    threads: u64,
}

const MEGABYTE: u64 = 1_000_000;

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum LayoutName {
    /// train/000123/v05.exr
    Files,
    /// Tar shards, a sample a material: 000123.v05.exr, 000123.v05.json
    Webdataset,
    /// Parquet shards of labels and images, for `datasets.load_dataset`
    Huggingface,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum SplitName {
    Train,
    Validation,
    Test,
}

/// A place in a bucket, where a path is meant so, or a folder.
pub fn place(path: &Path) -> anyhow::Result<Place> {
    match path.to_str() {
        Some(url) if BucketUrl::is_meant(url) => Ok(Place::Bucket(Bucket::open(
            &url.parse().map_err(BadInput)?,
        )?)),
        _ => Ok(Place::Folder(path.to_owned())),
    }
}

/// Exports a store.
pub fn execute(options: &Options) -> anyhow::Result<()> {
    let layout = match options.layout {
        LayoutName::Files => Layout::Files {
            links: options.links,
        },
        _ if options.links => {
            return Err(BadInput("--links needs --layout files".to_owned()).into());
        }
        LayoutName::Webdataset => Layout::WebDataset,
        LayoutName::Huggingface => Layout::HuggingFace,
    };
    let place = place(&options.folder)?;
    let store = ReadOnlyStore::open(&options.store.store)?;
    if options.links && (!store.has_files() || matches!(place, Place::Bucket(_))) {
        return Err(BadInput("--links needs images and export in folders".to_owned()).into());
    }
    let view_count = store.specification().views.len() as u32;
    let views = options
        .views
        .as_ref()
        .map(|views| views.below(view_count, "view"));
    let export_options = layout::Options {
        layout,
        selection: Selection {
            views: views.transpose()?,
            split: options.split.map(SplitName::split),
            condition: options.condition.clone(),
            partial: options.partial,
        },
        products: Products {
            npy: options.npy,
            png_exposure_stops: options.png.then_some(options.exposure),
            rectified_side: options.rectified,
        },
        shard_bytes: options.shard_megabytes * MEGABYTE,
        threads: cores::count(options.threads),
        publication: Publication {
            licence: options.licence.clone(),
            creator: options.creator.clone(),
            url: options.url.clone(),
            date: options.published.clone(),
        },
        overwrite: options.overwrite,
    };
    let chosen = export_options.selection.choose(&store)?;
    let examples = &chosen.materials[..chosen.materials.len().min(EXAMPLE_MATERIALS_MAX)];
    let examples = show::sheet(&store, examples, &chosen.views, 0.0)?;
    let bar = progress::bar(chosen.images(), "images exported");
    let exported = export(
        &store,
        &export_options,
        &examples,
        place.clone(),
        &|images| {
            bar.set_position(images);
        },
    );
    bar.finish_and_clear();
    let exported = exported?;
    tell(&place, &exported)
}

/// Says how many images were exported, and how many materials are missing.
fn tell(place: &Place, exported: &Exported) -> anyhow::Result<()> {
    let mut out = io::stdout();
    write!(
        out,
        "{}: {}",
        place.name().display(),
        count(exported.rows, "image")
    )?;
    if exported.materials_missing > 0 {
        let missing = count(exported.materials_missing, "material");
        write!(out, ", {missing} missing")?;
    }
    writeln!(out)?;
    Ok(())
}

impl SplitName {
    fn split(self) -> Split {
        match self {
            Self::Train => Split::Train,
            Self::Validation => Split::Validation,
            Self::Test => Split::Test,
        }
    }
}

/// The longest text that goes into card and metadata, in bytes.
const LINE_BYTES_MAX: usize = 1000;

fn parse_line(text: &str) -> Result<String, String> {
    let plain =
        !text.is_empty() && text.len() <= LINE_BYTES_MAX && !text.contains(char::is_control);
    plain
        .then(|| text.to_owned())
        .ok_or_else(|| format!("it has to be one line of 1 to {LINE_BYTES_MAX} bytes"))
}

fn parse_date(text: &str) -> Result<String, String> {
    let digits =
        |part: &str, count| part.len() == count && part.bytes().all(|b| b.is_ascii_digit());
    let parts: Vec<&str> = text.split('-').collect();
    match *parts {
        [year, month, day] if digits(year, 4) && digits(month, 2) && digits(day, 2) => {
            Ok(text.to_owned())
        }
        _ => Err("a date is YYYY-MM-DD".to_owned()),
    }
}
