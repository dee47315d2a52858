//! Finding the shared library, loading it once, and refusing one that does not fit.

use std::error::Error;
use std::ffi::{CStr, OsString, c_char, c_int, c_uint, c_void};
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use std::{env, ptr};

use libloading::Library;

use super::abi;
use super::error::EmbreeError;

/// The oldest version whose structures are those of `abi`, as Embree numbers it.
const VERSION_MIN: isize = 40_300;
/// The first version that may have others.
const VERSION_END: isize = 50_000;
/// The file looked for in a directory, and asked of the system's loader.
const LIBRARY_FILE: &str = "libembree4.so.4";
/// What the system's loader is asked for next.
const LIBRARY_FILE_UNVERSIONED: &str = "libembree4.so";
/// One thread builds: our scenes are small, and the caller has threads enough.
pub const CONFIGURATION: &CStr = c"threads=1";

macro_rules! functions {
    ($($field:ident: $symbol:literal, fn($($argument:ty),*) $(-> $result:ty)?;)*) => {
        /// Embree's functions, and the library that holds them.
        pub struct Functions {
            $(pub $field: unsafe extern "C" fn($($argument),*) $(-> $result)?,)*
            // Never unloaded: the pointers above live as long.
            _library: Library,
        }

        impl Functions {
            /// # Safety
            ///
            /// The library must be an Embree 4: its symbols must have the types given here.
            unsafe fn resolve(library: Library) -> Result<Self, libloading::Error> {
                $(
                    // SAFETY: the caller promises the type.
                    let $field = *unsafe {
                        library.get::<unsafe extern "C" fn($($argument),*) $(-> $result)?>($symbol)
                    }?;
                )*
                Ok(Self { $($field,)* _library: library })
            }
        }
    };
}

functions! {
    new_device: c"rtcNewDevice", fn(*const c_char) -> *mut abi::Device;
    release_device: c"rtcReleaseDevice", fn(*mut abi::Device);
    device_property: c"rtcGetDeviceProperty", fn(*mut abi::Device, c_int) -> isize;
    device_error: c"rtcGetDeviceError", fn(*mut abi::Device) -> c_int;
    new_scene: c"rtcNewScene", fn(*mut abi::Device) -> *mut abi::Scene;
    release_scene: c"rtcReleaseScene", fn(*mut abi::Scene);
    set_scene_flags: c"rtcSetSceneFlags", fn(*mut abi::Scene, c_int);
    commit_scene: c"rtcCommitScene", fn(*mut abi::Scene);
    new_geometry: c"rtcNewGeometry", fn(*mut abi::Device, c_int) -> *mut abi::Geometry;
    release_geometry: c"rtcReleaseGeometry", fn(*mut abi::Geometry);
    set_primitive_count:
        c"rtcSetGeometryUserPrimitiveCount", fn(*mut abi::Geometry, c_uint);
    set_user_data: c"rtcSetGeometryUserData", fn(*mut abi::Geometry, *mut c_void);
    set_bounds_function:
        c"rtcSetGeometryBoundsFunction",
        fn(*mut abi::Geometry, abi::BoundsFunction, *mut c_void);
    set_intersect_function:
        c"rtcSetGeometryIntersectFunction", fn(*mut abi::Geometry, abi::QueryFunction);
    set_occluded_function:
        c"rtcSetGeometryOccludedFunction", fn(*mut abi::Geometry, abi::QueryFunction);
    commit_geometry: c"rtcCommitGeometry", fn(*mut abi::Geometry);
    attach_geometry: c"rtcAttachGeometry", fn(*mut abi::Scene, *mut abi::Geometry) -> c_uint;
    intersect: c"rtcIntersect1", fn(*mut abi::Scene, *mut abi::RayHit, *mut abi::QueryArguments);
    occluded: c"rtcOccluded1", fn(*mut abi::Scene, *mut abi::Ray, *mut abi::QueryArguments);
}

/// The library, searched for and loaded at the first call; the same answer ever after.
pub fn functions() -> Result<&'static Functions, EmbreeError> {
    static FUNCTIONS: OnceLock<Result<Functions, EmbreeError>> = OnceLock::new();
    FUNCTIONS
        .get_or_init(|| match named() {
            Some(path) => load_named(Path::new(&path)),
            None => load_first(&candidates()),
        })
        .as_ref()
        .map_err(EmbreeError::clone)
}

/// Whether the library that the environment names, if it names one, can be used.
pub fn check_named() -> Result<(), EmbreeError> {
    match named() {
        Some(_) => functions().map(drop),
        None => Ok(()),
    }
}

fn named() -> Option<OsString> {
    env::var_os("EMBREE_LIBRARY").filter(|path| !path.is_empty())
}

fn load_named(path: &Path) -> Result<Functions, EmbreeError> {
    load(path).map_err(|reason| EmbreeError::Named {
        path: path.display().to_string(),
        reason,
    })
}

fn load_first(candidates: &[PathBuf]) -> Result<Functions, EmbreeError> {
    let mut tried = Vec::new();
    for candidate in candidates {
        match load(candidate) {
            Ok(functions) => return Ok(functions),
            Err(reason) => tried.push(format!("{}: {reason}", candidate.display())),
        }
    }
    Err(EmbreeError::Missing {
        tried: tried.join("; "),
    })
}

/// Where to look, in order: beside the program, in its installation, in the user's data, in the
/// system.
fn candidates() -> Vec<PathBuf> {
    let program = env::current_exe().ok();
    let beside = program.as_deref().and_then(Path::parent);
    let installed = beside
        .and_then(Path::parent)
        .map(|prefix| prefix.join("lib/brdfarm"));
    // A path that is not absolute counts as unset (XDG Base Directory Specification).
    let absolute = |name| {
        env::var_os(name)
            .map(PathBuf::from)
            .filter(|path| path.is_absolute())
    };
    let user = absolute("XDG_DATA_HOME")
        .or_else(|| Some(absolute("HOME")?.join(".local/share")))
        .map(|data| data.join("brdfarm/embree"));
    let directories = [beside.map(Path::to_path_buf), installed, user];
    let files = directories
        .into_iter()
        .flatten()
        .map(|directory| directory.join(LIBRARY_FILE));
    let system = [LIBRARY_FILE, LIBRARY_FILE_UNVERSIONED].map(PathBuf::from);
    files.chain(system).collect()
}

/// Opens the library and asks it what it is.
fn load(path: &Path) -> Result<Functions, String> {
    if path.is_absolute() && !path.exists() {
        return Err("no such file".to_owned());
    }
    // SAFETY: loading runs the library's initialisers. The path is one that the user names, that
    // our script installs to or that the system's loader trusts, and Embree's initialisers ask
    // nothing of their caller.
    let library = unsafe { Library::new(path) }.map_err(|error| sentence(&error))?;
    // SAFETY: every function named has had this type since version 4.0, and before it
    // `rtcIntersect1` and `rtcOccluded1` alone had others: they are not called below, and the
    // version is checked before anyone else can.
    let functions = unsafe { Functions::resolve(library) }.map_err(|error| sentence(&error))?;
    // SAFETY: a NUL-terminated configuration, read during the call alone.
    let device = unsafe { (functions.new_device)(CONFIGURATION.as_ptr()) };
    if device.is_null() {
        // SAFETY: without a device the function gives this thread's error.
        let code = unsafe { (functions.device_error)(ptr::null_mut()) };
        return Err(format!("it makes no device: {}", abi::error_text(code)));
    }
    // SAFETY: the device is alive until it is released below, once.
    let (version, user_geometry) = unsafe {
        let property = |name| (functions.device_property)(device, name);
        let answers = (
            property(abi::DEVICE_PROPERTY_VERSION),
            property(abi::DEVICE_PROPERTY_USER_GEOMETRY_SUPPORTED),
        );
        (functions.release_device)(device);
        answers
    };
    check_version(version)?;
    if user_geometry == 0 {
        return Err("it is built without user geometry".to_owned());
    }
    Ok(functions)
}

/// What the loader says, which `libloading` keeps as the error's source.
fn sentence(error: &libloading::Error) -> String {
    match error.source() {
        Some(source) => format!("{error}: {source}"),
        None => error.to_string(),
    }
}

/// Whether the structures of `abi` are those of this version.
fn check_version(version: isize) -> Result<(), String> {
    if (VERSION_MIN..VERSION_END).contains(&version) {
        return Ok(());
    }
    let (major, minor, patch) = (version / 10_000, version / 100 % 100, version % 100);
    Err(format!(
        "it is version {major}.{minor}.{patch}, and only 4.3 or a later 4 fits"
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_versions_with_these_structures_pass() {
        for version in [40_300, 40_303, 40_400, 40_401, 49_999] {
            assert_eq!(check_version(version), Ok(()), "{version}");
        }
        for version in [0, 30_1302, 40_200, 40_299, 50_000, -1] {
            assert!(check_version(version).is_err(), "{version}");
        }
        assert_eq!(
            check_version(40_201).unwrap_err(),
            "it is version 4.2.1, and only 4.3 or a later 4 fits"
        );
    }

    #[test]
    fn missing_library_is_one_sentence_with_every_place_and_the_remedy() {
        let candidates = [
            "/nonexistent/a/libembree4.so.4",
            "libembree4-nonexistent.so.4",
        ];
        let Err(error) = load_first(&candidates.map(PathBuf::from)) else {
            panic!("there is no such library");
        };
        let sentence = error.to_string();
        for candidate in candidates {
            assert!(sentence.contains(candidate), "{sentence}");
        }
        assert!(
            sentence.contains("run deploy/fetch-embree.sh"),
            "{sentence}"
        );
        assert!(!sentence.contains('\n'), "{sentence}");
    }

    #[test]
    fn library_of_something_else_is_refused() {
        // The C library is there on every machine that runs these tests, and is no Embree.
        let Err(error) = load_named(Path::new("libc.so.6")) else {
            panic!("the C library has no rtcNewDevice");
        };
        let sentence = error.to_string();
        assert!(
            sentence.contains("EMBREE_LIBRARY") && sentence.contains("libc.so.6"),
            "{sentence}"
        );
        assert!(sentence.contains("rtcNewDevice"), "{sentence}");
    }
}
