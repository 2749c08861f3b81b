//! What every role's process does around its work: signals, and an end when its launcher ends.

use std::path::Path;
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use anyhow::Context;
use config::Config;
use durable::Output;
use rustix::process::{Pid, Signal, getppid, set_parent_process_death_signal};
use signal_hook::consts::{SIGINT, SIGTERM};

use crate::interrupts::{self, Interrupts};
use crate::output;

/// Set for children by the launcher: its process id.
pub(crate) const LAUNCHER: &str = "FORMICA_LAUNCHER";
/// From the wish to stop to the end of a process that does not heed it.
const GRACE: Duration = Duration::from_secs(3);

/// Runs a role; `stop` is set by SIGINT, SIGTERM and the launcher's death. One that was not
/// `launched` has no launcher, whatever its environment says.
pub(crate) fn run(
    launched: bool,
    work: impl FnOnce(&Arc<AtomicBool>) -> anyhow::Result<()>,
) -> anyhow::Result<ExitCode> {
    let stop = Arc::new(AtomicBool::new(false));
    let launcher = launched.then(|| std::env::var(LAUNCHER).ok()).flatten();
    let launcher = launcher.and_then(|pid| Pid::from_raw(pid.parse().ok()?));
    let signals = match launcher {
        // Its launcher speaks by them.
        Some(_) => vec![SIGINT, SIGTERM],
        None => interrupts::heeded(&[SIGINT, SIGTERM]),
    };
    for signal in signals {
        signal_hook::flag::register(signal, Arc::clone(&stop))?;
    }
    if launcher.is_some() {
        output::keep_log();
    }
    // Else it is known by the name of the link that it was started by.
    let _ = rustix::thread::set_name(c"formica");
    // The kernel's word comes at once but only from the launcher's own thread; looking is slower
    // and misses nothing, a launcher that was gone before this line included.
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

/// Makes the data set of a config; an exit code when a signal stopped that.
pub(crate) fn collect(
    config: &Config,
    output: &Output,
    interrupts: &Interrupts,
) -> anyhow::Result<Option<ExitCode>> {
    let start = Instant::now();
    let mut last = Instant::now();
    let stopped = || interrupts.count() > 0;
    let collected = actor::collect::collect(config, output, &stopped, |done, total| {
        if last.elapsed() > Duration::from_secs(2) {
            last = Instant::now();
            say!("collect: {done} of {total} transitions");
        }
    })?;
    let Some(collected) = collected else {
        say!("collect: stopped; no data set was written");
        return Ok(Some(ExitCode::from(Interrupts::EXIT)));
    };
    say!(
        "collect: {collected} in {:.0} s",
        start.elapsed().as_secs_f64()
    );
    Ok(None)
}

/// Walks a maze with a perfect planner.
pub(crate) fn ceiling(
    config: &Config,
    episodes: usize,
    walker: Option<&Path>,
) -> anyhow::Result<()> {
    let result = actor::ceiling::measure(config, episodes, walker)?;
    say!("{result}");
    Ok(())
}
