#![no_main]
//! The reader of d4rl takes any bytes and returns.

use std::path::Path;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    if let Ok(data) = dataset::d4rl::read_bytes(Path::new("fuzzed"), bytes.to_vec()) {
        sound(&data);
    }
});

include!("sound.rs");
