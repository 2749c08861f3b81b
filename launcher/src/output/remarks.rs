//! What all crates say by the `log` crate: in a command, warnings on standard error and the rest
//! on standard output; in a process of a run, lines with time and level for its log.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::SystemTime;

use log::{Level, LevelFilter, Log, Metadata, Record};
use plot::clock::stamp;

use super::put;
use super::stream::Stream;

/// Crates of formica, of which all is told (iceoryx2 has a level of its own); of others, warnings.
const OWN: [&str; 16] = [
    "formica",
    "actor",
    "agents",
    "config",
    "dataset",
    "durable",
    "graph",
    "graph_builder",
    "learner",
    "maze",
    "nets",
    "plot",
    "report",
    "runs",
    "trace",
    "wire",
];

/// Whether what is said is a line of a log.
static STAMPED: AtomicBool = AtomicBool::new(false);

/// Writes what is said.
struct Remarks;

/// Has what is said by the `log` crate written.
pub(crate) fn listen() {
    if log::set_logger(&Remarks).is_ok() {
        // Levels are chosen where it is known whose word it is.
        log::set_max_level(LevelFilter::Trace);
    }
}

/// Has it written for a log from now on, panics too.
pub(crate) fn keep_log() {
    STAMPED.store(true, Ordering::Relaxed);
    std::panic::set_hook(Box::new(|info| log::error!("{info}")));
}

impl Log for Remarks {
    fn enabled(&self, metadata: &Metadata<'_>) -> bool {
        let root = metadata.target().split("::").next().unwrap_or_default();
        metadata.level() <= Level::Warn || OWN.contains(&root)
    }

    fn log(&self, record: &Record<'_>) {
        if !self.enabled(record.metadata()) {
            return;
        }
        let (level, text) = (record.level(), record.args());
        if STAMPED.load(Ordering::Relaxed) {
            let now = stamp(SystemTime::now());
            put(Stream::Err, format!("{now} {level} {text}\n"));
        } else if level <= Level::Warn {
            put(Stream::Err, format!("formica: {text}\n"));
        } else {
            put(Stream::Out, format!("{text}\n"));
        }
    }

    fn flush(&self) {}
}
