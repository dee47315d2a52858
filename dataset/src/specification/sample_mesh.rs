//! The mesh of a sample: named by its digest, and loaded from its file.

use super::{
    SpecificationError,
    error::{Place, quoted},
};
use crate::{Digest, masks::Masks};
use mesh::{Mesh, MeshError, limits::FILE_BYTES_MAX};
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use std::{
    fs::File,
    io::{self, Read},
    path::{Component, Path, PathBuf},
    sync::Arc,
};

/// What the name of a file ends with that is named by the digest of what it holds.
const EXTENSION: &str = "mesh";

/// The mesh of a sample: the digest of its file, which is part of the specification's identity, and
/// perhaps the mesh itself. Two are equal if their digests are.
#[derive(Clone, Debug)]
pub struct SampleMesh {
    digest: Digest,
    loaded: Option<Arc<LoadedMesh>>,
}

impl SampleMesh {
    /// The mesh that the bytes of an OBJ or a PLY file hold.
    ///
    /// # Errors
    /// Where they hold none that can be rendered.
    pub fn of_bytes(bytes: Vec<u8>) -> Result<Self, MeshError> {
        let mesh = Mesh::read(&bytes)?;
        Ok(Self {
            digest: Digest::of(&bytes),
            loaded: Some(Arc::new(LoadedMesh {
                mesh,
                bytes: bytes.into(),
                masks: Masks::default(),
            })),
        })
    }

    /// The mesh of this digest, not loaded.
    pub fn named(digest: Digest) -> Self {
        Self {
            digest,
            loaded: None,
        }
    }

    /// The digest of its file.
    pub fn digest(&self) -> Digest {
        self.digest
    }

    /// The mesh, where it is loaded.
    pub fn loaded(&self) -> Option<&Arc<LoadedMesh>> {
        self.loaded.as_ref()
    }

    /// What its file is called beside a specification that names it by its digest.
    pub fn file_name(&self) -> String {
        format!("{}.{EXTENSION}", self.digest)
    }

    /// The mesh, not loaded, whose file is called so ([`Self::file_name`]); `None` where no mesh's is.
    pub fn of_file_name(name: &str) -> Option<Self> {
        let (stem, extension) = name.rsplit_once('.')?;
        (extension == EXTENSION).then_some(Self::named(stem.parse().ok()?))
    }
}

impl PartialEq for SampleMesh {
    fn eq(&self, other: &Self) -> bool {
        self.digest == other.digest
    }
}

impl Serialize for SampleMesh {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        self.digest.serialize(serializer)
    }
}

impl<'de> Deserialize<'de> for SampleMesh {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        Digest::deserialize(deserializer).map(Self::named)
    }
}

/// A mesh in memory, and the bytes of the file that it was read from.
#[derive(Debug)]
pub struct LoadedMesh {
    mesh: Mesh,
    bytes: Arc<[u8]>,
    masks: Masks,
}

impl LoadedMesh {
    /// The mesh, in the units and axes of its file.
    pub fn mesh(&self) -> &Mesh {
        &self.mesh
    }

    /// The bytes of its file.
    pub fn bytes(&self) -> &Arc<[u8]> {
        &self.bytes
    }

    /// Which pixels saw it.
    pub(crate) fn masks(&self) -> &Masks {
        &self.masks
    }

    /// Where its vertices are in the scene, in metres: the mesh is scaled until the longest side of its box
    /// along the axes is `side_m` long, and moved until the middle of the box's top is at the origin.
    pub fn placed(&self, side_m: f64) -> Vec<[f64; 3]> {
        let [lower, upper] = self.mesh.bounds();
        let sides = [0, 1, 2].map(|axis| upper[axis] - lower[axis]);
        let scale = side_m / sides.into_iter().fold(0.0, f64::max);
        let middle = [0, 1].map(|axis| 0.5 * (lower[axis] + upper[axis]));
        let origin = [middle[0], middle[1], upper[2]];
        let place = |at: &[f64; 3]| [0, 1, 2].map(|axis| (at[axis] - origin[axis]) * scale);
        self.mesh.positions().iter().map(place).collect()
    }
}

/// Loads the mesh that a specification names: a file in its folder, or a digest.
///
/// # Errors
/// One sentence, which goes on after the key's name and says what to do.
pub(super) fn load(name: &str, folder: Option<&Path>) -> Result<SampleMesh, String> {
    find(name, folder).map_err(|reason| match name.parse().map(SampleMesh::named) {
        Ok(named) => format!(
            "{reason}; put back {}, the mesh that the dataset was made with: its BLAKE3 digest is its name",
            named.file_name()
        ),
        Err(_) => reason,
    })
}

/// Loads a mesh as [`load`] does; what to do about one that is named by its digest is not said.
fn find(name: &str, folder: Option<&Path>) -> Result<SampleMesh, String> {
    let digest: Option<Digest> = name.parse().ok();
    let Some(folder) = folder else {
        return digest.map(SampleMesh::named).ok_or_else(|| {
            format!(
                "names the file \"{}\", which is looked for beside the specification's own file: read \
                 the specification from a file, or give the mesh by its digest",
                quoted(name)
            )
        });
    };
    let file_name = digest.map_or_else(
        || name.to_owned(),
        |digest| SampleMesh::named(digest).file_name(),
    );
    // A digest is longer than what is repeated of a text, and harmless.
    let shown = digest.map_or_else(|| quoted(name), |_| file_name.clone());
    let path = within(folder, &file_name, &shown)?;
    let bytes = read(&path).map_err(|error| format!("names \"{shown}\", which {error}"))?;
    // Before it is read as a mesh: what was damaged may be none.
    let found = Digest::of(&bytes);
    if let Some(digest) = digest
        && digest != found
    {
        return Err(format!(
            "names the mesh {digest}, but \"{shown}\" beside the specification holds {found}: it was \
             changed or damaged"
        ));
    }
    SampleMesh::of_bytes(bytes)
        .map_err(|error| format!("names \"{shown}\", which cannot be rendered: {error}"))
}

/// The file of a name in a folder or below it; `shown` is the name as an error may repeat it.
fn within(folder: &Path, name: &str, shown: &str) -> Result<PathBuf, String> {
    let outside = || {
        format!(
            "names \"{shown}\", which is not in the specification's folder: copy the mesh there and \
             give its name alone"
        )
    };
    let plain = |component| matches!(component, Component::Normal(_) | Component::CurDir);
    if name.is_empty() || !Path::new(name).components().all(plain) {
        return Err(outside());
    }
    let folder = if folder.as_os_str().is_empty() {
        Path::new(".")
    } else {
        folder
    };
    let found = |path: &Path| {
        path.canonicalize()
            .map_err(|error| format!("names \"{shown}\", which cannot be read: {error}"))
    };
    let path = found(&folder.join(name))?;
    // A link may lead anywhere.
    if path.starts_with(found(folder)?) {
        Ok(path)
    } else {
        Err(outside())
    }
}

/// The bytes of a file, none of which is read that is too large.
fn read(path: &Path) -> Result<Vec<u8>, String> {
    let unreadable = |error: io::Error| format!("cannot be read: {error}");
    let about = path.metadata().map_err(unreadable)?;
    // Opening a pipe may wait forever.
    if !about.is_file() {
        return Err("is not a file".to_owned());
    }
    let mut bytes = Vec::new();
    let too_large = || format!("has more than {FILE_BYTES_MAX} bytes: simplify the mesh");
    if about.len() > FILE_BYTES_MAX {
        return Err(too_large());
    }
    let file = File::open(path).map_err(unreadable)?;
    file.take(FILE_BYTES_MAX + 1)
        .read_to_end(&mut bytes)
        .map_err(unreadable)?;
    if bytes.len() as u64 > FILE_BYTES_MAX {
        return Err(too_large());
    }
    Ok(bytes)
}

fn refused(file: String, message: String) -> SpecificationError {
    SpecificationError::Refused {
        place: Place {
            file,
            line_column: None,
        },
        key: "sample.mesh".to_owned(),
        message,
    }
}

/// Loads a mesh that is named by its digest from its file in a folder.
pub(super) fn load_in(folder: &Path, named: &SampleMesh) -> Result<SampleMesh, SpecificationError> {
    let loaded = find(&named.digest.to_string(), Some(folder));
    loaded.map_err(|message| refused(folder.display().to_string(), message))
}

/// Loads a mesh that is named by its digest.
pub(super) fn with_bytes(
    named: Option<&SampleMesh>,
    bytes: Vec<u8>,
) -> Result<SampleMesh, SpecificationError> {
    let refused = |message| refused("specification".to_owned(), message);
    let named =
        named.ok_or_else(|| refused("is not there, but bytes of a mesh were given".to_owned()))?;
    let found = Digest::of(&bytes);
    if found != named.digest {
        return Err(refused(format!(
            "is {}, but the mesh that was given is {found}",
            named.digest
        )));
    }
    SampleMesh::of_bytes(bytes)
        .map_err(|error| refused(format!("names a mesh that cannot be rendered: {error}")))
}

#[cfg(test)]
mod tests {
    use super::super::{Shape, Specification};
    use super::*;
    use std::fs;

    const TETRAHEDRON: &str =
        "v 0 0 0\nv 2 0 0\nv 0 1 0\nv 0 0 -1\nf 1 2 3\nf 1 4 2\nf 1 3 4\nf 2 4 3\n";

    fn folder(name: &str) -> PathBuf {
        let path = std::env::temp_dir().join(format!("brdfarm-mesh-{name}-{}", std::process::id()));
        let _ = fs::remove_dir_all(&path);
        fs::create_dir_all(path.join("inner")).expect("a folder");
        fs::write(path.join("outside.obj"), TETRAHEDRON).expect("a mesh");
        path
    }

    fn specification(folder: &Path, mesh: &str) -> Result<Specification, String> {
        let path = folder.join("inner/set.toml");
        let text = format!("[sample]\nshape = \"mesh\"\nmesh = {mesh:?}\n");
        fs::write(&path, text).expect("a specification");
        Specification::load(&path).map_err(|error| error.to_string())
    }

    #[test]
    fn a_mesh_is_loaded_by_name_and_by_digest() {
        let folder = folder("names");
        fs::create_dir(folder.join("inner/meshes")).expect("a folder");
        for name in ["a.obj", "meshes/b.obj"] {
            fs::write(folder.join("inner").join(name), TETRAHEDRON).expect("a mesh");
        }
        let [a, b] =
            ["a.obj", "./meshes/b.obj"].map(|name| specification(&folder, name).expect(name));
        let digest = Digest::of(TETRAHEDRON.as_bytes());
        assert_eq!((a.hash(), a.sample.shape), (b.hash(), Shape::Mesh));
        let loaded = a.sample.loaded_mesh().expect("loaded");
        assert_eq!(&**loaded.bytes(), TETRAHEDRON.as_bytes());
        assert_eq!(loaded.mesh().triangles().len(), 4);
        assert!(
            a.canonical().contains(&format!("\"mesh\":\"{digest}\"")),
            "{}",
            a.canonical()
        );

        let by_digest = specification(&folder, &digest.to_string()).expect_err("no such file");
        assert!(by_digest.contains(&format!("{digest}.mesh")), "{by_digest}");
        fs::write(folder.join(format!("inner/{digest}.mesh")), TETRAHEDRON).expect("a mesh");
        let again = specification(&folder, &digest.to_string()).expect("by digest");
        assert_eq!(again.hash(), a.hash());
        assert!(again.sample.loaded_mesh().is_some());
        fs::write(
            folder.join(format!("inner/{digest}.mesh")),
            format!("{TETRAHEDRON}\n"),
        )
        .expect("another");
        let changed = specification(&folder, &digest.to_string()).expect_err("another mesh");
        assert!(changed.contains("changed or damaged"), "{changed}");

        // What is written names the digest, and is read again without the mesh, which then is given.
        let json = Specification::from_json(&a.to_json()).expect("JSON");
        let toml = Specification::from_toml(&a.to_toml(), "set.toml").expect("TOML");
        for read in [json, toml] {
            assert_eq!(read, a);
            assert_eq!(read.hash(), a.hash());
            assert!(read.sample.loaded_mesh().is_none());
            let wrong = read
                .clone()
                .with_mesh(b"v 0 0 0".to_vec())
                .expect_err("another");
            assert!(wrong.to_string().contains(&digest.to_string()), "{wrong}");
            let given = read.with_mesh(TETRAHEDRON.into()).expect("its mesh");
            assert!(given.sample.loaded_mesh().is_some());
        }
        let _ = fs::remove_dir_all(folder);
    }

    #[test]
    fn only_a_digest_names_the_file_of_a_mesh() {
        let mesh = SampleMesh::named(Digest::of(b"mesh"));
        let name = mesh.file_name();
        assert_eq!(SampleMesh::of_file_name(&name), Some(mesh));
        let digest = name.strip_suffix(".mesh").expect("its ending");
        for other in [
            digest.to_owned(),
            format!("{digest}.obj"),
            format!("{name}.new"),
            format!("../{name}"),
            format!("{}.mesh", digest.to_uppercase()),
            "cloth.mesh".to_owned(),
            ".mesh".to_owned(),
            String::new(),
        ] {
            assert_eq!(SampleMesh::of_file_name(&other), None, "{other}");
        }
    }

    #[test]
    fn the_mesh_is_placed_below_the_origin() {
        let mesh = SampleMesh::of_bytes(TETRAHEDRON.into()).expect("a mesh");
        let placed = mesh.loaded().expect("loaded").placed(0.1);
        assert_eq!(placed[0], [-0.05, -0.025, 0.0]);
        assert_eq!(placed[1], [0.05, -0.025, 0.0]);
        assert!(placed.iter().any(|at| at[2] == -0.05), "{placed:?}");
    }

    #[test]
    fn what_is_no_mesh_beside_the_specification_is_refused_with_a_sentence() {
        let folder = folder("refused");
        let inner = folder.join("inner");
        fs::write(inner.join("bad.obj"), "f 1 2 3\n").expect("a file");
        let large = File::create(inner.join("large.ply")).expect("a file");
        large.set_len(FILE_BYTES_MAX + 1).expect("a sparse file");
        let mut cases = vec![
            (
                "../outside.obj".to_owned(),
                "not in the specification's folder",
            ),
            (
                folder.join("outside.obj").display().to_string(),
                "not in the specification's folder",
            ),
            (String::new(), "not in the specification's folder"),
            ("missing.ply".to_owned(), "cannot be read"),
            (".".to_owned(), "is not a file"),
            ("bad.obj".to_owned(), "cannot be rendered: "),
            ("large.ply".to_owned(), "bytes: simplify"),
        ];
        #[cfg(unix)]
        {
            std::os::unix::fs::symlink("../outside.obj", inner.join("link.obj")).expect("a link");
            cases.push(("link.obj".to_owned(), "not in the specification's folder"));
        }
        for (name, part) in cases {
            let error = specification(&folder, &name).expect_err(part);
            assert!(
                error.contains(part) && error.contains("set.toml:3:8"),
                "{name}: {error}"
            );
            assert_eq!(error.lines().count(), 1, "{error}");
        }
        let _ = fs::remove_dir_all(folder);
    }

    #[test]
    fn a_mesh_belongs_to_its_shape() {
        let digest = Digest::of(b"");
        let refused = |text: &str| {
            let read = Specification::from_toml(text, "set.toml");
            read.expect_err(text).to_string()
        };
        let without = refused("sample.shape = \"mesh\"");
        assert!(without.contains("`sample.mesh`"), "{without}");
        let with = refused(&format!("sample.mesh = \"{digest}\""));
        assert!(
            with.contains("`sample.mesh`") && with.contains("square"),
            "{with}"
        );
        let named = refused("sample.shape = \"mesh\"\nsample.mesh = \"cloth.ply\"");
        assert!(
            named.contains("beside the specification's own file"),
            "{named}"
        );
    }
}
