#![no_main]

libfuzzer_sys::fuzz_target!(init: libfuzzer::init(), |bytes: &[u8]| {
    fuzz::mesh(bytes);
});
