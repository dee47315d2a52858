//! Reading a specification from TOML, over the preset, and from JSON.

use super::{
    Specification,
    check::check,
    error::SpecificationError,
    limits::TEXT_BYTES_MAX,
    reader::{Field, Reader, one_line},
};
use std::{collections::BTreeMap, fs::File, io::Read, path::Path, sync::LazyLock};
use toml::{
    Spanned,
    de::{DeTable, DeValue},
};

static PRESET: LazyLock<Specification> = LazyLock::new(|| {
    toml::from_str(Specification::PRESET_TOML)
        .unwrap_or_else(|error| unreachable!("the preset is complete, as a test shows: {error}"))
});

impl Specification {
    /// The file of the built-in preset, with the reason for each choice.
    pub const PRESET_TOML: &str = include_str!("../maxbrdf.toml");

    /// The built-in preset, `maxbrdf`: the paper's dataset.
    pub fn preset() -> Self {
        PRESET.clone()
    }

    /// Reads a TOML text over the preset: what it leaves out keeps the preset's value. If it has
    /// `[[views]]`, they replace all of the preset's; a view's table that leaves something out has
    /// camera and light at 45 degrees, no turn and no chart. A list replaces a list. An integer is
    /// accepted where a float is meant.
    ///
    /// # Errors
    ///
    /// The first fault found, as one sentence that starts with `source:line:column`; `source` is
    /// the file's name. A mesh has to be named by its digest, and is not loaded.
    pub fn from_toml(text: &str, source: &str) -> Result<Self, SpecificationError> {
        Self::from_text(text, source, None)
    }

    fn from_text(
        text: &str,
        source: &str,
        folder: Option<&Path>,
    ) -> Result<Self, SpecificationError> {
        if text.len() > TEXT_BYTES_MAX {
            let file = source.to_owned();
            return Err(SpecificationError::TooLarge { file });
        }
        let mut reader = Reader {
            source,
            text,
            folder,
            spans: BTreeMap::new(),
        };
        let table = DeTable::parse(text).map_err(|error| reader.syntax(&error))?;
        let mut specification = Self::preset();
        let document = Spanned::new(table.span(), DeValue::Table(table.into_inner()));
        specification.read(&document, "", &mut reader)?;
        check(&specification).map_err(|fault| reader.refused(fault))?;
        Ok(specification)
    }

    /// Reads a TOML file as [`Self::from_toml`] does, and loads the mesh that it names: a file in its
    /// folder or below it, or by its digest the file DIGEST.mesh in it.
    ///
    /// # Errors
    ///
    /// Also where the file cannot be read, has more than [`TEXT_BYTES_MAX`] bytes or is not UTF-8,
    /// and where the mesh cannot be loaded.
    pub fn load(path: &Path) -> Result<Self, SpecificationError> {
        Self::load_in(path, path.parent())
    }

    /// Reads a TOML file as [`Self::load`] does, and loads no mesh, which has to be named by its digest.
    ///
    /// # Errors
    ///
    /// As [`Self::from_toml`], and where the file cannot be read.
    pub fn load_without_mesh(path: &Path) -> Result<Self, SpecificationError> {
        Self::load_in(path, None)
    }

    fn load_in(path: &Path, folder: Option<&Path>) -> Result<Self, SpecificationError> {
        let file = path.display().to_string();
        let mut bytes = Vec::new();
        let read = File::open(path).and_then(|opened| {
            opened
                .take(TEXT_BYTES_MAX as u64 + 1)
                .read_to_end(&mut bytes)
        });
        if let Err(error) = read {
            return Err(SpecificationError::Unreadable { file, error });
        }
        if bytes.len() > TEXT_BYTES_MAX {
            return Err(SpecificationError::TooLarge { file });
        }
        match str::from_utf8(&bytes) {
            Ok(text) => Self::from_text(text, &file, folder),
            Err(error) => Err(SpecificationError::NotUtf8 {
                file,
                offset: error.valid_up_to(),
            }),
        }
    }

    /// Reads what [`Self::to_json`] wrote: every field is required, and checked like a file's. A mesh is
    /// not loaded: [`Self::with_mesh`].
    ///
    /// # Errors
    ///
    /// The first fault found, as one sentence.
    pub fn from_json(text: &str) -> Result<Self, SpecificationError> {
        const SOURCE: &str = "specification as JSON";
        if text.len() > TEXT_BYTES_MAX {
            let file = SOURCE.to_owned();
            return Err(SpecificationError::TooLarge { file });
        }
        let specification: Self =
            serde_json::from_str(text).map_err(|error| SpecificationError::Json {
                message: one_line(&error.to_string()),
            })?;
        let reader = Reader {
            source: SOURCE,
            text: "",
            folder: None,
            spans: BTreeMap::new(),
        };
        check(&specification).map_err(|fault| reader.refused(fault))?;
        Ok(specification)
    }
}
