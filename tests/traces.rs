//! Traces of whole runs: every evaluation episode, looked at, drawn and simulated again; and what a
//! killed actor leaves of one.

#![allow(clippy::unwrap_used)] // Helpers of tests are tests too.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Output;
use std::time::Duration;

use system_tests::{eventually, formica, is_alive, kill, of_role, one_at_a_time, started, text};

fn told(folder: &Path, arguments: &[&str]) -> Output {
    formica(folder, arguments).output().unwrap()
}

fn named(folder: &Path, ending: &str) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    let paths = entries.map(|entry| entry.path());
    let ends = |path: &PathBuf| path.to_string_lossy().ends_with(ending);
    let mut paths: Vec<PathBuf> = paths.filter(ends).collect();
    paths.sort();
    paths
}

#[test]
fn every_episode_that_is_to_leaves_a_trace_which_is_the_same_again() {
    let _one = one_at_a_time();
    let (folder, launcher) = started(&["traces.training_every=4"]);
    let output = launcher.wait_with_output().unwrap();
    assert!(output.status.success(), "{}", text(&output));
    let here = folder.path();
    let traces = here.join("runs/small/traces");
    let [evaluation, training] = [&traces, &traces.join("training")].map(|f| named(f, ".mcap"));
    assert_eq!(evaluation.len(), 8, "a trace for each episode");
    assert!(!training.is_empty(), "no training episode left a trace");
    assert!(named(&traces, ".part").is_empty());

    // The table for programs tells what episodes.csv does.
    let table = told(here, &["inspect", "--json", "runs/small"]);
    assert!(table.status.success(), "{}", text(&table));
    let table: serde_json::Value = serde_json::from_slice(&table.stdout).unwrap();
    let rows = table.as_array().unwrap();
    assert_eq!(rows.len(), evaluation.len() + training.len());
    let csv = fs::read_to_string(here.join("runs/small/episodes.csv")).unwrap();
    for line in csv.lines().skip(1) {
        let cells: Vec<&str> = line.split(',').collect();
        let name = format!("episode-{:0>4}.mcap", cells[0]);
        let row = rows
            .iter()
            .find(|row| row["trace"].as_str().unwrap().ends_with(&name))
            .unwrap();
        let success = row["outcome"] == "success";
        assert_eq!(
            (success, row["steps"].to_string()),
            (cells[1] == "1", cells[2].to_owned())
        );
        let nearest = format!("{:.3}", row["nearest"].as_f64().unwrap());
        assert_eq!(nearest, cells[4], "the trace knows how near it came");
        let of = |outcome: bool| {
            let subgoals = row["subgoals"].as_array().unwrap();
            let reached = subgoals.iter().filter(|s| s["reached"] == outcome);
            reached.count()
        };
        assert_eq!(of(true).to_string(), cells[6], "subgoals reached");
        assert_eq!((of(true) + of(false)).to_string(), cells[5], "edges tried");
    }

    for path in evaluation.iter().chain(&training) {
        let replay = told(here, &["replay", path.to_str().unwrap()]);
        assert!(replay.status.success(), "{}", text(&replay));
        assert!(text(&replay).contains("the same bit for bit"));
    }

    // One of them by itself, with its picture.
    let trace = evaluation[0].to_str().unwrap();
    let one = told(here, &["inspect", trace, "--picture", "figure.svg"]);
    assert!(one.status.success(), "{}", text(&one));
    for wanted in [
        "episode 0 of the run small",
        "subgoals:",
        "falls",
        "S start",
    ] {
        assert!(text(&one).contains(wanted), "{wanted}: {}", text(&one));
    }
    let picture = fs::read_to_string(here.join("figure.svg")).unwrap();
    assert!(picture.starts_with("<svg") && picture.contains("node chosen"));

    a_damaged_trace_is_told_from_a_whole_one(here, &evaluation[0]);
}

fn a_damaged_trace_is_told_from_a_whole_one(here: &Path, whole: &Path) {
    let bytes = fs::read(whole).unwrap();
    let code = |output: &Output| output.status.code();
    fs::write(here.join("cut.mcap"), &bytes[..bytes.len() - 30]).unwrap();
    let cut = told(here, &["inspect", "cut.mcap"]);
    assert_eq!(code(&cut), Some(3), "{}", text(&cut));
    assert!(text(&cut).contains("cut off"), "{}", text(&cut));
    let replay = told(here, &["replay", "cut.mcap"]);
    assert_eq!(code(&replay), Some(3), "{}", text(&replay));
    assert!(text(&replay).contains("the same bit for bit"));
    let recovered = told(here, &["recover", "cut.mcap"]);
    assert_eq!(code(&recovered), Some(3), "{}", text(&recovered));
    let replay = told(here, &["replay", "cut.cut.mcap"]);
    assert!(replay.status.success(), "{}", text(&replay));
    let again = told(here, &["recover", "cut.mcap"]);
    assert_eq!(
        code(&again),
        Some(1),
        "it writes over nothing: {}",
        text(&again)
    );
    let mut damaged = bytes.clone();
    let middle = bytes.len() / 2;
    damaged[middle..middle + 100].fill(0);
    fs::write(here.join("damaged.mcap"), damaged).unwrap();
    for command in ["inspect", "replay", "recover"] {
        let output = told(here, &[command, "damaged.mcap"]);
        assert_eq!(code(&output), Some(3), "{}", text(&output));
        assert!(text(&output).contains("are lost"), "{}", text(&output));
        assert!(!text(&output).contains("is cut off"), "{}", text(&output));
    }
    let again = told(here, &["inspect", "damaged.cut.mcap"]);
    assert!(again.status.success(), "{}", text(&again));
    // By the run's name, and by a link to it.
    for name in ["small", "latest"] {
        let table = told(here, &["inspect", name]);
        assert!(table.status.success(), "{}", text(&table));
        assert!(text(&table).contains("0 unreadable"));
    }
    fs::write(here.join("no.mcap"), "no trace at all").unwrap();
    for command in ["inspect", "replay", "recover"] {
        let output = told(here, &[command, "no.mcap"]);
        assert_eq!(code(&output), Some(1), "{}", text(&output));
        assert!(!text(&output).contains("panicked"), "{}", text(&output));
    }
    let nothing = told(here, &["inspect", "nowhere"]);
    assert_eq!(code(&nothing), Some(1));
    assert!(text(&nothing).contains("there is no nowhere"));
}

/// Episodes that do not end, so that one is under way when its actor is killed: an ant that has
/// not learned to walk reaches no goal, and in a test a fall ends nothing.
#[test]
fn of_a_killed_actors_trace_the_whole_chunks_are_recovered() {
    let _one = one_at_a_time();
    let (folder, launcher) = started(&[
        "traces.training_every=1",
        "evaluation.success_radius=0.01",
        "evaluation.max_steps=1000000",
        "rollouts.test_every=1",
        "low.updates=1",
        "rollouts.seconds=600",
    ]);
    let run = folder.path().join("runs/small");
    let training = run.join("traces/training");
    let large = |path: &PathBuf| fs::metadata(path).is_ok_and(|file| file.len() > 200_000);
    let deadline = Duration::from_secs(120);
    assert!(
        eventually(deadline, || named(&training, ".actor-0.mcap.part")
            .iter()
            .any(large)),
        "the trace is not on disk while the episode goes on"
    );
    let actor = of_role(&launcher, "actor")[0];
    assert!(kill(actor, "-9"));
    assert!(eventually(deadline, || !is_alive(actor)));
    assert!(kill(launcher.id(), "-INT"));
    let output = launcher.wait_with_output().unwrap();
    assert!(
        text(&output).contains("traces of killed actors recovered: 1"),
        "{}",
        text(&output)
    );
    assert!(named(&training, ".part").is_empty());
    let recovered = named(&training, ".cut.mcap");
    assert_eq!(recovered.len(), 1);
    let path = recovered[0].to_str().unwrap();
    let inspect = told(folder.path(), &["inspect", path]);
    assert!(inspect.status.success(), "{}", text(&inspect));
    assert!(
        text(&inspect).contains("cut off: not known how it ended"),
        "{}",
        text(&inspect)
    );
    let replay = told(folder.path(), &["replay", path]);
    assert!(replay.status.success(), "{}", text(&replay));
}
