//! Tar shards as the WebDataset format wants them: the members of a sample stand together and
//! share the name up to the first dot.
//!
//! Times and owners are zero and the order is the dataset's, so the same images make the same
//! bytes.

use super::{Unit, Work};
use crate::{error::ExportError, file::unable};
use std::io::Write;
use tar::{Builder, EntryType, Header};

/// Writes a shard.
pub(super) fn write(
    work: &Work<'_>,
    unit: &Unit,
    tell: &(dyn Fn() + Sync),
) -> Result<(), ExportError> {
    let path = &work.place.path(&unit.path);
    work.place.write(&unit.path, |file| {
        let mut shard = Builder::new(file);
        for &material in &unit.materials {
            work.each_image(unit, material, |image, products| {
                let key = format!("{material:06}.v{:02}", image.view);
                let labels =
                    serde_json::to_vec(&image.row).map_err(ExportError::encode("a row"))?;
                let mut put = |extension: &str, bytes: &[u8]| {
                    append(&mut shard, &format!("{key}.{extension}"), bytes)
                        .map_err(unable("write", path))
                };
                for product in products {
                    put(product.kind.extension, &product.bytes)?;
                }
                put("json", &labels)?;
                tell();
                Ok(())
            })?;
        }
        Ok(shard.finish().map_err(unable("write", path))?)
    })
}

fn append(shard: &mut Builder<impl Write>, name: &str, bytes: &[u8]) -> std::io::Result<()> {
    let mut header = Header::new_ustar();
    header.set_entry_type(EntryType::Regular);
    header.set_mode(0o644);
    header.set_uid(0);
    header.set_gid(0);
    header.set_mtime(0);
    header.set_size(bytes.len() as u64);
    shard.append_data(&mut header, name, bytes)
}
