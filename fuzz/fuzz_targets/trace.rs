#![no_main]
//! The reader of traces takes any bytes and returns; what is recovered of them is whole, and holds no
//! less than what was read.

use std::path::Path;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    let path = Path::new("fuzzed");
    let read = trace::read_bytes(path, bytes);
    match trace::recover_bytes(path, bytes) {
        Ok((recovered, written)) => {
            let again = trace::read_bytes(path, &written).expect("what was recovered is read");
            let of_content = |told: &String| {
                told.contains("cannot be decoded") || told.starts_with("its metadata tell")
            };
            assert!(again.cut.is_none() && again.damage.iter().all(of_content), "{again:?}");
            assert_eq!(again.messages, recovered.messages);
            if let Ok(read) = read {
                assert_eq!(again.messages, read.messages);
                assert_eq!(again.steps.len(), read.steps.len());
                assert_eq!(again.choices.len(), read.choices.len());
            }
        }
        Err(trace::TraceError::Nothing { .. }) => {}
        Err(error) => panic!("{error}"),
    }
});
