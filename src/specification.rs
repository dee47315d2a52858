//! Which specification a command works on.

use clap::Args;
use dataset::{Specification, specification::limits};
use std::path::PathBuf;

/// The dataset's specification.
#[derive(Clone, Debug, Args)]
pub struct SpecificationOptions {
    /// The dataset's specification, a TOML file. Fields that it leaves out are as in the preset
    /// maxbrdf [default: the preset]
    #[arg(long, value_name = "FILE")]
    spec: Option<PathBuf>,
}

impl SpecificationOptions {
    /// The specification of the file, or the preset.
    pub fn load(&self) -> anyhow::Result<Specification> {
        Ok(match &self.spec {
            Some(path) => Specification::load(path)?,
            None => Specification::preset(),
        })
    }
}

/// The specification of a set that is to be rendered, and how much of it.
#[derive(Clone, Debug, Args)]
pub struct SetOptions {
    /// The dataset's specification, a TOML file. Fields that it leaves out are as in the preset
    /// maxbrdf [default: that of the existing store, or the preset for a new one]
    #[arg(long, value_name = "FILE")]
    spec: Option<PathBuf>,
    /// How many materials the set has [default: as many as the specification says]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = materials)]
    materials: Option<u32>,
}

fn materials(text: &str) -> Result<u32, String> {
    let number = text.parse().ok();
    let number = number.filter(|number| limits::MATERIALS.contains(number));
    number.ok_or_else(|| {
        let (fewest, most) = (limits::MATERIALS.start(), limits::MATERIALS.end());
        format!("a set has {fewest} to {most} materials")
    })
}

impl SetOptions {
    /// The specification with as many materials as asked for. Without a file that of the store, if
    /// one is there.
    pub fn load(
        &self,
        kept: impl FnOnce() -> anyhow::Result<Option<Specification>>,
    ) -> anyhow::Result<Specification> {
        let mut specification = match &self.spec {
            Some(path) => Specification::load(path)?,
            None => kept()?.unwrap_or_else(Specification::preset),
        };
        if let Some(materials) = self.materials {
            specification.materials = materials;
        }
        Ok(specification)
    }
}
