//! Data sets are told apart, converted, and refused with one sentence when they are damaged.

use std::path::Path;

use system_tests::{formica, text};

/// A seed of the fuzz targets: four rows, as h5py wrote them.
fn seed() -> String {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    root.join("fuzz/corpus/d4rl/h5py-gzip")
        .display()
        .to_string()
}

#[test]
fn a_data_set_goes_through_all_formats_and_info_tells_of_each() {
    let folder = tempfile::tempdir().unwrap();
    let run = |arguments: &[&str]| {
        let output = formica(folder.path(), arguments).output().unwrap();
        assert!(output.status.success(), "{}", text(&output));
        text(&output)
    };
    let mut from = seed();
    for (to, path, told) in [
        ("minari", "m", "Minari"),
        ("ogbench", "o.npz", "OGBench npz"),
        ("d4rl", "d.hdf5", "D4RL HDF5"),
    ] {
        run(&["dataset", "convert", &from, path, "--to", to]);
        let info = run(&["dataset", "info", path, "--maze", "umaze"]);
        for wanted in [
            &format!("format        {told}"),
            "rows          4",
            "episodes      ",
        ] {
            assert!(info.contains(wanted), "{info}");
        }
        assert!(info.contains("██████████"), "{info}");
        from = path.to_owned();
    }
    run(&[
        "dataset",
        "convert",
        "d.hdf5",
        "s.npz",
        "--to",
        "ogbench",
        "--val-share",
        "0.5",
    ]);
    let lines = run(&["dataset", "info", "s-val.npz"]);
    assert!(lines.contains("OGBench npz"), "{lines}");
}

#[test]
fn damaged_data_and_wrong_arguments_are_refused_with_code_2() {
    let folder = tempfile::tempdir().unwrap();
    let bytes = std::fs::read(seed()).unwrap();
    std::fs::write(folder.path().join("cut.hdf5"), &bytes[..bytes.len() / 2]).unwrap();
    let seed = seed();
    for (arguments, wanted) in [
        (vec!["info", "cut.hdf5"], "formica: cut.hdf5: "),
        (vec!["info", "none.hdf5"], "formica: none.hdf5: "),
        (
            vec!["info", &seed, "--maze", "medum"],
            "unknown maze 'medum'",
        ),
        (
            vec![
                "convert",
                &seed,
                "x.hdf5",
                "--to",
                "d4rl",
                "--val-share",
                "0.1",
            ],
            "--val-share is for --to ogbench",
        ),
        (
            vec![
                "convert",
                &seed,
                "x.npz",
                "--to",
                "ogbench",
                "--val-share",
                "NaN",
            ],
            "--val-share is not in 0 to 1",
        ),
    ] {
        let arguments = [vec!["dataset"], arguments].concat();
        let output = formica(folder.path(), &arguments).output().unwrap();
        assert_eq!(output.status.code(), Some(2), "{}", text(&output));
        let told = text(&output);
        assert!(told.contains(wanted) && told.lines().count() == 1, "{told}");
    }
}
