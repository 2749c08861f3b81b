//! Faults of a run file are named at once, before any process is started.

use system_tests::{binary, formica, text};

#[test]
fn check_names_every_fault_with_its_line_and_exits_with_2() {
    let folder = tempfile::tempdir().unwrap();
    let config = "[maze]\nlayout = \"medum\"\n[graph]\nnodez = 3\nlag = \"x\"\n\
                  [dataset]\npath = \"none.hdf5\"\n";
    std::fs::write(folder.path().join("bad.toml"), config).unwrap();
    for command in ["check", "launch"] {
        let output = formica(folder.path(), &[command, "bad.toml"])
            .output()
            .unwrap();
        assert_eq!(output.status.code(), Some(2), "{}", text(&output));
        let told = text(&output);
        for expected in [
            "bad.toml:2: maze.layout: unknown word; did you mean 'medium'?",
            "bad.toml:4: graph.nodez: unknown key; did you mean 'nodes'?",
            "bad.toml:5: graph.lag: expected a whole number, found the text \"x\"",
            "bad.toml:7: dataset.path: no file 'none.hdf5', and no [collect] table that would \
             make it",
        ] {
            assert!(told.contains(expected), "{told}");
        }
        assert!(!folder.path().join("runs").exists(), "nothing was started");
    }
}

#[test]
fn a_maze_without_a_way_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let config = "[maze]\nlayout = \"custom\"\nrows = [\"11111\", \"1r1g1\", \"11111\"]\n\
                  [dataset]\npath = \"x.hdf5\"\n[collect]\n";
    std::fs::write(folder.path().join("maze.toml"), config).unwrap();
    let output = formica(folder.path(), &["check", "maze.toml"])
        .output()
        .unwrap();
    assert_eq!(output.status.code(), Some(2));
    let told = text(&output);
    assert!(
        told.contains("maze.toml:3: maze.rows: the goal at row 1, column 3"),
        "{told}"
    );
}

/// In a mount namespace of its own, where /dev/shm is small.
#[test]
fn too_little_shared_memory_is_named_among_the_faults() {
    let folder = tempfile::tempdir().unwrap();
    let config = "[topology]\nwindow = 32\n[graph]\nnodez = 3\n\
                  [dataset]\npath = \"x.hdf5\"\n[collect]\n";
    std::fs::write(folder.path().join("small.toml"), config).unwrap();
    let check = format!(
        "mount -t tmpfs -o size=16m tmpfs /dev/shm && exec {} launch small.toml",
        binary().display()
    );
    let output = std::process::Command::new("unshare")
        .args(["--user", "--map-root-user", "--mount", "sh", "-c", &check])
        .current_dir(folder.path())
        .output()
        .unwrap();
    let told = text(&output);
    assert_eq!(output.status.code(), Some(2), "{told}");
    let memory = "small.toml:2: topology.window: /dev/shm has 16 MiB free and the run can need ";
    assert!(told.contains(memory), "{told}");
    assert!(
        told.contains("small.toml:4: graph.nodez: unknown key"),
        "{told}"
    );
    assert!(!folder.path().join("runs").exists(), "nothing was started");
}

#[test]
fn a_run_that_is_not_there_is_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(
        folder.path().join("config.toml"),
        "[dataset]\npath = \"x\"\n[collect]\n",
    )
    .unwrap();
    let arguments = ["actor", "--domain", "00000000", "--folder", "."];
    let output = formica(folder.path(), &arguments).output().unwrap();
    assert_eq!(output.status.code(), Some(1));
    assert!(
        text(&output).contains("no run '00000000' is alive"),
        "{}",
        text(&output)
    );
}
