//! Manifests and shards of images that come in.

use crate::{fixtures::SPECIFICATION, seeds};
use dataset::manifest::Row;
use export::{
    import::{ImportError, read_images},
    manifest::{
        Format,
        read::{ReadError, read, read_specification},
    },
};
use std::{fmt::Write, fs, path::Path, sync::LazyLock};
use tempfile::TempDir;

static FOLDER: LazyLock<TempDir> = LazyLock::new(|| tempfile::tempdir().unwrap());

/// A manifest as JSON Lines.
pub fn manifest_jsonl(bytes: &[u8]) -> bool {
    manifest(bytes, "manifest.jsonl")
}

/// A manifest as CSV.
pub fn manifest_csv(bytes: &[u8]) -> bool {
    manifest(bytes, "manifest.csv")
}

/// A manifest as Parquet.
pub fn manifest_parquet(bytes: &[u8]) -> bool {
    let accepted = manifest(bytes, "manifest.parquet");
    let specification = read_specification(&FOLDER.path().join("manifest.parquet"));
    accepted || specification.is_ok()
}

/// Reads rows, and compares them with what the specification gives, as an import does.
fn manifest(bytes: &[u8], name: &str) -> bool {
    let path = FOLDER.path().join(name);
    fs::write(&path, bytes).unwrap();
    let mut rows = 0;
    let outcome = read::<ReadError>(&path, |number, row: Row| {
        rows += 1;
        assert_eq!(number, rows);
        assert!(row.first_difference(&row).is_none());
        row.image();
        // A digest that is none is found when it is asked for.
        drop(row.completed_view());
        Ok(())
    });
    // There are no images beside it: what is right ends there.
    let images = read_images(&SPECIFICATION, &path, &FOLDER.path().into(), &mut |_, _| {
        Ok(())
    });
    if rows > 0 && outcome.is_ok() {
        assert!(images.is_err());
    }
    rows > 0
}

/// A folder with a manifest whose images are in one shard.
static SHARDS: LazyLock<TempDir> = LazyLock::new(|| {
    let folder = tempfile::tempdir().unwrap();
    let store = seeds::store(&folder.path().join("store"));
    let rows = seeds::manifest(&store, Format::Jsonl, folder.path());
    let rows = String::from_utf8(rows).unwrap();
    for (name, shard) in [
        ("tar.jsonl", "shard.tar"),
        ("parquet.jsonl", "shard.parquet"),
    ] {
        let mut manifest = String::new();
        for row in rows.lines() {
            let mut row: serde_json::Value = serde_json::from_str(row).unwrap();
            row["path"] = shard.into();
            writeln!(manifest, "{row}").unwrap();
        }
        fs::write(folder.path().join(name), manifest).unwrap();
    }
    folder
});

/// Images in a tar shard.
pub fn shard_tar(bytes: &[u8]) -> bool {
    shard(bytes, "shard.tar", &SHARDS.path().join("tar.jsonl"))
}

/// Images in a Parquet shard.
pub fn shard_parquet(bytes: &[u8]) -> bool {
    shard(bytes, "shard.parquet", &SHARDS.path().join("parquet.jsonl"))
}

/// Finds the images of a manifest in a shard.
fn shard(bytes: &[u8], name: &str, manifest: &Path) -> bool {
    const IMAGE_BYTES_MAX: usize = 1 << 20;
    fs::write(SHARDS.path().join(name), bytes).unwrap();
    let mut materials = 0;
    let outcome = read_images(
        &SPECIFICATION,
        manifest,
        &SHARDS.path().into(),
        &mut |_, files| {
            materials += 1;
            assert_eq!(files.len(), SPECIFICATION.views.len());
            assert!(files.iter().all(|file| file.len() <= IMAGE_BYTES_MAX));
            Ok(())
        },
    );
    if let Err(error) = outcome {
        let expected = matches!(
            error,
            ImportError::Shard { .. } | ImportError::Image { .. } | ImportError::File(_)
        );
        assert!(expected, "{error}");
    }
    materials > 0
}
