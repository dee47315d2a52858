//! Which materials and views leave.

use crate::error::ExportError;
use dataset::{
    CompletedView, PixelStatistics, Specification, Split, condition::Condition, manifest::Row,
};
use datastore::ReadOnlyStore;
use imagestore::validation::decode;

/// What is wanted of a store.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Selection {
    /// The views; all where there is no list. Order and repetition mean nothing.
    pub views: Option<Vec<u32>>,
    /// The split; all where there is none.
    pub split: Option<Split>,
    /// What holds for the materials; all where there is none.
    pub condition: Option<Condition>,
    /// Take what is complete, where not everything is.
    pub partial: bool,
}

/// What is there of it.
#[derive(Clone, Debug, PartialEq)]
pub struct Chosen {
    /// Complete materials, in order.
    pub materials: Vec<u32>,
    /// Views, in order.
    pub views: Vec<u32>,
    /// Materials wanted that are not complete.
    pub materials_missing: u32,
    /// What holds for the materials.
    pub condition: Option<Condition>,
}

/// An image with its row.
#[derive(Clone, Debug)]
pub struct ChosenImage {
    /// The view's index.
    pub view: u32,
    /// The image's file and statistics.
    pub done: CompletedView,
    /// Its row, with the path in the store.
    pub row: Row,
}

impl Selection {
    /// Whether a material is wanted, complete or not.
    pub fn wants(&self, specification: &Specification, material: u32) -> bool {
        let split = specification.split(material);
        let of_split = self.split.is_none_or(|wanted| wanted == split);
        let holds =
            |condition: &Condition| condition.holds(&specification.material(material), split);
        of_split && self.condition.as_ref().is_none_or(holds)
    }

    /// Looks up what a store has of it.
    ///
    /// # Errors
    /// When a view does not exist, no material is wanted, or materials are missing and a part is not enough.
    pub fn choose(&self, store: &ReadOnlyStore) -> Result<Chosen, ExportError> {
        let specification = store.specification();
        let count = specification.views.len();
        let mut views = match &self.views {
            Some(views) => views.clone(),
            None => (0..count as u32).collect(),
        };
        views.sort_unstable();
        views.dedup();
        if let Some(&view) = views.iter().find(|view| **view as usize >= count) {
            return Err(ExportError::NoSuchView { view, count });
        }
        let wanted: Vec<u32> = (0..specification.materials)
            .filter(|&material| self.wants(specification, material))
            .collect();
        if let Some(condition) = self.condition.as_ref().filter(|_| wanted.is_empty()) {
            return Err(ExportError::NoMaterial(condition.clone()));
        }
        let materials: Vec<u32> = wanted
            .iter()
            .copied()
            .filter(|&material| store.is_complete(material))
            .collect();
        let materials_missing = (wanted.len() - materials.len()) as u32;
        if materials_missing > 0 && !self.partial {
            return Err(ExportError::Incomplete {
                store: store.name().clone(),
                missing: materials_missing,
                materials: wanted.len() as u32,
            });
        }
        Ok(Chosen {
            materials,
            views,
            materials_missing,
            condition: self.condition.clone(),
        })
    }
}

impl Chosen {
    /// How many images that are.
    pub fn images(&self) -> u64 {
        self.materials.len() as u64 * self.views.len() as u64
    }

    /// The files of the chosen images of one of the materials, with their views.
    pub fn files_of(
        &self,
        store: &ReadOnlyStore,
        material: u32,
    ) -> Result<Vec<(u32, CompletedView)>, ExportError> {
        let completion = store.completion(material)?;
        // It was whole when the store was opened.
        let completion = completion.ok_or_else(|| ExportError::Image {
            path: store.records_place(),
            reason: format!("the record of material {material} was damaged meanwhile"),
        })?;
        if completion.views.len() != store.specification().views.len() {
            return Err(ExportError::Views(material));
        }
        let views = self.views.iter();
        Ok(views
            .map(|&view| (view, completion.views[view as usize].clone()))
            .collect())
    }

    /// The chosen images of one of the materials, with whole rows. Images are read whose brightness an
    /// earlier version did not record.
    pub fn images_of(
        &self,
        store: &ReadOnlyStore,
        material: u32,
    ) -> Result<Vec<ChosenImage>, ExportError> {
        let specification = store.specification();
        let hash = store.specification_hash();
        let sampled = specification.material(material);
        let images = self.files_of(store, material)?.into_iter();
        let images = images.map(|(view, done)| {
            let whole = with_brightness(store, view, &done)?;
            let row = Row::new(specification, hash, &sampled, view, &whole);
            Ok(ChosenImage { view, done, row })
        });
        images.collect()
    }
}

/// What is known of an image, with its brightness: from its pixels where an earlier version recorded
/// none.
pub(crate) fn with_brightness(
    store: &ReadOnlyStore,
    view: u32,
    done: &CompletedView,
) -> Result<CompletedView, ExportError> {
    let pixels = match done.pixels {
        Some(pixels) => pixels,
        None => pixel_statistics(store, view, done)?,
    };
    Ok(CompletedView {
        pixels: Some(pixels),
        ..done.clone()
    })
}

/// The brightness of an image, from its pixels.
fn pixel_statistics(
    store: &ReadOnlyStore,
    view: u32,
    done: &CompletedView,
) -> Result<PixelStatistics, ExportError> {
    let faulty = |reason| ExportError::Image {
        path: store.image_path(&done.digest),
        reason,
    };
    let bytes = store
        .read_image(done)
        .map_err(|fault| faulty(fault.to_string()))?;
    let decoded = decode(&bytes, store.specification());
    let pixels = decoded
        .map_err(|rejection| faulty(rejection.to_string()))?
        .pixels;
    PixelStatistics::of(store.specification(), view, pixels.iter().copied())
        .ok_or_else(|| faulty("it is no image of this view".to_owned()))
}
