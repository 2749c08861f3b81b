//! A whole small run: to its score, with an actor killed on the way, and ended from outside.
//! One test at a time: the machine has few cores.

#![allow(clippy::unwrap_used)] // Helpers of tests are tests too.

use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Child, Stdio};
use std::sync::Mutex;
use std::time::Duration;

use system_tests::{children, eventually, formica, is_alive, shared_memory, text};

static ONE_AT_A_TIME: Mutex<()> = Mutex::new(());

/// A run of every part, too short to score well.
const SMALL: &str = r#"
[maze]
layout = "umaze"
[dataset]
path = "data.hdf5"
[collect]
transitions = 12000
[encoder]
updates = 400
hidden = [32, 32]
[graph]
nodes = 20
refresh_seconds = 1.0
[low]
updates = 600
hidden = [32, 32]
[high]
steps = 40000
environments = 64
minibatch = 1024
[evaluation]
episodes = 8
max_steps = 300
[rollouts]
seconds = 2.0
"#;

fn start(folder: &Path, sets: &[&str]) -> Child {
    std::fs::write(folder.join("small.toml"), SMALL).unwrap();
    let mut command = formica(folder, &["launch", "small.toml"]);
    sets.iter().for_each(|set| {
        command.args(["--set", set]);
    });
    command
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap()
}

fn kill(pid: u32, signal: &str) {
    let status = std::process::Command::new("kill")
        .args([signal, &pid.to_string()])
        .status();
    assert!(status.unwrap().success());
}

/// Graph-builder, learner and two actors at work.
fn all_started(launcher: &Child) -> bool {
    eventually(Duration::from_secs(60), || children(launcher).len() == 4)
}

fn command_line(pid: u32) -> String {
    let bytes = std::fs::read(format!("/proc/{pid}/cmdline")).unwrap_or_default();
    String::from_utf8_lossy(&bytes).replace('\0', " ")
}

fn actors(launcher: &Child) -> Vec<u32> {
    let own = |pid: &u32| command_line(*pid).contains(" actor ");
    children(launcher).into_iter().filter(own).collect()
}

#[test]
fn a_run_ends_with_its_score_though_an_actor_was_killed() {
    let _one = ONE_AT_A_TIME.lock();
    let folder = tempfile::tempdir().unwrap();
    let launcher = start(folder.path(), &[]);
    assert!(all_started(&launcher));
    let victim = actors(&launcher)[0];
    std::thread::sleep(Duration::from_secs(3));
    kill(victim, "-9");
    let back = eventually(Duration::from_secs(5), || {
        let now = actors(&launcher);
        now.len() == 2 && !now.contains(&victim)
    });
    assert!(back, "the actor is back within 5 s");
    let output = launcher.wait_with_output().unwrap();
    let told = text(&output);
    assert!(output.status.success(), "{told}");
    assert!(told.contains("normalized score"), "{told}");
    assert!(told.contains("restarts: 1"), "{told}");
    assert!(told.contains("(0 lost, 0 refused)"), "{told}");
    let run = folder.path().join("runs/small");
    for file in [
        "config.toml",
        "metrics.csv",
        "score.json",
        "episodes.csv",
        "graph.bin",
    ] {
        assert!(run.join(file).is_file(), "{file}");
    }
    for file in ["encoder", "low", "high"] {
        assert!(
            run.join(format!("checkpoints/{file}.safetensors"))
                .is_file(),
            "{file}"
        );
    }
    let traces = std::fs::read_dir(run.join("traces")).unwrap().flatten();
    let whole = traces
        .filter(|t| t.path().extension().is_some_and(|e| e == "mcap"))
        .count();
    assert!(whole >= 1, "no trace");
    assert_eq!(shared_memory(&run), Vec::<String>::new());
}

/// Runs to the end; an actor is killed at the first line that says `kill_at`.
fn run_to_the_end(folder: &Path, sets: &[&str], kill_at: Option<&str>) -> String {
    let mut launcher = start(folder, sets);
    let mut told = String::new();
    let mut victim = kill_at;
    for line in BufReader::new(launcher.stdout.take().unwrap()).lines() {
        let line = line.unwrap();
        if victim.is_some_and(|word| line.contains(word)) {
            kill(actors(&launcher)[0], "-9");
            victim = None;
        }
        told += &line;
        told.push('\n');
    }
    let output = launcher.wait_with_output().unwrap();
    assert!(output.status.success(), "{told}{}", text(&output));
    assert_eq!(victim, None, "{told}");
    told
}

#[test]
fn a_deterministic_run_gives_the_same_result_even_if_an_actor_dies() {
    let _one = ONE_AT_A_TIME.lock();
    let rounds = [
        "run.deterministic=true",
        "rollouts.rounds=3",
        "rollouts.episodes=12",
        "rollouts.test_every=4",
        "graph.online=true",
        "dataset.leave_out=[[1, 2]]",
        "graph.growth_states=5",
        "low.updates=300",
    ];
    let result = |kill_at: Option<&str>| {
        let folder = tempfile::tempdir().unwrap();
        let told = run_to_the_end(folder.path(), &rounds, kill_at);
        assert_eq!(told.contains("restarts: 1"), kill_at.is_some(), "{told}");
        let run = folder.path().join("runs/small");
        [
            "checkpoints/encoder.safetensors",
            "checkpoints/low.safetensors",
            "checkpoints/high.safetensors",
            "graph.bin",
            "episodes.csv",
        ]
        .map(|file| (file, std::fs::read(run.join(file)).unwrap()))
    };
    let first = result(None);
    for kill_at in [None, Some("round 2 of 3")] {
        for ((file, first), (_, second)) in first.iter().zip(result(kill_at)) {
            assert!(*first == second, "{file} differs, {kill_at:?}");
        }
    }
}

#[test]
fn an_interrupt_ends_all_in_order_and_leaves_nothing() {
    let _one = ONE_AT_A_TIME.lock();
    let folder = tempfile::tempdir().unwrap();
    let launcher = start(folder.path(), &["low.updates=1000000"]);
    assert!(all_started(&launcher));
    let family = children(&launcher);
    std::thread::sleep(Duration::from_secs(2));
    kill(launcher.id(), "-INT");
    let output = launcher.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(130), "{}", text(&output));
    assert!(family.iter().all(|pid| !is_alive(*pid)));
    assert_eq!(
        shared_memory(&folder.path().join("runs/small")),
        Vec::<String>::new()
    );
}

#[test]
fn no_child_outlives_a_killed_launcher_and_doctor_clears_what_it_left() {
    let _one = ONE_AT_A_TIME.lock();
    let folder = tempfile::tempdir().unwrap();
    let mut launcher = start(folder.path(), &["low.updates=1000000"]);
    assert!(all_started(&launcher));
    let family = children(&launcher);
    std::thread::sleep(Duration::from_secs(1));
    let run = folder.path().join("runs/small");
    assert_ne!(shared_memory(&run), Vec::<String>::new());
    launcher.kill().unwrap();
    launcher.wait().unwrap();
    let gone = || family.iter().all(|pid| !is_alive(*pid));
    assert!(
        eventually(Duration::from_secs(5), gone),
        "children are left after 5 s"
    );
    let doctor = formica(folder.path(), &["doctor"]).output().unwrap();
    assert!(doctor.status.success());
    assert!(text(&doctor).contains("cleared"), "{}", text(&doctor));
    assert_eq!(
        shared_memory(&folder.path().join("runs/small")),
        Vec::<String>::new()
    );
}
