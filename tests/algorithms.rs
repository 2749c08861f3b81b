//! Other algorithms and simulators than the default, over the same processes.

#![allow(clippy::unwrap_used)] // Helpers of tests are tests too.

use std::path::Path;
use std::process::Child;
use std::time::Duration;

use system_tests::{
    children, finished, formica, kill, of_role, one_at_a_time, piped, shared_memory, text,
};

fn launched(folder: &Path, config: &str) -> Child {
    std::fs::write(folder.join("other.toml"), config).unwrap();
    piped(&mut formica(folder, &["launch", "other.toml", "--plain"]))
}

/// What a command prints, which ends with exit code 0.
fn printed(folder: &Path, arguments: &[&str]) -> String {
    let output = formica(folder, arguments).output().unwrap();
    let text = text(&output);
    assert!(output.status.success(), "{arguments:?}: {text}");
    text
}

fn score(run: &Path) -> f64 {
    let json = std::fs::read(run.join("score.json")).unwrap();
    let json: serde_json::Value = serde_json::from_slice(&json).unwrap();
    json["score"].as_f64().unwrap()
}

fn traces(run: &Path) -> usize {
    let entries = std::fs::read_dir(run.join("traces")).unwrap().flatten();
    let paths = entries.map(|entry| entry.path());
    paths
        .filter(|path| path.extension().is_some_and(|e| e == "mcap"))
        .count()
}

/// A point mass in the medium maze learns to reach every goal. The run is deterministic, so that its
/// score is the same whatever else the machine does.
#[test]
fn a_point_mass_scores_a_hundred_in_the_medium_maze() {
    let _one = one_at_a_time();
    let folder = tempfile::tempdir().unwrap();
    let config = "[run]\nsimulator = \"point\"\ndeterministic = true\n[maze]\nlayout = \"medium\"\n\
                  [dataset]\npath = \"point.hdf5\"\n[collect]\ntransitions = 100_000\n\
                  [encoder]\nupdates = 2000\n[graph]\nnodes = 100\n\
                  [low]\nupdates = 2000\nhidden = [64, 64]\n[high]\nsteps = 400_000\n\
                  [rollouts]\nrounds = 1\nepisodes = 16\n[evaluation]\nepisodes = 50\n";
    let launcher = launched(folder.path(), config);
    let (code, told) = finished(launcher, Duration::from_secs(300));
    assert_eq!(code, Some(0), "{told}");
    assert!(told.contains("(0 lost, 0 refused)"), "{told}");
    let run = folder.path().join("runs/other");
    assert_eq!(score(&run), 100.0, "{told}");
    assert_eq!(traces(&run), 50);
    let inspected = printed(
        folder.path(),
        &["inspect", "runs/other/traces/episode-0000.mcap"],
    );
    assert!(inspected.contains("simulator point"), "{inspected}");
    assert!(inspected.contains("the goal reached"), "{inspected}");
    printed(
        folder.path(),
        &["replay", "runs/other/traces/episode-0000.mcap"],
    );
    assert_eq!(shared_memory(&run), Vec::<String>::new());
}

/// An algorithm without a graph and without a hierarchy trains, is interrupted and resumed, evaluated,
/// traced and reported like the default one.
#[test]
fn behavioural_cloning_runs_like_the_default_algorithm() {
    let _one = one_at_a_time();
    let folder = tempfile::tempdir().unwrap();
    let config = "[run]\nalgorithm = \"gcbc\"\nsimulator = \"point\"\ncheckpoint_seconds = 0.5\n\
                  [maze]\nlayout = \"umaze\"\n[dataset]\npath = \"point.hdf5\"\n[collect]\n\
                  transitions = 20_000\n[gcbc]\nupdates = 6000\nhidden = [64, 64]\n\
                  [evaluation]\nepisodes = 20\n[rollouts]\nseconds = 1.0\n";
    let launcher = launched(folder.path(), config);
    let run = folder.path().join("runs/other");
    let begun = || run.join("checkpoints").is_dir() && children(&launcher).len() == 3;
    assert!(system_tests::eventually(Duration::from_secs(60), begun));
    assert!(of_role(&launcher, "graph-builder").is_empty());
    let kept = || {
        let states = std::fs::read_dir(run.join("checkpoints"))
            .unwrap()
            .flatten();
        let names = states.map(|state| state.file_name().to_string_lossy().into_owned());
        names.into_iter().any(|name| name.starts_with("gcbc-"))
    };
    assert!(system_tests::eventually(Duration::from_secs(60), kept));
    assert!(kill(launcher.id(), "-INT"));
    let (code, told) = finished(launcher, Duration::from_secs(10));
    assert_eq!(code, Some(130), "{told}");
    let resumed = piped(&mut formica(
        folder.path(),
        &["launch", "--resume", "other", "--plain"],
    ));
    let (code, told) = finished(resumed, Duration::from_secs(120));
    assert_eq!(code, Some(0), "{told}");
    assert!(
        told.contains("evaluate: 20 episodes with policy 6000"),
        "{told}"
    );
    assert!(told.contains("(0 lost, 0 refused)"), "{told}");
    let log = std::fs::read_to_string(run.join("logs/learner-0.log")).unwrap();
    assert!(log.contains("gcbc goes on from"), "{log}");
    assert!(run.join("checkpoints/policy.safetensors").is_file());
    assert!(!run.join("graph.bin").exists());
    assert!(score(&run) >= 90.0, "{told}");
    assert_eq!(traces(&run), 20);
    let inspected = printed(
        folder.path(),
        &["inspect", "runs/other/traces/episode-0000.mcap"],
    );
    assert!(inspected.contains("versions: policy 6000"), "{inspected}");
    assert!(!inspected.contains("subgoals"), "{inspected}");
    printed(
        folder.path(),
        &["replay", "runs/other/traces/episode-0000.mcap"],
    );
    printed(folder.path(), &["report", "runs/other"]);
    let report = std::fs::read_to_string(run.join("report.html")).unwrap();
    for part in ["gcbc/policy_loss", "policy loss", "Learning"] {
        assert!(report.contains(part), "{part}");
    }
}
