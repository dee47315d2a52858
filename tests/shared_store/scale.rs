//! Many materials: `tests/postgres.sh migrate`.

use crate::cheap_image::small_specification;
use crate::complete_store::completion;
use crate::place::Place;
use crate::process::Process;
use dataset::Digest;
use datastore::Store;
use std::process::Stdio;
use std::thread;
use std::time::{Duration, Instant};

/// Materials, of three views each, unless BRDFARM_SCALE_MATERIALS says otherwise.
const MATERIALS: u32 = 9000;

/// Peak memory that a command may take, MiB.
const MEMORY_MIB_MAX: u64 = 256;

/// Runs a command to its end; says how long it took, and how much memory it had at most.
fn measure(place: &Place, arguments: &str) {
    let began = Instant::now();
    let mut command = place.command(arguments);
    let mut process = Process::spawn(command.stdout(Stdio::null()));
    let mut peak_bytes = 0;
    while !process.has_ended() {
        peak_bytes = process.memory_bytes("VmHWM").unwrap_or(peak_bytes);
        thread::sleep(Duration::from_millis(5));
    }
    let status = process.ended(Duration::from_secs(1));
    assert_eq!(status.code(), Some(0), "brdfarm {arguments}");
    println!(
        "{arguments}\n    {:.1} s, {} MiB",
        began.elapsed().as_secs_f64(),
        peak_bytes >> 20
    );
    assert!(peak_bytes >> 20 <= MEMORY_MIB_MAX, "{arguments}");
}

#[test]
#[ignore = "takes minutes: tests/postgres.sh migrate runs it"]
fn a_large_store_takes_bounded_memory() {
    let asked = std::env::var("BRDFARM_SCALE_MATERIALS").ok();
    let materials = asked.map_or(MATERIALS, |asked| asked.parse().expect("a number"));
    let place = Place::new(materials);
    let specification = small_specification(materials);
    let store = Store::open_or_create(&place.path().join("first"), &specification);
    let mut store = store.expect("a store");
    for first in (0..materials).step_by(100) {
        let (mut completions, mut images) = (Vec::new(), Vec::new());
        for material in first..materials.min(first + 100) {
            let (completion, rendered) = completion(&specification, material);
            completions.push(completion);
            images.extend(
                rendered
                    .into_iter()
                    .map(|bytes| (Digest::of(&bytes), bytes)),
            );
        }
        store.put(&completions, &images).expect("put");
    }
    drop(store);
    println!("{materials} materials, {} images", 3 * materials);
    let database = place.database();
    measure(
        &place,
        &format!("store migrate first {database} --blobs images"),
    );
    measure(&place, &format!("dataset verify --store {database}"));
    measure(&place, &format!("dataset gc --store {database}"));
    measure(&place, &format!("store migrate {database} second"));
}
