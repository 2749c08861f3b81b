//! Runs that are looked at from other places: another /tmp, /dev/shm, PID, IPC or user namespace, another
//! TMPDIR, small limits. What is not seen from there is not dead.

#![allow(clippy::unwrap_used)] // Helpers of tests are tests too.

use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use system_tests::{
    SMALL, binary, children, domain, eventually, finished, kill, one_at_a_time, piped,
    shared_memory, start,
};
use tempfile::TempDir;

/// A folder that is seen where another /tmp is mounted.
fn folder() -> TempDir {
    tempfile::tempdir_in("/var/tmp").unwrap()
}

fn in_bash(folder: &Path, script: &str) -> Command {
    let mut command = Command::new("bash");
    command.args(["-c", script]).current_dir(folder);
    command.env("F", binary()).stdin(Stdio::null());
    command
}

/// A script in namespaces of its own, made by `unshare` with these options; none on machines that do
/// not let us.
#[allow(clippy::print_stderr)] // A test that was left out says so.
fn elsewhere(folder: &Path, options: &str, script: &str) -> Option<Child> {
    let probe = format!("unshare {options} true 2>/dev/null");
    if !in_bash(folder, &probe).status().unwrap().success() {
        eprintln!("this machine does not let us `unshare {options}`; not tested");
        return None;
    }
    let script = format!("exec unshare {options} bash -c '{script}'");
    Some(piped(&mut in_bash(folder, &script)))
}

/// The same, to its end.
fn told_elsewhere(folder: &Path, options: &str, script: &str) -> Option<(Option<i32>, String)> {
    elsewhere(folder, options, script).map(|child| finished(child, Duration::from_secs(60)))
}

/// Options of `unshare` that give a place of its own to mount in.
const MOUNT: &str = "-m --propagation private";
const OTHER_TMP: &str = "mount -t tmpfs none /tmp";
const OTHER_MEMORY: &str = "mount -t tmpfs none /dev/shm";

fn small_run(sets: &[&str]) -> (TempDir, Child) {
    let folder = folder();
    let launcher = start(folder.path(), sets);
    let graph = folder.path().join("runs/small/graph.bin");
    assert!(eventually(Duration::from_secs(90), || graph.is_file()
        && children(&launcher).len() == 4));
    (folder, launcher)
}

fn sent(run: &Path, least: usize) -> bool {
    let ledger = wire::Reader::Learner.ledger(run);
    let books = wire::Books::read(&ledger).unwrap_or_default();
    let attached = |source: &&wire::Source| source.actor >= 2 && source.transitions > 0;
    books.sources().filter(attached).count() >= least
}

#[test]
fn a_live_run_is_left_alone_by_whoever_sees_a_part_of_it() {
    let _one = one_at_a_time();
    let (folder, launcher) = small_run(&["rollouts.seconds=30"]);
    let (here, run) = (folder.path(), folder.path().join("runs/small"));
    let id = domain(&run);
    let files = shared_memory(&run).len();
    let user = rustix::process::getuid().as_raw();
    for other in [OTHER_TMP, OTHER_MEMORY, "true"] {
        let options = format!("{MOUNT} -p -f -i --mount-proc");
        let script = format!("{other}; $F doctor; $F doctor --clear {id}");
        if let Some((code, told)) = told_elsewhere(here, &options, &script) {
            assert_eq!(code, Some(1), "{other}\n{told}");
            assert!(told.contains(&format!("run {id}")), "{other}\n{told}");
            assert!(told.contains(", alive"), "{other}\n{told}");
            assert!(told.contains("not cleared: a process holds it"), "{told}");
            assert!(!told.contains("dead"), "{other}\n{told}");
        }
    }
    // Another launch from there clears what is dead, and this is not.
    let script = format!("{OTHER_TMP}; timeout -s INT 4 $F launch small.toml; true");
    if let Some((_, told)) = told_elsewhere(here, MOUNT, &script) {
        assert!(told.contains("run runs/small-2"), "{told}");
        assert!(!told.contains("cleared"), "{told}");
    }
    let attach = "$F actor --attach small";
    for (other, missing) in [
        (OTHER_TMP, format!("there is no '/tmp/formica-{user}/{id}'")),
        (
            OTHER_MEMORY,
            format!("there is no '/dev/shm/formica{user}_{id}_lock'"),
        ),
    ] {
        if let Some((code, told)) = told_elsewhere(here, MOUNT, &format!("{other}; {attach}")) {
            assert_eq!(code, Some(1), "{told}");
            assert!(told.contains("not visible from here"), "{told}");
            assert!(told.contains(&missing), "{missing}\n{told}");
            assert!(!told.contains("--resume"), "{told}");
        }
    }
    let script = format!("{OTHER_TMP}; {OTHER_MEMORY}; {attach}; $F launch --resume small");
    if let Some((code, told)) = told_elsewhere(here, MOUNT, &script) {
        assert_eq!(code, Some(1), "{told}");
        assert!(
            told.contains("is alive, but its channels are not visible from here"),
            "{told}"
        );
        assert!(told.contains("the run in runs/small is alive"), "{told}");
    }
    assert!(
        shared_memory(&run).len() >= files,
        "nothing was taken from it"
    );
    let actor = piped(&mut in_bash(here, &format!("exec {attach}")));
    assert!(eventually(Duration::from_secs(10), || sent(&run, 1)));
    let (code, told) = finished(launcher, Duration::from_secs(120));
    assert_eq!(code, Some(0), "{told}");
    assert!(told.contains("(0 lost, 0 refused)"), "{told}");
    assert!(!told.contains("restarts"), "{told}");
    let (code, told) = finished(actor, Duration::from_secs(5));
    assert_eq!(code, Some(0), "{told}");
    assert_eq!(shared_memory(&run), Vec::<String>::new());
}

#[test]
fn actors_attach_from_other_namespaces_and_count_as_alive() {
    let _one = one_at_a_time();
    let sets = ["rollouts.seconds=20", "topology.max_actors=8"];
    let (folder, launcher) = small_run(&sets);
    let (here, run) = (folder.path(), folder.path().join("runs/small"));
    // As in a shell that a process of a run has started: its launcher is not this actor's.
    let attach = "FORMICA_LAUNCHER=1 exec $F actor --attach small";
    let options = [
        "-p -f --mount-proc",
        "-i",
        "-U -r",
        "-m -n",
        "-m -p -f -i -n -u --mount-proc",
    ];
    let actors: Vec<_> = options
        .iter()
        .filter_map(|options| elsewhere(here, options, attach))
        .collect();
    // Long enough for many sweeps of the launcher's, which must not take them for dead.
    assert!(eventually(Duration::from_secs(15), || sent(
        &run,
        actors.len()
    )));
    let (code, told) = finished(launcher, Duration::from_secs(120));
    assert_eq!(code, Some(0), "{told}");
    assert!(told.contains("(0 lost, 0 refused)"), "{told}");
    for actor in actors {
        let (code, told) = finished(actor, Duration::from_secs(10));
        assert_eq!(code, Some(0), "{told}");
        assert!(told.contains("all acknowledged"), "{told}");
    }
    assert_eq!(shared_memory(&run), Vec::<String>::new());
}

#[test]
fn a_launcher_in_another_namespace_runs_and_leaves_nothing() {
    let _one = one_at_a_time();
    let folder = folder();
    let here = folder.path();
    std::fs::write(here.join("small.toml"), SMALL).unwrap();
    let script = "HOME= TMPDIR=/nowhere $F launch small.toml";
    let options = format!("{MOUNT} -p -f -i -U -r --mount-proc");
    let Some((code, told)) = told_elsewhere(here, &options, script) else {
        return;
    };
    assert_eq!(code, Some(0), "{told}");
    assert!(told.contains("normalized score"), "{told}");
    assert!(!told.contains("restarts"), "{told}");
    assert_eq!(
        shared_memory(&here.join("runs/small")),
        Vec::<String>::new()
    );
}

#[test]
fn small_limits_are_named_before_anything_starts() {
    let _one = one_at_a_time();
    let (folder, launcher) = small_run(&["rollouts.seconds=20"]);
    let here = folder.path();
    for (command, code) in [
        ("launch small.toml", 1),
        ("check small.toml", 1),
        ("actor --attach small", 1),
    ] {
        for (limit, told_of) in [
            ("-n 64", "a process may have 64 open files here"),
            (
                "-v 200000",
                "a process may have 200000 KiB of address space here",
            ),
        ] {
            let script = format!("ulimit {limit}; exec $F {command}");
            let child = piped(&mut in_bash(here, &script));
            let (ended, told) = finished(child, Duration::from_secs(20));
            assert_eq!(ended, Some(code), "{script}\n{told}");
            assert!(told.contains(told_of), "{script}\n{told}");
            assert!(
                told.contains(&format!("`ulimit {}", &limit[..2])),
                "{script}\n{told}"
            );
            assert!(!told.contains("InternalFailure"), "{script}\n{told}");
        }
    }
    assert!(!here.join("runs/small-2").exists());
    // A soft limit is raised, and nothing said of it.
    let script = "ulimit -Sn 64; exec $F actor --attach small";
    let actor = piped(&mut in_bash(here, script));
    let run = here.join("runs/small");
    assert!(eventually(Duration::from_secs(10), || sent(&run, 1)));
    assert!(kill(actor.id(), "-INT"));
    let (code, told) = finished(actor, Duration::from_secs(5));
    assert_eq!(code, Some(0), "{told}");
    assert!(!told.contains("limit"), "{told}");
    assert!(kill(launcher.id(), "-INT"));
    let (code, told) = finished(launcher, Duration::from_secs(10));
    assert_eq!(code, Some(130), "{told}");
}

#[test]
fn a_segment_larger_than_a_file_may_be_is_named() {
    let _one = one_at_a_time();
    let folder = folder();
    let here = folder.path();
    std::fs::write(here.join("small.toml"), SMALL).unwrap();
    let collect = piped(&mut in_bash(here, "exec $F collect small.toml"));
    assert_eq!(finished(collect, Duration::from_secs(60)).0, Some(0));
    let launch = piped(&mut in_bash(
        here,
        "ulimit -f 64; exec $F launch small.toml",
    ));
    let (code, told) = finished(launch, Duration::from_secs(20));
    assert_eq!(code, Some(1), "{told}");
    assert!(
        told.contains("a process may have 64 KiB in a file here"),
        "{told}"
    );
    let collect = piped(&mut in_bash(
        here,
        "rm data.hdf5; ulimit -f 64; exec $F collect small.toml",
    ));
    let (code, told) = finished(collect, Duration::from_secs(60));
    assert_eq!(code, Some(1), "no signal: {told}");
    assert!(told.contains("File too large"), "{told}");
}

#[test]
fn a_place_that_is_missing_closed_or_taken_is_named_with_what_to_do() {
    let _one = one_at_a_time();
    let folder = folder();
    let here = folder.path();
    std::fs::write(here.join("small.toml"), SMALL).unwrap();
    let user = rustix::process::getuid().as_raw();
    for (made, told_of) in [
        (
            "mount -t tmpfs -o ro none /dev/shm",
            "channels cannot lie in '/dev/shm': it is mounted read-only",
        ),
        (
            "mount -t tmpfs none /dev; mknod -m 666 /dev/null c 1 3; mknod -m 666 /dev/urandom c 1 9",
            "channels cannot lie in '/dev/shm': it is not there",
        ),
        (
            "mount -t tmpfs -o ro none /tmp",
            "channels cannot lie in '/tmp': it is mounted read-only",
        ),
        (
            "mount -t tmpfs none /tmp; ln -s /var /tmp/formica-USER",
            "'/tmp/formica-USER' is a symbolic link",
        ),
        (
            "mount -t tmpfs none /tmp; touch /tmp/formica-USER",
            "'/tmp/formica-USER' is a file",
        ),
        (
            "mount -t tmpfs none /tmp; mkdir /tmp/formica-USER; chown 12345 /tmp/formica-USER",
            "'/tmp/formica-USER' belongs to the user with number 12345",
        ),
    ] {
        let (made, told_of) = (
            made.replace("USER", &user.to_string()),
            told_of.replace("USER", &user.to_string()),
        );
        let script = format!(
            "{made}; export TMPDIR=/nowhere; $F doctor; echo $?; $F launch small.toml --set dataset.path=none.hdf5"
        );
        let Some((code, told)) = told_elsewhere(here, MOUNT, &script) else {
            return;
        };
        assert_eq!(told.matches(&told_of).count(), 2, "{script}\n{told}");
        assert_ne!(code, Some(0), "{script}\n{told}");
        assert!(!told.contains("nowhere"), "{told}");
        assert!(told.contains("\n1\n"), "{told}");
        assert!(
            !told.contains("collect:") && !here.join("runs").exists(),
            "{told}"
        );
    }
}
