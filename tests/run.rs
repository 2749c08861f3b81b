//! A whole small run: to its score, with an actor killed on the way, and ended from outside.
//! One test at a time: the machine has few cores.

#![allow(clippy::unwrap_used)] // Helpers of tests are tests too.

use std::io::{BufRead, BufReader};
use std::path::Path;
use std::time::Duration;

use system_tests::{
    children, eventually, finished, formica, is_alive, kill, of_role, one_at_a_time, piped,
    shared_memory, start, started, text,
};

#[test]
fn a_run_ends_with_its_score_though_an_actor_was_killed() {
    let _one = one_at_a_time();
    let (folder, launcher) = started(&[]);
    let victim = of_role(&launcher, "actor")[0];
    std::thread::sleep(Duration::from_secs(3));
    assert!(kill(victim, "-9"));
    let back = eventually(Duration::from_secs(5), || {
        let now = of_role(&launcher, "actor");
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
    for file in ["data.mapped", "codes.mapped"] {
        assert!(!run.join(file).exists(), "{file}");
    }
    let log = std::fs::read_to_string(run.join("logs/learner-0.log")).unwrap();
    assert!(!log.contains("computing them"), "{log}");
    let traces = std::fs::read_dir(run.join("traces")).unwrap().flatten();
    let whole = traces
        .filter(|t| t.path().extension().is_some_and(|e| e == "mcap"))
        .count();
    assert_eq!(whole, 8, "one for each episode of the evaluation");
    assert_eq!(shared_memory(&run), Vec::<String>::new());
}

/// Who is killed at a line that the launcher says.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Blow {
    /// A process of the role.
    To(&'static str),
    /// The launcher, after which the run is resumed.
    ToLauncher,
}

/// Runs to the end; each blow falls so many milliseconds after the first line that says its word.
fn run_to_the_end(folder: &Path, sets: &[&str], blows: &[(&str, u64, Blow)]) -> String {
    let mut launcher = start(folder, sets);
    let mut told = String::new();
    let mut blows = blows.iter().peekable();
    loop {
        let mut resumed = false;
        for line in BufReader::new(launcher.stdout.take().unwrap()).lines() {
            let line = line.unwrap();
            if let Some((_, delay, blow)) = blows.next_if(|(word, ..)| line.contains(word)) {
                std::thread::sleep(Duration::from_millis(*delay));
                match blow {
                    Blow::To(role) => {
                        let there = || !of_role(&launcher, role).is_empty();
                        assert!(eventually(Duration::from_secs(10), there), "{told}");
                        assert!(kill(of_role(&launcher, role)[0], "-9"));
                    }
                    Blow::ToLauncher => {
                        launcher.kill().unwrap();
                        resumed = true;
                    }
                }
            }
            told += &line;
            told.push('\n');
        }
        let output = launcher.wait_with_output().unwrap();
        if !resumed {
            assert!(output.status.success(), "{told}{}", text(&output));
            assert_eq!(blows.next(), None, "{told}");
            return told;
        }
        launcher = piped(&mut formica(folder, &["launch", "--resume", "small"]));
    }
}

#[test]
fn a_deterministic_run_gives_the_same_result_whoever_dies() {
    let _one = one_at_a_time();
    let rounds = [
        "run.deterministic=true",
        "run.checkpoint_seconds=0.5",
        "rollouts.rounds=3",
        "rollouts.episodes=12",
        "rollouts.test_every=4",
        "graph.online=true",
        "dataset.leave_out=[[1, 2]]",
        "graph.growth_states=5",
        "low.updates=300",
        "learner.pause_seconds=0.1",
        "graph_builder.pause_seconds=0.1",
    ];
    let result = |blows: &[(&str, u64, Blow)]| {
        let folder = tempfile::tempdir().unwrap();
        let told = run_to_the_end(folder.path(), &rounds, blows);
        assert!(told.contains("(0 lost, 0 refused)"), "{told}");
        let run = folder.path().join("runs/small");
        let log = std::fs::read_to_string(run.join("logs/learner-0.log")).unwrap();
        let deaths = |blow| blows.iter().any(|(.., b)| *b == blow);
        let learned_before = deaths(Blow::To("learner")) || deaths(Blow::ToLauncher);
        assert_eq!(log.contains("high goes on from"), learned_before, "{log}");
        [
            "checkpoints/encoder.safetensors",
            "checkpoints/low.safetensors",
            "checkpoints/high.safetensors",
            "graph.bin",
            "episodes.csv",
        ]
        .map(|file| (file, std::fs::read(run.join(file)).unwrap()))
    };
    let first = result(&[]);
    let (learner, builder) = (Blow::To("learner"), Blow::To("graph-builder"));
    let blows: [&[(&str, u64, Blow)]; 2] = [
        &[
            ("run runs/small", 1500, learner),
            ("round 1 of 3", 100, builder),
            ("round 2 of 3", 0, Blow::To("actor")),
            ("round 3 of 3", 200, learner),
            ("evaluate: ", 100, builder),
        ],
        &[
            ("run runs/small", 2000, Blow::ToLauncher),
            ("round 1 of 3", 500, Blow::ToLauncher),
            ("round 3 of 3", 100, Blow::ToLauncher),
            ("evaluate: ", 500, Blow::ToLauncher),
        ],
    ];
    for blows in blows {
        for ((file, first), (_, second)) in first.iter().zip(result(blows)) {
            assert!(*first == second, "{file} differs after {blows:?}");
        }
    }
}

#[test]
fn an_interrupt_ends_all_in_order_and_leaves_nothing() {
    let _one = one_at_a_time();
    let (folder, launcher) = started(&["low.updates=1000000"]);
    let family = children(&launcher);
    std::thread::sleep(Duration::from_secs(2));
    assert!(kill(launcher.id(), "-INT"));
    let (code, told) = finished(launcher, Duration::from_secs(5));
    assert_eq!(code, Some(130), "{told}");
    let states = std::fs::read_dir(folder.path().join("runs/small/checkpoints")).unwrap();
    let names = states.flatten().map(|file| file.file_name());
    let low = |name: &std::ffi::OsString| name.to_string_lossy().starts_with("low-");
    assert!(
        names.into_iter().any(|name| low(&name)),
        "no state was kept: {told}"
    );
    assert!(family.iter().all(|pid| !is_alive(*pid)));
    assert_eq!(
        shared_memory(&folder.path().join("runs/small")),
        Vec::<String>::new()
    );
}

#[test]
fn no_child_outlives_a_killed_launcher_and_doctor_clears_what_it_left() {
    let _one = one_at_a_time();
    let (folder, mut launcher) = started(&["low.updates=1000000"]);
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
