//! Life in a shell: outputs that are closed, full or not read, and signals that a shell sends.

#![allow(clippy::unwrap_used)] // Helpers of tests are tests too.

use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::time::Duration;

use system_tests::{
    SMALL, binary, children, eventually, finished, formica, kill, of_role, one_at_a_time, start,
    started, text,
};

/// Arguments of every command, in a folder with a finished run called `small`, and the exit code
/// of its work.
const COMMANDS: [(&str, &str, i32); 14] = [
    (
        "launch",
        "launch small.toml --set rollouts.seconds=0.5 --set evaluation.episodes=1",
        0,
    ),
    ("check", "check small.toml", 0),
    ("collect", "collect other.toml", 0),
    ("dataset", "dataset info data.hdf5", 0),
    ("ceiling", "ceiling small.toml --episodes 1", 0),
    ("curves", "curves small", 0),
    ("inspect", "inspect runs/small", 0),
    ("replay", "replay runs/small/traces/episode-0000.mcap", 0),
    (
        "recover",
        "recover runs/small/traces/episode-0000.mcap --out NEW.mcap",
        0,
    ),
    ("report", "report small --out NEW.html", 0),
    ("doctor", "doctor", 0),
    ("actor", "actor --attach small", 1),
    ("learner", "learner --domain 00000000 --folder .", 1),
    (
        "graph-builder",
        "graph-builder --domain 00000000 --folder .",
        1,
    ),
];

/// Names of all commands, as clap lists them.
fn commands(folder: &Path) -> Vec<String> {
    let help = text(&formica(folder, &["--help"]).output().unwrap());
    let mut lines = help.lines().skip_while(|line| *line != "Commands:").skip(1);
    let names = lines
        .by_ref()
        .take_while(|line| !line.is_empty())
        .filter_map(|line| line.split_whitespace().next());
    names
        .filter(|name| !["help", "watch"].contains(name))
        .map(str::to_owned)
        .collect()
}

/// Runs a command of the binary as a shell would, redirections and all.
fn shell(folder: &Path, line: &str) -> Output {
    Command::new("bash")
        .args(["-c", line])
        .env("F", binary())
        .current_dir(folder)
        .stdin(Stdio::null())
        .output()
        .unwrap()
}

#[test]
fn every_command_does_its_work_whatever_becomes_of_its_output() {
    let _one = one_at_a_time();
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let (code, told) = finished(start(folder, &[]), Duration::from_secs(300));
    assert_eq!(code, Some(0), "{told}");
    let known: Vec<&str> = COMMANDS.iter().map(|(name, ..)| *name).collect();
    assert_eq!(commands(folder), known, "each command has a row here");
    for (number, (name, line, code)) in COMMANDS.iter().enumerate() {
        // The work of these is worth more than what they print.
        let works = ["launch", "collect"].contains(name);
        for (way, redirection, of_full) in [
            (0, ">&-", None),
            (1, "2>&-", None),
            (2, ">&- 2>&- <&-", None),
            (3, "2>err | true; exit ${PIPESTATUS[0]}", None),
            (4, ">/dev/full 2>err", Some(1)),
            (5, ">/dev/full 2>/dev/full", Some(1)),
        ] {
            let line = line.replace("NEW", &format!("new-{number}-{way}"));
            let toml = SMALL.replace("data.hdf5", &format!("other-{way}.hdf5"));
            std::fs::write(folder.join("other.toml"), toml).unwrap();
            let _ = std::fs::remove_file(folder.join("err"));
            let output = shell(folder, &format!("$F {line} {redirection}"));
            let err = std::fs::read_to_string(folder.join("err")).unwrap_or_default();
            let told = format!("{line} {redirection}: {output:?}\n{err}");
            let expected = of_full.filter(|_| !works).unwrap_or(*code);
            assert_eq!(output.status.code(), Some(expected), "{told}");
            assert!(!told.contains("panicked"), "{told}");
            if way == 4 && *code == 0 {
                let full = "formica: standard output cannot be written: No space left on device";
                assert!(err.contains(full), "{told}");
            }
        }
    }
}

#[test]
fn a_binary_that_is_replaced_under_a_run_still_starts_its_processes() {
    let _one = one_at_a_time();
    let folder = tempfile::tempdir().unwrap();
    let copy = folder.path().join("formica");
    std::fs::copy(binary(), &copy).unwrap();
    std::fs::write(folder.path().join("small.toml"), SMALL).unwrap();
    let mut command = Command::new(&copy);
    command
        .args(["launch", "small.toml", "--set", "rollouts.seconds=6"])
        .current_dir(folder.path());
    let launcher = system_tests::piped(&mut command);
    assert!(eventually(Duration::from_secs(60), || {
        children(&launcher).len() == 4
    }));
    // As a build or a package manager does it.
    std::fs::write(folder.path().join("new"), "not a program").unwrap();
    std::fs::rename(folder.path().join("new"), &copy).unwrap();
    assert!(kill(of_role(&launcher, "actor")[0], "-9"));
    let (code, told) = finished(launcher, Duration::from_secs(120));
    assert_eq!(code, Some(0), "{told}");
    assert!(told.contains("restarts: 1"), "{told}");
    assert!(told.contains("normalized score"), "{told}");
}

#[test]
fn ctrl_z_stops_all_processes_and_nothing_is_held_against_them() {
    let _one = one_at_a_time();
    let (_folder, launcher) = started(&[
        "rollouts.seconds=6",
        "actor.hung_seconds=2",
        "learner.hung_seconds=2",
        "graph_builder.hung_seconds=2",
    ]);
    let is_stopped = |pid: u32| {
        let stat = std::fs::read_to_string(format!("/proc/{pid}/stat")).unwrap_or_default();
        stat.rsplit(") ")
            .next()
            .unwrap_or_default()
            .starts_with('T')
    };
    let all = || {
        let mut all = children(&launcher);
        all.push(launcher.id());
        all
    };
    assert!(kill(launcher.id(), "-TSTP"));
    let stopped = || all().into_iter().all(is_stopped);
    assert!(eventually(Duration::from_secs(10), stopped));
    std::thread::sleep(Duration::from_secs(4));
    assert!(stopped());
    assert!(kill(launcher.id(), "-CONT"));
    let go_on = || !all().into_iter().any(is_stopped);
    assert!(eventually(Duration::from_secs(10), go_on));
    let (code, told) = finished(launcher, Duration::from_secs(120));
    assert_eq!(code, Some(0), "{told}");
    assert!(!told.contains("restarts"), "{told}");
    let rates = told.split(" at ").skip(1);
    let rates = rates.filter_map(|rest| rest.split_once(" steps/s")?.0.parse::<f64>().ok());
    for rate in rates {
        assert!((1.0..1e5).contains(&rate), "{rate} in {told}");
    }
}
