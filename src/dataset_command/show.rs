//! `brdfarm dataset show`.

use super::StoreOptions;
use crate::failure::BadInput;
use crate::output;
use crate::picture::{self, ContactSheet};
use anyhow::Context;
use clap::Args;
use coordinator::ReadOnlyStore;
use dataset::Digest;
use renderer::decode_exr;
use std::fs;
use std::io::{self, Write};
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};
use std::str::FromStr;

/// Make a contact sheet (PNG): a row a material, a column a view
///
/// Materials and views are numbered; colours are sRGB, clipped at white. What is not rendered yet
/// stays blank.
#[derive(Debug, Args)]
pub struct Options {
    #[command(flatten)]
    store: StoreOptions,
    /// Which materials, as in 0-11 or 3,5,8-10
    #[arg(long, default_value = "0-11", value_name = "LIST")]
    materials: IndexList,
    /// Which views [default: all]
    #[arg(long, value_name = "LIST")]
    views: Option<IndexList>,
    /// Brightness, in stops: each doubles it
    #[arg(long, default_value_t = 0.0, value_name = "STOPS", allow_negative_numbers = true,
          value_parser = picture::parse_exposure)]
    exposure: f64,
    /// Where to write, a .png file
    #[arg(long, default_value = "contact-sheet.png", value_name = "FILE")]
    out: PathBuf,
}

/// Indices and ranges of them, in the order given.
#[derive(Clone, Debug)]
struct IndexList(Vec<RangeInclusive<u32>>);

impl FromStr for IndexList {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let index = |text: &str| {
            text.trim()
                .parse::<u32>()
                .map_err(|_| format!("{text:?} is no index: write a list as in 3,5,8-10"))
        };
        text.split(',')
            .map(|part| {
                let (first, last) = part.split_once('-').unwrap_or((part, part));
                let range = index(first)?..=index(last)?;
                if range.is_empty() {
                    return Err(format!(
                        "{part:?} runs backwards: write the lower end first"
                    ));
                }
                Ok(range)
            })
            .collect::<Result<_, String>>()
            .map(Self)
    }
}

impl IndexList {
    /// The indices below `count`; naming one at or beyond it is an error, but ranges may end there.
    fn below(&self, count: u32, what: &str) -> Result<Vec<u32>, BadInput> {
        if let Some(range) = self.0.iter().find(|range| *range.start() >= count) {
            return Err(BadInput(format!(
                "there is no {what} {}: there are {count}, counted from 0",
                range.start()
            )));
        }
        let last = count.saturating_sub(1);
        Ok(self
            .0
            .iter()
            .flat_map(|range| *range.start()..=(*range.end()).min(last))
            .collect())
    }
}

/// Writes the sheet.
pub fn execute(options: &Options) -> anyhow::Result<()> {
    output::ending(&options.out, &["png"])?;
    let store = ReadOnlyStore::open(&options.store.store)?;
    let specification = store.specification();
    let view_count = specification.views.len() as u32;
    let materials = options
        .materials
        .below(specification.materials, "material")?;
    let views = match &options.views {
        Some(views) => views.below(view_count, "view")?,
        None => (0..view_count).collect(),
    };
    write_sheet(&store, &materials, &views, options.exposure, &options.out)?;
    writeln!(io::stdout(), "{}", options.out.display())?;
    Ok(())
}

/// Writes a sheet of these materials and views to a PNG file. Materials that are not complete stay
/// blank.
pub fn write_sheet(
    store: &ReadOnlyStore,
    materials: &[u32],
    views: &[u32],
    exposure_stops: f64,
    path: &Path,
) -> anyhow::Result<()> {
    let image = &store.specification().image;
    let mut sheet = ContactSheet::new(
        materials,
        views,
        [image.width, image.height],
        exposure_stops,
    )?;
    for (row, &material) in (0..).zip(materials) {
        let Some(completion) = store.completion(material)? else {
            continue;
        };
        for (column, &view) in (0..).zip(views) {
            let Some(view) = completion.views.get(view as usize) else {
                continue;
            };
            let place = store.image_path(&view.digest);
            let bytes =
                fs::read(&place).with_context(|| format!("cannot read {}", place.display()))?;
            anyhow::ensure!(
                Digest::of(&bytes) == view.digest,
                "{} is damaged: verify the store",
                place.display()
            );
            sheet.place(row, column, &decode_exr(&bytes)?);
        }
    }
    output::write(path, &sheet.finish()?)
}
