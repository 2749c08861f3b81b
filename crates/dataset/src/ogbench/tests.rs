//! Files that numpy wrote (fuzz/seeds.py).

use std::path::{Path, PathBuf};

use crate::ogbench::read;

fn seed(name: &str) -> PathBuf {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fuzz/corpus/ogbench");
    root.join(name)
}

#[test]
fn what_numpy_reads_is_read() {
    for name in ["numpy-types.npz", "numpy-folder.npz"] {
        let data = read(&seed(name)).unwrap();
        assert_eq!(data.episodes, [0..3, 3..4], "{name}");
        assert_eq!(data.observation(1)[..3], [1.8125, 1.875, 1.9375], "{name}");
        assert_eq!(data.action(0)[..2], [-0.5, -0.4375], "{name}");
    }
}

#[test]
fn a_compression_that_is_not_read_is_named_with_the_remedy() {
    let error = read(&seed("numpy-bzip2.npz")).unwrap_err().to_string();
    assert!(
        error.contains("is compressed with Bzip2, which is not read"),
        "{error}"
    );
    assert!(error.contains("np.savez_compressed"), "{error}");
}
