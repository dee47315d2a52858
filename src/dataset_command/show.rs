//! `brdfarm dataset show`.

use super::StoreOptions;
use crate::failure::BadInput;
use crate::output;
use crate::picture::{self, ContactSheet};
use anyhow::Context;
use clap::Args;
use dataset::IndexList;
use dataset::condition::Condition;
use datastore::ReadOnlyStore;
use export::file::write_bytes;
use export::selection::Selection;
use renderer::decode_exr;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// Materials on a sheet where nobody says which.
const MATERIALS_SHOWN: usize = 12;

/// Make a contact sheet (PNG): one row for each material, one column for each view
///
/// Materials and views are numbered. Colours are sRGB, clipped at white. Materials that are not
/// complete stay blank.
#[derive(Debug, Args)]
pub struct Options {
    #[command(flatten)]
    store: StoreOptions,
    /// The materials, as in 0-11 or 3,5,8-10 [default: the first 12]
    #[arg(long, value_name = "LIST")]
    materials: Option<IndexList>,
    /// Only materials whose labels satisfy this condition, as in "roughness < 20 and split == 'train'".
    /// `brdfarm dataset export --help` lists the labels
    #[arg(long = "where", value_name = "CONDITION")]
    condition: Option<Condition>,
    /// The views [default: all]
    #[arg(long, value_name = "LIST")]
    views: Option<IndexList>,
    /// Brightness, in stops: each doubles it
    #[arg(long, default_value_t = 0.0, value_name = "STOPS", allow_negative_numbers = true,
          value_parser = picture::parse_exposure)]
    exposure: f64,
    /// The .png file to write
    #[arg(long, default_value = "contact-sheet.png", value_name = "FILE")]
    out: PathBuf,
}

/// Writes the sheet.
pub fn execute(options: &Options) -> anyhow::Result<()> {
    output::ending("--out", &options.out, &["png"])?;
    let store = ReadOnlyStore::open(&options.store.store)?;
    let specification = store.specification();
    let view_count = specification.views.len() as u32;
    let wanted = Selection {
        condition: options.condition.clone(),
        ..Selection::default()
    };
    let wants = |material: &u32| wanted.wants(specification, *material);
    let materials: Vec<u32> = match &options.materials {
        Some(materials) => {
            let materials = materials.below(specification.materials, "material")?;
            materials.into_iter().filter(wants).collect()
        }
        None => (0..specification.materials)
            .filter(wants)
            .take(MATERIALS_SHOWN)
            .collect(),
    };
    if materials.is_empty() {
        return Err(BadInput("--where: no material satisfies it".to_owned()).into());
    }
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
    Ok(write_bytes(
        path,
        &sheet(store, materials, views, exposure_stops)?,
    )?)
}

/// Such a sheet as PNG.
pub fn sheet(
    store: &ReadOnlyStore,
    materials: &[u32],
    views: &[u32],
    exposure_stops: f64,
) -> anyhow::Result<Vec<u8>> {
    let image = &store.specification().image;
    let tile = [image.width, image.height];
    let sheet = ContactSheet::new(materials, views, tile, exposure_stops)?;
    sheet.to_png(|material, band| {
        let Some(completion) = store.completion(material)? else {
            return Ok(());
        };
        for (column, &view) in (0..).zip(views) {
            let Some(view) = completion.views.get(view as usize) else {
                continue;
            };
            let bytes = store.read_image(view).with_context(|| {
                let place = store.image_path(&view.digest);
                format!("{} is damaged: verify the store", place.display())
            })?;
            band.place(column, &decode_exr(&bytes)?);
        }
        Ok(())
    })
}
