//! Disks that are full and folders that cannot be written: a clear error, or the files of before.

#![allow(clippy::unwrap_used, clippy::print_stderr)] // Helpers of tests are tests too.

use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;

use system_tests::{
    SMALL, binary, eventually, finished, formica, kill, of_role, one_at_a_time, piped,
    shared_memory, start, text,
};

/// The launch of the small run under a limit to the size of a file (1 KiB blocks), as on a disk
/// that is full. It holds for shared memory too.
fn launch_with_small_files(folder: &Path, blocks: u32) -> Command {
    std::fs::write(folder.join("small.toml"), SMALL).unwrap();
    let launch = format!("exec '{}' launch small.toml", binary().display());
    in_bash(
        folder,
        &format!("trap '' XFSZ; ulimit -f {blocks}; {launch}"),
    )
}

fn in_bash(folder: &Path, script: &str) -> Command {
    let mut command = Command::new("bash");
    command.args(["-c", script]).current_dir(folder);
    command.stdin(Stdio::null());
    command
}

/// Runs a script where a small disk is mounted at `place`; none on machines that do not let us.
fn on_a_small_disk(folder: &Path, place: &str, size: &str, script: &str) -> Option<(i32, String)> {
    let mount = format!("mount -t tmpfs -o size={size} none {place}");
    let probe = format!("unshare -rm sh -c '{mount}' 2>/dev/null");
    if !in_bash(folder, &probe).status().unwrap().success() {
        eprintln!("this machine lets nobody mount a disk; not tested");
        return None;
    }
    let inner = folder.join("inner.sh");
    std::fs::write(&inner, format!("{mount}\n{script}\n")).unwrap();
    let child = piped(&mut in_bash(folder, "exec unshare -rm bash inner.sh"));
    let (code, told) = finished(child, Duration::from_secs(120));
    Some((code.unwrap(), told))
}

fn collect(folder: &Path) {
    std::fs::write(folder.join("small.toml"), SMALL).unwrap();
    let collected = formica(folder, &["collect", "small.toml"])
        .output()
        .unwrap();
    assert!(collected.status.success(), "{}", text(&collected));
}

#[test]
fn a_full_disk_costs_states_but_not_the_run() {
    let _one = one_at_a_time();
    let folder = tempfile::tempdir().unwrap();
    collect(folder.path());
    std::fs::create_dir(folder.path().join("runs")).unwrap();
    // The states of the high level are larger than this; weights are not, and no trace is begun
    // on what is left.
    let script = format!(
        "'{}' launch small.toml --set high.hidden='[512, 512]' --set run.checkpoint_seconds=0.2\n\
         code=$?\ncat runs/small/logs/*\nls runs/small/checkpoints\nexit $code",
        binary().display()
    );
    let Some((code, told)) = on_a_small_disk(folder.path(), "runs", "6500k", &script) else {
        return;
    };
    assert_eq!(code, 0, "{told}");
    assert!(told.contains("normalized score"), "{told}");
    assert!(
        told.contains("no state was kept, the one before stays"),
        "{told}"
    );
    assert!(told.contains("No space left on device"), "{told}");
    assert!(told.contains("high.safetensors"), "{told}");
    assert!(told.contains("are not for traces"), "{told}");
    assert!(!told.contains(".part"), "{told}");
}

#[test]
fn data_that_cannot_be_prepared_end_the_run_before_its_processes_start() {
    let _one = one_at_a_time();
    let folder = tempfile::tempdir().unwrap();
    collect(folder.path());
    std::fs::create_dir(folder.path().join("runs")).unwrap();
    let script = format!(
        "'{}' launch small.toml\ncode=$?\nls runs/small runs/small/logs\nexit $code",
        binary().display()
    );
    let Some((code, told)) = on_a_small_disk(folder.path(), "runs", "1m", &script) else {
        return;
    };
    assert_eq!(code, 1, "{told}");
    let cause = "runs/small/data.mapped cannot be written: No space left on device";
    assert!(told.contains(cause) && told.contains("make room"), "{told}");
    assert!(
        !told.contains(".part") && !told.contains("learner"),
        "{told}"
    );
}

#[test]
fn prepared_data_that_are_gone_end_the_run_with_the_remedy() {
    let _one = one_at_a_time();
    let folder = tempfile::tempdir().unwrap();
    let launcher = start(folder.path(), &["low.updates=1000000"]);
    let run = folder.path().join("runs/small");
    assert!(eventually(Duration::from_secs(60), || run
        .join("graph.bin")
        .is_file()));
    std::fs::remove_file(run.join("data.mapped")).unwrap();
    for learner in of_role(&launcher, "learner") {
        assert!(kill(learner, "-KILL"));
    }
    let (code, told) = finished(launcher, Duration::from_secs(60));
    assert_eq!(code, Some(2), "{told}");
    assert!(
        told.contains("data.mapped cannot be read: No such file"),
        "{told}"
    );
    assert!(
        told.contains("`formica launch --resume RUN` recreates it"),
        "{told}"
    );
    assert_eq!(shared_memory(&run), Vec::<String>::new());
}

#[test]
fn weights_that_cannot_be_written_end_the_run_with_the_cause() {
    let _one = one_at_a_time();
    let folder = tempfile::tempdir().unwrap();
    let run = folder.path().join("runs/small");
    let sets = [
        "learner.restarts=1",
        "learner.pause_seconds=0.1",
        "rollouts.seconds=4",
    ];
    let launcher = start(folder.path(), &sets);
    assert!(eventually(Duration::from_secs(60), || run
        .join("graph.bin")
        .is_file()));
    std::fs::rename(run.join("checkpoints"), run.join("elsewhere")).unwrap();
    std::fs::write(run.join("checkpoints"), "not a folder").unwrap();
    let (code, told) = finished(launcher, Duration::from_secs(60));
    assert_eq!(code, Some(1), "{told}");
    assert!(
        told.contains("learner-0 ended with exit status: 1"),
        "{told}"
    );
    assert!(
        told.contains("checkpoints/") && told.contains("Not a directory"),
        "{told}"
    );
    assert_eq!(shared_memory(&run), Vec::<String>::new());
}

#[test]
fn too_little_shared_memory_is_said_before_anything_starts() {
    let _one = one_at_a_time();
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("small.toml"), SMALL).unwrap();
    let script = format!("'{}' launch small.toml", binary().display());
    let Some((code, told)) = on_a_small_disk(folder.path(), "/dev/shm", "4m", &script) else {
        return;
    };
    assert_eq!(code, 2, "{told}");
    assert!(
        told.contains("/dev/shm has 4 MiB free and the run can need"),
        "{told}"
    );
    assert!(!folder.path().join("runs").exists());
}

#[test]
fn a_data_set_that_does_not_fit_is_an_error_and_leaves_nothing() {
    let _one = one_at_a_time();
    let folder = tempfile::tempdir().unwrap();
    let launcher = piped(&mut launch_with_small_files(folder.path(), 64));
    let (code, told) = finished(launcher, Duration::from_secs(60));
    assert_eq!(code, Some(1), "{told}");
    assert!(told.contains("data.hdf5"), "{told}");
    assert!(told.contains("File too large"), "{told}");
    let names = std::fs::read_dir(folder.path()).unwrap().flatten();
    let names: Vec<_> = names
        .map(|file| file.file_name().into_string().unwrap())
        .collect();
    assert_eq!(names, ["small.toml"]);
}

#[test]
fn a_folder_that_cannot_be_made_is_an_error_with_its_name() {
    let _one = one_at_a_time();
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("runs"), "not a folder").unwrap();
    let (code, told) = finished(start(folder.path(), &[]), Duration::from_secs(60));
    assert_eq!(code, Some(1), "{told}");
    assert!(told.contains("making the folder 'runs'"), "{told}");
}

#[test]
fn a_damaged_state_is_named_and_the_one_before_is_gone_on_from() {
    let _one = one_at_a_time();
    let folder = tempfile::tempdir().unwrap();
    let sets = ["low.updates=1000000", "run.checkpoint_seconds=0.2"];
    let launcher = start(folder.path(), &sets);
    let run = folder.path().join("runs/small");
    let states = || {
        let entries = std::fs::read_dir(run.join("checkpoints"))
            .into_iter()
            .flatten()
            .flatten();
        let low = |path: &std::path::PathBuf| {
            let name = path.file_name().unwrap().to_string_lossy().into_owned();
            name.starts_with("low-") && name.ends_with(".state")
        };
        let mut found: Vec<_> = entries.map(|entry| entry.path()).filter(low).collect();
        found.sort();
        found
    };
    let two = || states().len() >= 2;
    assert!(eventually(Duration::from_secs(60), two));
    assert!(kill(launcher.id(), "-INT"));
    let (code, told) = finished(launcher, Duration::from_secs(6));
    assert_eq!(code, Some(130), "{told}");
    let [before, newest] = states().try_into().unwrap();
    let mut bytes = std::fs::read(&newest).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    std::fs::write(&newest, bytes).unwrap();
    let number = |path: &Path| {
        let name = path.file_stem().unwrap().to_string_lossy().into_owned();
        name.trim_start_matches("low-")
            .trim_start_matches('0')
            .to_owned()
    };
    let launcher = piped(&mut formica(
        folder.path(),
        &["launch", "--resume", "small"],
    ));
    let log = || std::fs::read_to_string(run.join("logs/learner-0.log")).unwrap();
    let gone_on = format!("low goes on from {}", number(&before));
    assert!(
        eventually(Duration::from_secs(30), || log().contains(&gone_on)),
        "{gone_on}: {}",
        log()
    );
    let damaged = format!(
        "{} is damaged: its checksum does not hold",
        newest.file_name().unwrap().to_string_lossy()
    );
    assert!(log().contains(&damaged), "{}", log());
    assert!(kill(launcher.id(), "-INT"));
    let (code, told) = finished(launcher, Duration::from_secs(6));
    assert_eq!(code, Some(130), "{told}");
    assert_eq!(shared_memory(&run), Vec::<String>::new());
}

#[test]
fn a_data_set_that_finds_no_room_leaves_nothing() {
    let _one = one_at_a_time();
    let folder = tempfile::tempdir().unwrap();
    collect(folder.path());
    std::fs::create_dir(folder.path().join("disk")).unwrap();
    let formica = binary().display().to_string();
    let script = format!(
        "'{formica}' collect small.toml --set dataset.path=disk/new/d.hdf5; echo \"code $?\"\n\
         '{formica}' dataset convert data.hdf5 disk/new/m --to minari; echo \"code $?\"\n\
         '{formica}' dataset convert data.hdf5 disk/x.npz --to ogbench; echo \"code $?\"\n\
         echo \"left $(ls -A disk | grep . || echo none)\""
    );
    let Some((code, told)) = on_a_small_disk(folder.path(), "disk", "256k", &script) else {
        return;
    };
    assert_eq!(code, 0, "{told}");
    assert_eq!(told.matches("code 1\n").count(), 3, "{told}");
    for path in ["disk/new/d.hdf5", "disk/new/m", "disk/x.npz"] {
        let refused = |line: &str| {
            line.starts_with("formica: ") && line.contains(path) && line.contains("No space left")
        };
        assert!(told.lines().any(refused), "{path} in {told}");
    }
    let left: Vec<&str> = told
        .lines()
        .filter(|line| line.starts_with("left "))
        .collect();
    assert_eq!(left, ["left none"], "{told}");
}
