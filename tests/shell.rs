//! Life in a shell: outputs that are closed, full or not read, and signals that a shell sends.

#![allow(clippy::unwrap_used)] // Helpers of tests are tests too.

use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::time::Duration;

use system_tests::{
    SMALL, binary, children, eventually, finished, formica, kill, of_role, one_at_a_time, start,
    started, text,
};

/// Arguments of every command, in a folder with a finished run called `small`; those of `NEW` are
/// made.
const COMMANDS: [(&str, &str); 14] = [
    (
        "launch",
        "small.toml --set rollouts.seconds=0.5 --set evaluation.episodes=1",
    ),
    ("check", "small.toml"),
    ("collect", "NEW.toml"),
    ("dataset", "info data.hdf5"),
    ("ceiling", "small.toml --episodes 1"),
    ("curves", "small --out NEW.svg"),
    ("inspect", "runs/small"),
    ("replay", "runs/small/traces/episode-0000.mcap"),
    (
        "recover",
        "runs/small/traces/episode-0000.mcap --out NEW.mcap",
    ),
    ("report", "small --out NEW.html"),
    ("doctor", ""),
    ("actor", "--attach small"),
    ("learner", "--domain 00000000 --folder ."),
    ("graph-builder", "--domain 00000000 --folder ."),
];

/// The same as a line for a shell, what it makes new.
fn line(folder: &Path, (name, arguments): (&str, &str), number: usize) -> String {
    let new = format!("new-{number}");
    let toml = SMALL.replace("data.hdf5", &format!("{new}.hdf5"));
    std::fs::write(folder.join(format!("{new}.toml")), toml).unwrap();
    format!("$F {name} {}", arguments.replace("NEW", &new))
}

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
    let known: Vec<&str> = COMMANDS.iter().map(|(name, _)| *name).collect();
    assert_eq!(commands(folder), known, "each command has a row here");
    let mut number = 0;
    for command in COMMANDS {
        let name = command.0;
        // The work of these is worth more than what they print.
        let works = ["launch", "collect"].contains(&name);
        let mut run = |redirection: &str| {
            number += 1;
            let _ = std::fs::remove_file(folder.join("err"));
            let line = format!("{} {redirection}", line(folder, command, number));
            let output = shell(folder, &line);
            let err = std::fs::read_to_string(folder.join("err")).unwrap_or_default();
            let told = format!("{line}\n{}{err}", text(&output));
            assert!(!told.contains("panicked"), "{told}");
            (output.status.code(), told)
        };
        let (expected, _) = run("");
        assert!(!works || expected == Some(0), "{name} works");
        for redirection in [
            ">&-",
            "2>&-",
            ">&- 2>&- <&-",
            "2>err | true; exit ${PIPESTATUS[0]}",
        ] {
            let (code, told) = run(redirection);
            assert_eq!(code, expected, "{told}");
        }
        let (code, told) = run(">/dev/full 2>err");
        let prints = expected == Some(0) && !works;
        assert_eq!(code, if prints { Some(1) } else { expected }, "{told}");
        let full = "formica: standard output cannot be written: No space left on device";
        assert!(expected != Some(0) || told.contains(full), "{told}");
        let (code, told) = run(">/dev/full 2>/dev/full");
        assert_eq!(code, if prints { Some(1) } else { expected }, "{told}");
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
