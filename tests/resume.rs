//! Runs that are stopped and gone on with: from other folders, with another config, twice.

#![allow(clippy::unwrap_used)] // Helpers of tests are tests too.

use std::fs;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use std::time::Duration;

use system_tests::{SMALL, eventually, finished, formica, kill, one_at_a_time, piped, start, text};
use tempfile::TempDir;

/// A folder with a finished small run, moved from where it was made; made once.
fn done() -> &'static Path {
    static DONE: OnceLock<(TempDir, PathBuf)> = OnceLock::new();
    let (_, done) = DONE.get_or_init(|| {
        let folder = tempfile::tempdir().unwrap();
        let [first, done] = ["first", "done"].map(|name| folder.path().join(name));
        fs::create_dir(&first).unwrap();
        let output = start(&first, &[]).wait_with_output().unwrap();
        assert!(output.status.success(), "{}", text(&output));
        fs::rename(&first, &done).unwrap();
        (folder, done)
    });
    done
}

/// A copy of it, in a folder below, to change.
fn copy() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    copy_to(&folder.path().join("here"));
    folder
}

fn copy_to(folder: &Path) {
    let copied = std::process::Command::new("cp")
        .arg("-a")
        .args([done(), folder])
        .status()
        .unwrap();
    assert!(copied.success());
}

/// Exit code and words of `formica launch --resume ...` in a folder.
fn resume(folder: &Path, arguments: &[&str]) -> (Option<i32>, String) {
    let all: Vec<&str> = ["launch", "--plain", "--resume"]
        .iter()
        .chain(arguments)
        .copied()
        .collect();
    finished(piped(&mut formica(folder, &all)), Duration::from_secs(120))
}

/// The weights of a parameter file: what follows its header, which names the config.
fn weights(path: &Path) -> Vec<u8> {
    let bytes = fs::read(path).unwrap();
    let header = u64::from_le_bytes(bytes[..8].try_into().unwrap()) as usize;
    bytes[8 + header..].to_vec()
}

/// Name, length and times of all files of a folder, at any depth.
fn files(folder: &Path) -> Vec<(String, u64, i64, i64)> {
    let mut files = vec![];
    for entry in fs::read_dir(folder).unwrap().flatten() {
        let about = entry.path().symlink_metadata().unwrap();
        if about.is_dir() {
            files.extend(self::files(&entry.path()));
        }
        let name = entry.path().display().to_string();
        files.push((name, about.len(), about.mtime(), about.mtime_nsec()));
    }
    files.sort();
    files
}

fn set_in_config(run: &Path, from: &str, to: &str) {
    let config = fs::read_to_string(run.join("config.toml")).unwrap();
    assert!(config.contains(from), "{config}");
    fs::write(run.join("config.toml"), config.replace(from, to)).unwrap();
}

#[test]
fn a_finished_run_says_its_score_and_changes_nothing() {
    let _one = one_at_a_time();
    let folder = copy();
    let here = folder.path().join("here");
    let before = files(&here);
    let json = fs::read_to_string(here.join("runs/small/score.json")).unwrap();
    let score: serde_json::Value = serde_json::from_str(&json).unwrap();
    let score = format!("normalized score {:.1}", score["score"].as_f64().unwrap());
    for (from, arguments) in [
        (here.as_path(), &["small"][..]),
        (&here, &["latest"]),
        (&here, &["runs/small/"]),
        (folder.path(), &["here/runs/latest"]),
        (folder.path(), &["here/runs/latest/"]),
        (&here.join("runs"), &["latest"]),
        (&here.join("runs/small"), &["."]),
        (&here, &["small", "--set", "topology.actors=1"]),
        (&here, &["small", "--set", "rollouts.seconds=60"]),
    ] {
        let (code, told) = resume(from, arguments);
        assert_eq!(code, Some(0), "{arguments:?}: {told}");
        assert!(told.contains("is finished"), "{arguments:?}: {told}");
        assert!(told.contains(&score), "{arguments:?}: {told}");
        assert_eq!(files(&here), before, "{arguments:?}");
    }
}

#[test]
fn what_shapes_weights_or_graph_cannot_change() {
    let _one = one_at_a_time();
    let folder = copy();
    let here = folder.path().join("here");
    let run = here.join("runs/small");
    set_in_config(&run, "nodes = 20\n", "nodes = 21\n");
    let before = files(&here);
    let sets = [
        "small",
        "--set",
        "low.learning_rate=0.5",
        "--set",
        "evaluation.episodes=9",
    ];
    let (code, told) = resume(&here, &sets);
    assert_eq!(code, Some(2), "{told}");
    let config = fs::read_to_string(run.join("config.toml")).unwrap();
    let line = config
        .lines()
        .position(|line| line == "nodes = 21")
        .unwrap()
        + 1;
    for expected in [
        format!("runs/small/config.toml:{line}: graph.nodes: cannot change from 20 to 21"),
        "--set low.learning_rate: cannot change from 0.001 to 0.5".to_owned(),
    ] {
        assert!(told.contains(&expected), "{told}");
    }
    assert!(!told.contains("evaluation.episodes"), "{told}");
    assert_eq!(files(&here), before, "nothing was touched");
}

#[test]
fn a_config_that_is_damaged_or_gone_is_told_with_the_way_back() {
    let _one = one_at_a_time();
    let folder = copy();
    let here = folder.path().join("here");
    let config = here.join("runs/small/config.toml");
    let sound = fs::read(&config).unwrap();
    for (text, code, told) in [
        (Some("[run]\nseed = \n"), 2, "runs/small/config.toml:2: "),
        (
            Some("[run]\nsead = 3\n"),
            2,
            "runs/small/config.toml:2: run.sead: unknown key",
        ),
        (Some("\0\0"), 2, "runs/small/checkpoints/config.toml"),
        (
            None,
            1,
            "`cp runs/small/checkpoints/config.toml runs/small/config.toml`",
        ),
    ] {
        match text {
            Some(text) => fs::write(&config, text).unwrap(),
            None => fs::remove_file(&config).unwrap(),
        }
        let (found, said) = resume(&here, &["small"]);
        assert_eq!(found, Some(code), "{said}");
        assert!(said.contains(told), "{said}");
    }
    fs::copy(here.join("runs/small/checkpoints/config.toml"), &config).unwrap();
    assert_eq!(fs::read(&config).unwrap(), sound);
}

#[test]
fn a_finished_run_goes_on_where_a_change_asks_for_more() {
    let _one = one_at_a_time();
    let folder = copy();
    let here = folder.path().join("here");
    let run = here.join("runs/small");
    let graph = fs::read(run.join("graph.bin")).unwrap();
    let high = weights(&run.join("checkpoints/high.safetensors"));
    // From elsewhere, after the whole folder was moved, through a link.
    let there = folder.path().join("there");
    fs::rename(&here, &there).unwrap();
    std::os::unix::fs::symlink("there/runs", folder.path().join("all")).unwrap();
    let run = there.join(run.strip_prefix(&here).unwrap());
    set_in_config(
        &run,
        "[traces]\nevaluation = true",
        "[traces]\nevaluation = false",
    );
    let (code, told) = resume(
        folder.path(),
        &[
            "all/latest",
            "--set",
            "evaluation.episodes=10",
            "--set",
            "topology.actors=1",
        ],
    );
    assert_eq!(code, Some(0), "{told}");
    for expected in [
        "config: evaluation.episodes: 8 -> 10",
        "config: topology.actors: 2 -> 1",
        "config: traces.evaluation: true -> false",
        "dataset.path moved with the run to ",
        "8 of them known",
    ] {
        assert!(told.contains(expected), "{expected}: {told}");
    }
    let episodes = fs::read_to_string(run.join("episodes.csv")).unwrap();
    assert_eq!(episodes.lines().count(), 11);
    assert!(fs::read(run.join("graph.bin")).unwrap() == graph);
    assert!(weights(&run.join("checkpoints/high.safetensors")) == high);
    let config = fs::read_to_string(run.join("config.toml")).unwrap();
    assert!(
        config.contains("episodes = 10\n") && config.contains("actors = 1\n"),
        "{config}"
    );
    let data = fs::canonicalize(there.join("data.hdf5")).unwrap();
    assert!(
        config.contains(&format!("path = \"{}\"", data.display())),
        "{config}"
    );
    assert_eq!(
        fs::read_link(there.join("runs/latest")).unwrap(),
        Path::new("small")
    );
    // And then it is finished again.
    let (code, told) = resume(&there, &["small"]);
    assert!(code == Some(0) && told.contains("is finished"), "{told}");
}

#[test]
fn data_that_are_gone_or_others_are_refused() {
    let _one = one_at_a_time();
    let folder = copy();
    let here = folder.path().join("here");
    let more = ["small", "--set", "evaluation.episodes=9"];
    fs::write(here.join("other.hdf5"), "other").unwrap();
    let (code, told) = resume(
        &here,
        &[&more[..], &["--set", "dataset.path=other.hdf5"]].concat(),
    );
    assert_eq!(code, Some(2), "{told}");
    assert!(
        told.contains("other.hdf5' holds other data than the run began with"),
        "{told}"
    );
    let (code, told) = resume(
        &here,
        &[&more[..], &["--set", "dataset.path=none.hdf5"]].concat(),
    );
    assert_eq!(code, Some(2), "{told}");
    assert!(
        told.contains("none.hdf5' any more; name where it is now"),
        "{told}"
    );
}

#[test]
fn an_interrupted_run_goes_on_from_another_folder_without_its_logs_and_with_damaged_data() {
    let _one = one_at_a_time();
    let folder = tempfile::tempdir().unwrap();
    let [here, elsewhere] = ["here", "elsewhere"].map(|name| folder.path().join(name));
    fs::create_dir(&here).unwrap();
    fs::create_dir(&elsewhere).unwrap();
    let launcher = start(&here, &["low.updates=4000"]);
    let run = here.join("runs/small");
    let state = |name: &str| run.join("checkpoints").join(name).is_file();
    let begun = eventually(Duration::from_secs(60), || state("encoder.safetensors"));
    assert!(begun, "the encoder is trained");
    assert!(kill(launcher.id(), "-INT"));
    let (code, told) = finished(launcher, Duration::from_secs(10));
    assert_eq!(code, Some(130), "{told}");
    fs::remove_dir_all(run.join("logs")).unwrap();
    fs::remove_dir_all(run.join("traces")).unwrap();
    let data = run.join("data.mapped");
    let bytes = fs::read(&data).unwrap();
    fs::write(&data, &bytes[..bytes.len() / 2]).unwrap();
    let (code, told) = resume(
        &elsewhere,
        &["../here/runs/latest", "--set", "rollouts.seconds=1"],
    );
    assert_eq!(code, Some(0), "{told}");
    assert!(
        told.contains("config: rollouts.seconds: 2.0 -> 1.0"),
        "{told}"
    );
    assert!(told.contains("normalized score"), "{told}");
    assert!(run.join("logs/learner-0.log").is_file());
    assert!(!data.exists(), "a run that is finished needs none");
    assert_eq!(
        fs::read_link(here.join("runs/latest")).unwrap(),
        Path::new("small")
    );
    assert_eq!(
        fs::read_dir(&elsewhere).unwrap().count(),
        0,
        "nothing is left there"
    );
}

#[test]
fn a_run_without_its_checkpoints_begins_anew() {
    let _one = one_at_a_time();
    let folder = copy();
    let here = folder.path().join("here");
    fs::remove_dir_all(here.join("runs/small/checkpoints")).unwrap();
    let (code, told) = resume(
        &here,
        // What the data were is gone with the checkpoints.
        &[
            "small",
            "--set",
            "evaluation.episodes=9",
            "--set",
            "dataset.path=data.hdf5",
        ],
    );
    assert_eq!(code, Some(0), "{told}");
    assert!(
        told.contains("checkpoints was gone: training begins anew"),
        "{told}"
    );
    let episodes = fs::read_to_string(here.join("runs/small/episodes.csv")).unwrap();
    assert_eq!(episodes.lines().count(), 10);
}

#[test]
fn any_file_s_name_gives_a_run_s_name_or_a_fault() {
    let folder = tempfile::tempdir().unwrap();
    let check = |file: &str| {
        fs::write(folder.path().join(file), SMALL).unwrap();
        let output = formica(folder.path(), &["check", "--", file])
            .output()
            .unwrap();
        (output.status.code(), text(&output))
    };
    for (file, name) in [
        ("my config (1).toml", "my-config-1"),
        ("größe.toml", "grosse"),
        ("-x.toml", "x"),
        ("a;b'c\"d.toml", "a-b-c-d"),
    ] {
        let (code, told) = check(file);
        assert_eq!(code, Some(0), "{told}");
        assert!(
            told.trim_end()
                .ends_with(&format!("the run's name is {name}")),
            "{told}"
        );
    }
    for file in ["latest.toml", "---.toml"] {
        let (code, told) = check(file);
        assert_eq!(code, Some(2), "{told}");
        assert!(told.contains("run.name: the file's name"), "{told}");
    }
}

#[test]
fn a_run_of_version_0_1_is_refused_with_the_version_that_continues_it() {
    let folder = copy();
    let run = folder.path().join("here/runs/small");
    for config in [run.join("config.toml"), run.join("checkpoints/config.toml")] {
        let text = fs::read_to_string(&config).unwrap();
        let old = text.replace("algorithm = \"lg-h-ppo\"", "kind = \"offline\"");
        assert_ne!(text, old);
        fs::write(&config, old).unwrap();
    }
    let before = fs::read(run.join("progress.json")).unwrap();
    let (code, told) = resume(&folder.path().join("here"), &["small"]);
    assert_eq!(code, Some(2), "{told}");
    assert!(told.contains("made by formica 0.1"), "{told}");
    assert!(told.contains("resume it with formica 0.1"), "{told}");
    assert_eq!(fs::read(run.join("progress.json")).unwrap(), before);
}
