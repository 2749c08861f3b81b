//! Support of the whole-process tests: the built binary, run in a folder of its own.

use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::sync::Once;
use std::time::{Duration, Instant};

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
#[allow(clippy::expect_used)]
pub fn shared_memory(run: &Path) -> Vec<String> {
    let id = std::fs::read_to_string(run.join("domain")).expect("a run notes its domain");
    assert!(!id.is_empty(), "a domain has a name");
    let entries = std::fs::read_dir("/dev/shm")
        .into_iter()
        .flatten()
        .flatten();
    let names = entries.filter_map(|entry| entry.file_name().into_string().ok());
    names.filter(|name| name.contains(&id)).collect()
}
