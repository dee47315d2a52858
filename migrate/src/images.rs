//! Images on their way from one place to another, each checked on both sides.

use super::{Migrated, MigrationError};
use dataset::{CompletedView, Digest};
use datastore::{ImageFault, check_read};
use imagestore::blobs::Blobs;
use jobstore::kept::Entry;

/// An image and its place in the set.
type Place<'a> = (u32, u32, &'a CompletedView);

/// Puts the images of some materials under their names, durably, where they are not there as they
/// are recorded.
pub(super) fn copy_images(
    source: &Blobs,
    target: &Blobs,
    entries: &[Entry],
    migrated: &mut Migrated,
) -> Result<(), MigrationError> {
    let images = entries.iter().flat_map(|entry| {
        let views = entry.completion.iter().flat_map(|done| &done.views);
        let views = (0..).zip(views);
        views.map(|(view, image)| (entry.material, view, image))
    });
    let images: Vec<Place<'_>> = images.collect();
    let digests: Vec<Digest> = images.iter().map(|(.., image)| image.digest).collect();
    let sizes = target.sizes(&digests)?.into_iter();
    let (there, mut absent): (Vec<_>, Vec<_>) = images
        .into_iter()
        .zip(sizes)
        .partition(|((.., image), size)| *size == Some(image.bytes));
    let there: Vec<Place<'_>> = there.into_iter().map(|(image, _)| image).collect();
    let mut absent: Vec<Place<'_>> = absent.drain(..).map(|(image, _)| image).collect();
    // Of a copy that was cut short.
    read(target, &there, |place, read| {
        if read.is_err() {
            absent.push(place);
        }
        Ok(())
    })?;
    let mut written = Vec::with_capacity(absent.len());
    read(source, &absent, |(material, view, image), read| {
        let bytes = read.map_err(|fault| MigrationError::Image {
            material,
            view,
            path: source.path(&image.digest),
            fault,
        })?;
        migrated.bytes_written += bytes.len() as u64;
        written.push((image.digest, bytes));
        Ok(())
    })?;
    target.put(&written)?;
    migrated.images_written += written.len() as u64;
    drop(written);
    read(target, &absent, |(material, view, image), read| {
        let path = target.path(&image.digest);
        read.map(|_| ()).map_err(|fault| MigrationError::Copy {
            material,
            view,
            path,
            fault,
        })
    })
}

/// Reads images, compares them with what is recorded of them and hands each over.
fn read<'a>(
    blobs: &Blobs,
    images: &[Place<'a>],
    mut take: impl FnMut(Place<'a>, Result<Vec<u8>, ImageFault>) -> Result<(), MigrationError>,
) -> Result<(), MigrationError> {
    let named = images.iter().map(|(.., image)| (image.digest, image.bytes));
    let read = blobs.read_each(named.collect());
    for (place, read) in images.iter().zip(read) {
        take(*place, check_read(place.2, read))?;
    }
    Ok(())
}
