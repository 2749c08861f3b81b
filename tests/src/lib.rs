//! Support of the whole-process tests: the built binary, run in a folder of its own.

use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::sync::atomic::AtomicBool;
use std::sync::{Arc, Mutex, MutexGuard, Once, PoisonError};
use std::time::{Duration, Instant};

use tempfile::TempDir;

/// The `formica` binary of this build; cargo does not build another package's binary for a test,
/// so the first caller does.
///
/// # Panics
/// When it cannot be built.
#[must_use]
#[allow(clippy::panic, clippy::expect_used)]
pub fn binary() -> PathBuf {
    static BUILT: Once = Once::new();
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    BUILT.call_once(|| {
        heed_signals();
        let cargo = std::env::var("CARGO").unwrap_or_else(|_| "cargo".to_owned());
        let status = Command::new(cargo)
            .args(["build", "--quiet", "--package", "launcher"])
            .current_dir(&root)
            .status()
            .expect("cargo can be started");
        assert!(status.success(), "cargo build --package launcher: {status}");
    });
    let folder =
        std::env::var("CARGO_TARGET_DIR").map_or_else(|_| root.join("target"), PathBuf::from);
    folder.join("debug/formica")
}

/// Has the test's children heed signals, which they would not where the tests themselves run as a
/// shell's background job: a signal that is ignored stays so in children, one with a handler does not.
fn heed_signals() {
    use signal_hook::consts::{SIGHUP, SIGINT, SIGQUIT, SIGTERM};
    for signal in [SIGHUP, SIGINT, SIGQUIT, SIGTERM] {
        let always = Arc::new(AtomicBool::new(true));
        // It cannot fail for these; if it did, a test would say so.
        let _ = signal_hook::flag::register_conditional_shutdown(signal, 128 + signal, always);
    }
}

/// A command of the binary in a folder, its output kept.
#[must_use]
pub fn formica(folder: &Path, arguments: &[&str]) -> Command {
    let mut command = Command::new(binary());
    command
        .args(arguments)
        .current_dir(folder)
        .stdin(Stdio::null());
    command
}

/// Standard output and standard error as one text.
#[must_use]
pub fn text(output: &Output) -> String {
    let (out, err) = (&output.stdout, &output.stderr);
    format!(
        "{}{}",
        String::from_utf8_lossy(out),
        String::from_utf8_lossy(err)
    )
}

/// Process ids of the children that a launcher has now.
#[must_use]
pub fn children(launcher: &Child) -> Vec<u32> {
    let id = launcher.id();
    let path = format!("/proc/{id}/task/{id}/children");
    let text = std::fs::read_to_string(path).unwrap_or_default();
    text.split_whitespace()
        .filter_map(|pid| pid.parse().ok())
        .collect()
}

/// Whether a process is there and not merely unreaped.
#[must_use]
pub fn is_alive(pid: u32) -> bool {
    std::fs::read_to_string(format!("/proc/{pid}/stat")).is_ok_and(|stat| {
        stat.rsplit(") ")
            .next()
            .is_some_and(|rest| !rest.starts_with('Z'))
    })
}

/// Waits until something holds; false after the deadline.
pub fn eventually(deadline: Duration, mut holds: impl FnMut() -> bool) -> bool {
    let start = Instant::now();
    while start.elapsed() < deadline {
        if holds() {
            return true;
        }
        std::thread::sleep(Duration::from_millis(50));
    }
    holds()
}

/// Names in shared memory that a run left, by the id of its domain; other runs may be alive.
///
/// # Panics
/// When the run's folder does not tell the id.
#[must_use]
pub fn shared_memory(run: &Path) -> Vec<String> {
    shared_memory_of(&domain(run))
}

/// Id of a run's domain of channels.
///
/// # Panics
/// When the run's folder does not tell it.
#[must_use]
#[allow(clippy::expect_used)]
pub fn domain(run: &Path) -> String {
    let id = std::fs::read_to_string(run.join("domain")).expect("a run notes its domain");
    assert!(!id.is_empty(), "a domain has a name");
    id
}

/// The same names, by the id.
#[must_use]
pub fn shared_memory_of(id: &str) -> Vec<String> {
    let entries = std::fs::read_dir("/dev/shm")
        .into_iter()
        .flatten()
        .flatten();
    let names = entries.filter_map(|entry| entry.file_name().into_string().ok());
    names.filter(|name| name.contains(id)).collect()
}

/// A run of every part, too short to score well.
pub const SMALL: &str = r#"
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

/// Launches the small run in a folder, its output piped.
///
/// # Panics
/// When it cannot be started.
#[must_use]
#[allow(clippy::expect_used)]
pub fn start(folder: &Path, sets: &[&str]) -> Child {
    // Another launcher may be reading it.
    let part = folder.join("small.toml.part");
    std::fs::write(&part, SMALL)
        .and_then(|()| std::fs::rename(&part, folder.join("small.toml")))
        .expect("a folder to write in");
    let mut command = formica(folder, &["launch", "small.toml"]);
    sets.iter().for_each(|set| {
        command.args(["--set", set]);
    });
    piped(&mut command)
}

/// Bytes that a pipe holds, where the system lets it.
const PIPE: usize = 1 << 20;

/// Starts a command, its output piped.
///
/// # Panics
/// When it cannot be started.
#[must_use]
#[allow(clippy::expect_used)]
pub fn piped(command: &mut Command) -> Child {
    let command = command.stdout(Stdio::piped()).stderr(Stdio::piped());
    let child = command.spawn().expect("the binary can be started");
    // It is read at the end; until then a long run must not fill it.
    if let Some(out) = &child.stdout {
        let _ = rustix::pipe::fcntl_setpipe_size(out, PIPE);
    }
    child
}

/// Sends a signal, by its name as in `kill -9`; whether there was anyone to send it to.
#[must_use]
pub fn kill(pid: u32, signal: &str) -> bool {
    Command::new("kill")
        .args([signal, &pid.to_string()])
        .stderr(Stdio::null())
        .status()
        .is_ok_and(|status| status.success())
}

/// Process ids of a launcher's processes of a role, by its name.
#[must_use]
pub fn of_role(launcher: &Child, role: &str) -> Vec<u32> {
    let own = |pid: &u32| {
        let bytes = std::fs::read(format!("/proc/{pid}/cmdline")).unwrap_or_default();
        let line = String::from_utf8_lossy(&bytes).replace('\0', " ");
        line.contains(&format!(" {role} "))
    };
    children(launcher).into_iter().filter(own).collect()
}

/// Whether graph-builder, learner and two actors are at work, or will be soon.
fn all_started(launcher: &Child) -> bool {
    eventually(Duration::from_secs(60), || children(launcher).len() == 4)
}

/// Launches the small run in a folder of its own and waits until all of its processes are there.
///
/// # Panics
/// When they are not.
#[must_use]
#[allow(clippy::expect_used)]
pub fn started(sets: &[&str]) -> (TempDir, Child) {
    let folder = tempfile::tempdir().expect("a folder to write in");
    let launcher = start(folder.path(), sets);
    assert!(all_started(&launcher), "the processes of a run");
    (folder, launcher)
}

/// Waits for a process to end, at most so long; its exit code and what it said.
///
/// # Panics
/// When it does not end.
#[must_use]
#[allow(clippy::panic, clippy::expect_used)]
pub fn finished(mut child: Child, deadline: Duration) -> (Option<i32>, String) {
    // What it says is read meanwhile: a full pipe would stop it.
    let read = |stream: Option<Box<dyn Read + Send>>| {
        std::thread::spawn(move || {
            let mut bytes = vec![];
            if let Some(mut stream) = stream {
                let _ = stream.read_to_end(&mut bytes);
            }
            String::from_utf8_lossy(&bytes).into_owned()
        })
    };
    let out = child
        .stdout
        .take()
        .map(|s| Box::new(s) as Box<dyn Read + Send>);
    let err = child
        .stderr
        .take()
        .map(|s| Box::new(s) as Box<dyn Read + Send>);
    let (out, err) = (read(out), read(err));
    let ended = eventually(deadline, || matches!(child.try_wait(), Ok(Some(_))));
    if !ended {
        let _ = child.kill();
    }
    let status = child.wait().expect("a child can be waited for");
    let told = out.join().unwrap_or_default() + &err.join().unwrap_or_default();
    assert!(ended, "it did not end within {deadline:?}:\n{told}");
    (status.code(), told)
}

/// One test at a time: the machine has few cores.
///
/// # Panics
/// Never: a test that failed leaves the next one its turn.
pub fn one_at_a_time() -> MutexGuard<'static, ()> {
    static ONE: Mutex<()> = Mutex::new(());
    ONE.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Waits for the end of a run: with a score, without lost transitions, and with nothing left in shared
/// memory. Returns its output.
///
/// # Panics
/// If the run ends otherwise.
pub fn ends_well(folder: &Path, launcher: Child, deadline: Duration) -> String {
    let (code, told) = finished(launcher, deadline);
    assert_eq!(code, Some(0), "{told}");
    assert!(told.contains("normalized score"), "{told}");
    assert!(
        told.contains("received by the learner (0 lost, 0 refused)"),
        "{told}"
    );
    assert!(
        told.contains("received by the graph-builder (0 lost, 0 refused)"),
        "{told}"
    );
    assert_eq!(
        shared_memory(&folder.join("runs/small")),
        Vec::<String>::new()
    );
    told
}

/// Sums over all processes of a launcher: resident memory (bytes), open descriptors, and the size of the
/// run's files in shared memory.
#[must_use]
pub fn footprint(launcher: &Child, id: &str) -> [u64; 3] {
    let mut sums = [0; 3];
    let mut family = children(launcher);
    family.push(launcher.id());
    for pid in family {
        let pages = std::fs::read_to_string(format!("/proc/{pid}/statm")).unwrap_or_default();
        let pages = pages
            .split(' ')
            .nth(1)
            .and_then(|pages| pages.parse::<u64>().ok());
        sums[0] += pages.unwrap_or(0) * rustix::param::page_size() as u64;
        let open = std::fs::read_dir(format!("/proc/{pid}/fd"))
            .into_iter()
            .flatten();
        sums[1] += open.count() as u64;
    }
    let sizes = shared_memory_of(id);
    let size = |name: &String| std::fs::metadata(format!("/dev/shm/{name}")).map_or(0, |f| f.len());
    sums[2] = sizes.iter().map(size).sum();
    sums
}
