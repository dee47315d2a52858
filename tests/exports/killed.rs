//! An export killed at any instant goes on with the same command and ends the same.

use crate::folder::files_below;
use crate::small::rendered;
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::thread::sleep;
use std::time::Duration;

/// Every file below a folder with its bytes.
pub fn contents(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let files = files_below(folder).into_iter();
    let named = files.map(|path| {
        let name = path.strip_prefix(folder).unwrap().to_owned();
        (name, fs::read(&path).unwrap())
    });
    named.collect()
}

#[test]
fn an_export_killed_at_any_instant_goes_on_and_ends_the_same() {
    let place = rendered(6);
    for layout in ["files", "webdataset", "huggingface"] {
        let export =
            |folder: &str| format!("dataset export {folder} --layout {layout} --npy --png");
        place.succeed(&export(&format!("whole-{layout}")));
        let expected = contents(&place.path().join(format!("whole-{layout}")));
        let folder = format!("killed-{layout}");
        let mut finished = false;
        // From before the first file to after the last, at twice the time each.
        for milliseconds in (0..16).map(|power| 2 << power) {
            let mut child = place.spawn(&export(&folder));
            sleep(Duration::from_millis(milliseconds));
            finished = child
                .try_wait()
                .unwrap()
                .is_some_and(|status| status.success());
            if finished {
                break;
            }
            child.kill().unwrap();
            child.wait().unwrap();
        }
        assert!(finished);
        assert!(contents(&place.path().join(folder)) == expected, "{layout}");
    }
}
