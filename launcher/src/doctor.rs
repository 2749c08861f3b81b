//! What this machine offers, and what dead runs left on it.

use std::process::ExitCode;

/// Clears what dead runs left and says what it found.
pub(crate) fn doctor() -> anyhow::Result<ExitCode> {
    let cores = std::thread::available_parallelism()?;
    println!("cores: {cores}");
    let free = wire::shared_memory_available()? >> 20;
    println!("/dev/shm: {free} MiB free");
    if free < 256 {
        println!("  little; in a container start it with --shm-size=1g");
    }
    let found = wire::leftovers();
    for run in &found {
        let what = format!("{} files, {} MiB", run.files, run.bytes >> 20);
        if run.alive {
            println!("run {}: alive, {what}", run.id);
        } else {
            let done = if wire::clear(run) {
                "cleared"
            } else {
                "alive again"
            };
            println!("run {}: dead, {what}: {done}", run.id);
        }
    }
    if found.is_empty() {
        println!("runs: none, nothing left behind");
    }
    Ok(ExitCode::SUCCESS)
}
