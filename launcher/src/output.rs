//! Standard output and standard error. Only this module and the live view write to them.
//!
//! A failure to write neither panics nor stops the work:
//!
//! - A closed pipe (`| head -1`) is not an error. The command completes its work, with the same exit code.
//! - Other failures, such as a full disk, are reported on standard error. The exit code of a command that prints
//!   is then 1.
//! - `launch` and `collect` write through a [queue](Queue), so that a blocked reader does not block them. Their
//!   exit code does not depend on the output.
//!
//! Other crates use the `log` crate, whose messages [`logger`] writes here.

mod logger;
mod queue;
mod stream;

use std::fmt::Arguments;
use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use queue::Queue;
use stream::Stream;

pub(crate) use logger::{init_log, stamp_log};

/// Maximum wait for a blocked reader at the end.
const PATIENCE: Duration = Duration::from_secs(2);

static QUEUE: Queue = Queue::new();
/// Whether the queue is in use.
static QUEUED: AtomicBool = AtomicBool::new(false);

/// Prints a line on standard output.
macro_rules! outln {
    ($($part:tt)*) => {
        $crate::output::line(format_args!($($part)*))
    };
}
/// Prints a line; see [`outln!`].
pub(crate) fn line(text: Arguments<'_>) {
    put(Stream::Out, format!("{text}\n"));
}

/// Prints a text as it is.
pub(crate) fn text(text: String) {
    put(Stream::Out, text);
}

fn put(stream: Stream, text: String) {
    if QUEUED.load(Ordering::Acquire) {
        QUEUE.put(stream, text);
    } else {
        stream.write(&text);
    }
}

/// Records a failure to write standard output by other means.
pub(crate) fn record_failure(error: &std::io::Error) {
    stream::record_failure(error);
}

/// From now on a thread writes the output, so that a blocked reader does not block this one.
pub(crate) fn detach() {
    if QUEUED.load(Ordering::Acquire) {
        return;
    }
    let writer = std::thread::Builder::new().name("output".to_owned());
    let started = writer.spawn(|| QUEUE.work(Stream::write));
    // Without a thread, output is written directly.
    QUEUED.store(started.is_ok(), Ordering::Release);
}

/// Waits until all is written, unless the reader is blocked.
pub(crate) fn flush() {
    if QUEUED.load(Ordering::Acquire) {
        QUEUE.flush(PATIENCE);
    }
}

/// Writes what is left, and returns the exit code of a command whose work ended with `code`.
pub(crate) fn end(code: ExitCode) -> ExitCode {
    flush();
    let Some(error) = stream::failure() else {
        return code;
    };
    Stream::Err.write(&format!(
        "formica: standard output cannot be written: {error}\n"
    ));
    match QUEUED.load(Ordering::Acquire) {
        true => code,
        false => ExitCode::FAILURE,
    }
}
