//! Writes messages of the `log` crate. In a command, warnings go to standard error and the rest to standard
//! output; in a process of a run, all are lines of its log, with time and level.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::SystemTime;

use log::{Level, LevelFilter, Log, Metadata, Record};
use plot::clock::stamp;

use super::put;
use super::stream::Stream;

/// Crates of formica, whose messages are all written. From other crates only warnings are (iceoryx2 has its own
/// level).
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

/// Whether messages are lines of a log.
static STAMPED: AtomicBool = AtomicBool::new(false);

/// Writes messages.
struct Logger;

/// Writes messages of the `log` crate from now on.
pub(crate) fn init_log() {
    if log::set_logger(&Logger).is_ok() {
        // `enabled` decides by the crate.
        log::set_max_level(LevelFilter::Trace);
    }
}

/// Writes messages and panics as lines of a log from now on.
pub(crate) fn stamp_log() {
    STAMPED.store(true, Ordering::Relaxed);
    std::panic::set_hook(Box::new(|info| log::error!("{info}")));
}

impl Log for Logger {
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
