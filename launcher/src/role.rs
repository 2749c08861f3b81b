//! What every role's process does around its work: signals, and an end when its launcher ends.

use std::path::Path;
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use config::Config;
use durable::Output;
use rustix::process::{Pid, Signal, getppid, set_parent_process_death_signal};

use crate::interrupts::Interrupts;

/// Set for children by the launcher: its process id.
pub(crate) const LAUNCHER: &str = "FORMICA_LAUNCHER";
/// From the wish to stop to the end of a process that does not heed it.
const GRACE: Duration = Duration::from_secs(3);

/// Runs a role; `stop` is set by SIGINT, SIGTERM and the launcher's death.
pub(crate) fn run(
    work: impl FnOnce(&Arc<AtomicBool>) -> anyhow::Result<()>,
) -> anyhow::Result<ExitCode> {
    let stop = Arc::new(AtomicBool::new(false));
    for signal in [signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM] {
        signal_hook::flag::register(signal, Arc::clone(&stop))?;
    }
    let launcher = std::env::var(LAUNCHER)
        .ok()
        .and_then(|pid| Pid::from_raw(pid.parse().ok()?));
    // The kernel's word comes at once but only from the launcher's own thread; looking is slower
    // and misses nothing, a launcher that was gone before this line included.
    let _ = set_parent_process_death_signal(launcher.map(|_| Signal::TERM));
    let watched = Arc::clone(&stop);
    std::thread::spawn(move || {
        let mut stopping: Option<Instant> = None;
        loop {
            if launcher.is_some() && getppid() != launcher {
                watched.store(true, Ordering::Relaxed);
            }
            let asked = watched.load(Ordering::Relaxed);
            if asked && stopping.get_or_insert_with(Instant::now).elapsed() > GRACE {
                eprintln!("formica: did not end within {GRACE:?} of being asked to");
                std::process::exit(1);
            }
            std::thread::sleep(Duration::from_millis(250));
        }
    });
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
            println!("collect: {done} of {total} transitions");
        }
    })?;
    let Some(collected) = collected else {
        println!("collect: stopped; no data set was written");
        return Ok(Some(ExitCode::from(Interrupts::EXIT)));
    };
    println!(
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
    println!("{result}");
    Ok(())
}
