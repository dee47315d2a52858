//! What all targets begin with.

use std::panic;

/// Takes libFuzzer's panic hook away, which would end the process at panics of decoders that are
/// caught and refused on purpose. Those that are not caught still end it.
pub fn init() {
    panic::set_hook(Box::new(|panic| {
        let place = panic.location().map(ToString::to_string);
        // A decoder's panic is no news; there can be millions.
        if place.is_none_or(|place| !place.contains(".cargo/registry/")) {
            eprintln!("{panic}");
        }
    }));
}
