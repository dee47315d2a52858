//! What describes an export to people and to machines: the dataset card, plots of the parameters,
//! Croissant metadata.

mod croissant;
mod licence;
mod pixels;
mod plots;
mod readme;

pub use licence::Licence;

use crate::{
    error::ExportError,
    file::{unable, write_bytes},
    layout::unit::{Layout, Unit},
    product::Products,
    selection::Chosen,
};
use datastore::ReadOnlyStore;
use pixels::Pixels;
use std::{fs::File, io::Read, path::Path};

/// What only the publisher knows.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Publication {
    /// The images' licence.
    pub licence: Licence,
    /// Who publishes it.
    pub creator: Option<String>,
    /// Where it is published.
    pub url: Option<String>,
    /// When, as YYYY-MM-DD.
    pub date: Option<String>,
}

impl Default for Publication {
    fn default() -> Self {
        Self {
            licence: Licence::Unknown,
            creator: None,
            url: None,
            date: None,
        }
    }
}

/// The export that is described.
pub(crate) struct Described<'a> {
    pub store: &'a ReadOnlyStore,
    pub chosen: &'a Chosen,
    pub products: &'a Products,
    pub layout: Layout,
    pub shards: &'a [Unit],
    pub publication: &'a Publication,
    /// The share of all pixels that are within the specification's accuracy, 0 to 1.
    pub within_target: f64,
}

/// Writes card, plots and metadata into the export's folder. `manifest` is its manifest, whole but
/// perhaps under another name.
pub(crate) fn write(
    described: &Described<'_>,
    folder: &Path,
    manifest: &Path,
) -> Result<(), ExportError> {
    let plot = plots::parameters(described)?;
    write_bytes(&folder.join("parameters.svg"), plot.as_bytes())?;
    let readme = readme::text(described, &Pixels::of(described)?);
    write_bytes(&folder.join("README.md"), readme.as_bytes())?;
    let manifest = FileDigest::of(manifest)?;
    let metadata = croissant::metadata(described, &manifest);
    let metadata = format!("{metadata:#}\n");
    Ok(write_bytes(
        &folder.join("croissant.json"),
        metadata.as_bytes(),
    )?)
}

/// Size and SHA-256 of a file: what Croissant asks for.
struct FileDigest {
    bytes: u64,
    sha256: String,
}

impl FileDigest {
    fn of(path: &Path) -> Result<Self, ExportError> {
        use sha2::Digest as _;
        let mut file = File::open(path).map_err(unable("read", path))?;
        let mut hasher = sha2::Sha256::new();
        let mut buffer = vec![0; 1 << 20];
        let mut bytes = 0;
        loop {
            let read = file.read(&mut buffer).map_err(unable("read", path))?;
            if read == 0 {
                break;
            }
            hasher.update(&buffer[..read]);
            bytes += read as u64;
        }
        let sha256 = hexadecimal(&hasher.finalize());
        Ok(Self { bytes, sha256 })
    }
}

/// The SHA-256 of some bytes.
fn sha256(bytes: &[u8]) -> String {
    use sha2::Digest as _;
    hexadecimal(&sha2::Sha256::digest(bytes))
}

fn hexadecimal(bytes: &[u8]) -> String {
    bytes.iter().map(|b| format!("{b:02x}")).collect()
}

/// One sentence on the whole.
fn summary(described: &Described<'_>) -> String {
    let specification = described.store.specification();
    format!(
        "{} images of {} materials in {} views, {} x {} pixels, each with the ten parameters of \
         an anisotropic reflectance model, exact geometry and its measured error.",
        described.chosen.images(),
        described.chosen.materials.len(),
        described.chosen.views.len(),
        specification.image.width,
        specification.image.height,
    )
}

/// The paper that the model and the design of the set come from.
const CITATION: &str = "@inproceedings{Vidaurre2019,
  author    = {Vidaurre, Raquel and Casas, Dan and Garces, Elena and Lopez-Moreno, Jorge},
  title     = {{BRDF} Estimation of Complex Materials with Nested Learning},
  booktitle = {IEEE Winter Conference on Applications of Computer Vision (WACV)},
  year      = {2019}
}";
