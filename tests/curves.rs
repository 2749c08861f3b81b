//! Learning curves of runs are drawn from their folders, and what is damaged is named.

#![allow(clippy::unwrap_used)] // Helpers of tests are tests too.

use std::fmt::Write;
use std::path::Path;

use system_tests::{formica, text};

/// A run's folder under runs/: an episode every ten seconds, the last half of them at the goal.
fn run(folder: &Path, name: &str, seed: u32, score: Option<f64>) {
    let run = folder.join("runs").join(name);
    std::fs::create_dir_all(&run).unwrap();
    let config = format!("[run]\nname = \"{name}\"\nseed = {seed}\n\n[maze]\nlayout = \"large\"\n");
    std::fs::write(run.join("config.toml"), config).unwrap();
    let mut metrics = String::from("seconds,role,id,name,step,value\n");
    for i in 0..100 {
        let value = if i < 50 { 0 } else { 100 };
        let _ = writeln!(metrics, "{}.0,actor,0,rollout/score,{i},{value}", i * 10);
        let _ = writeln!(metrics, "{}.5,learner,0,low/policy_loss,{i},-0.25", i * 10);
    }
    std::fs::write(run.join("metrics.csv"), metrics).unwrap();
    if let Some(score) = score {
        let json = format!("{{\"score\": {score}, \"maze\": \"large\", \"seed\": {seed}}}");
        std::fs::write(run.join("score.json"), json).unwrap();
    }
}

#[test]
fn curves_of_finished_and_running_runs_are_drawn_with_their_scores() {
    let folder = tempfile::tempdir().unwrap();
    run(folder.path(), "a-1", 1, Some(80.0));
    run(folder.path(), "a-2", 2, Some(90.0));
    run(folder.path(), "a-3", 3, None);
    // The third goes on: its last line is half there.
    let metrics = folder.path().join("runs/a-3/metrics.csv");
    let mut half = std::fs::read_to_string(&metrics).unwrap();
    half.push_str("1000.0,actor,0,rollo");
    std::fs::write(&metrics, half).unwrap();
    let arguments = ["curves", "a-1", "runs/a-2", "a-3"];
    let output = formica(folder.path(), &arguments).output().unwrap();
    let told = text(&output);
    assert!(output.status.success(), "{told}");
    let line = "a         3  1 2 3  80.0 90.0 -  85.0  7.1  80.0  90.0";
    assert!(told.contains(line), "{told}");
    let svg = std::fs::read_to_string(folder.path().join("curves.svg")).unwrap();
    assert!(svg.contains("score 85.0 ± 7.1 (2 of 3 runs)"), "{svg}");
    assert_eq!(svg.matches("<circle").count(), 2, "{svg}");
    let other = [
        "curves",
        "a-1",
        "--metric",
        "low/policy_loss",
        "--out",
        "l.svg",
    ];
    let output = formica(folder.path(), &other).output().unwrap();
    assert!(output.status.success(), "{}", text(&output));
    assert!(folder.path().join("l.svg").is_file());
}

#[test]
fn what_cannot_be_drawn_is_named_and_no_picture_is_left() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["whole", "damaged", "bare"] {
        run(folder.path(), name, 1, None);
    }
    let path = |name: &str| folder.path().join("runs").join(name);
    let metrics = std::fs::read_to_string(path("damaged/metrics.csv")).unwrap();
    let damaged = metrics.replace("rollout/score,7,0", "rollout/score,7");
    std::fs::write(path("damaged/metrics.csv"), damaged).unwrap();
    std::fs::remove_file(path("bare/metrics.csv")).unwrap();
    std::os::unix::fs::symlink("whole", path("latest")).unwrap();
    for (arguments, told) in [
        (&["nowhere"][..], "there is no run nowhere: neither it nor"),
        (
            &["whole", "damaged"],
            "runs/damaged/metrics.csv:16: expected",
        ),
        (&["bare"], "reading runs/bare/metrics.csv: No such file"),
        (
            &["whole", "latest"],
            "the runs whole and latest are the same",
        ),
        (
            &["whole", "--metric", "x"],
            "no row of x; it has low/policy_loss, rollout/score",
        ),
        (&["whole", "--out", "runs"], "--out runs is a folder"),
        (
            &["whole", "--out", "none/c.svg"],
            "writing none/c.svg: No such file",
        ),
    ] {
        let arguments: Vec<&str> = [&["curves"], arguments].concat();
        let output = formica(folder.path(), &arguments).output().unwrap();
        assert_eq!(output.status.code(), Some(1), "{}", text(&output));
        assert!(text(&output).contains(told), "{told} in {}", text(&output));
        assert!(!folder.path().join("curves.svg").exists(), "{arguments:?}");
    }
}
