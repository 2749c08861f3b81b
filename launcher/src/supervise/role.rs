//! Runs a role in its process: handles signals, and ends when the launcher ends.

use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use anyhow::Context;
use rustix::process::{Pid, Signal, getppid, set_parent_process_death_signal};
use signal_hook::consts::{SIGINT, SIGTERM};

use crate::interrupts;
use crate::output;

/// Environment variable with the process id of the launcher.
pub(crate) const LAUNCHER: &str = "FORMICA_LAUNCHER";
/// Maximum time from a request to stop to the end of the process.
const GRACE: Duration = Duration::from_secs(3);

/// Runs a role. `stop` is set by SIGINT, SIGTERM and the end of the launcher. A process that was not
/// `launched` ignores the environment variable.
pub(crate) fn run(
    launched: bool,
    work: impl FnOnce(&Arc<AtomicBool>) -> anyhow::Result<()>,
) -> anyhow::Result<ExitCode> {
    let stop = Arc::new(AtomicBool::new(false));
    let launcher = launched.then(|| std::env::var(LAUNCHER).ok()).flatten();
    let launcher = launcher.and_then(|pid| Pid::from_raw(pid.parse().ok()?));
    let signals = match launcher {
        // The launcher sends these.
        Some(_) => vec![SIGINT, SIGTERM],
        None => interrupts::not_ignored(&[SIGINT, SIGTERM]),
    };
    for signal in signals {
        signal_hook::flag::register(signal, Arc::clone(&stop))?;
    }
    if launcher.is_some() {
        output::stamp_log();
    }
    // Without this its name is that of /proc/self/exe.
    let _ = rustix::thread::set_name(c"formica");
    // The signal of the kernel is fast, but only follows the launcher's main thread. Polling the parent is
    // slower and misses nothing, including a launcher that ended before this line.
    let _ = set_parent_process_death_signal(launcher.map(|_| Signal::TERM));
    let watched = Arc::clone(&stop);
    let watcher = std::thread::Builder::new().spawn(move || {
        let mut stopping: Option<Instant> = None;
        loop {
            if launcher.is_some() && getppid() != launcher {
                watched.store(true, Ordering::Relaxed);
            }
            let asked = watched.load(Ordering::Relaxed);
            if asked && stopping.get_or_insert_with(Instant::now).elapsed() > GRACE {
                log::error!("did not end within {GRACE:?} of being asked to");
                output::flush();
                std::process::exit(1);
            }
            std::thread::sleep(Duration::from_millis(250));
        }
    });
    watcher.context("starting a thread")?;
    work(&stop)?;
    Ok(ExitCode::SUCCESS)
}
