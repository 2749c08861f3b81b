#![no_main]
//! The reader of ogbench takes any bytes and returns.

use std::path::Path;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    if let Ok(data) = dataset::ogbench::read_bytes(Path::new("fuzzed"), bytes) {
        sound(&data);
    }
});

include!("sound.rs");
