//! All that formica prints. Nothing else writes to standard output or standard error, but for the
//! live view and its terminal.
//!
//! No output that cannot be written is a reason to panic, or to stop working:
//!
//! - A reader that is gone (`| head -1`) is no fault. The command does its work, and ends with the
//!   exit code of that.
//! - What cannot be written for another reason, a full disk for one, is told on standard error, and
//!   makes exit code 1 of a command that is there to print.
//! - `launch` and `collect` write by a [queue](Queue), so that a reader that takes nothing holds
//!   nothing up, and end with the exit code of their work in any case.
//!
//! Crates below say what is odd by the `log` crate; [`remarks`] has it written here.

mod queue;
mod remarks;
mod stream;

use std::fmt::Arguments;
use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use queue::Queue;
use stream::Stream;

pub(crate) use remarks::{keep_log, listen};

/// Without a line written for so long, the end does not wait for a reader any more.
const PATIENCE: Duration = Duration::from_secs(2);

static QUEUE: Queue = Queue::new();
/// Whether the queue is in use.
static QUEUED: AtomicBool = AtomicBool::new(false);

/// Prints a line on standard output.
macro_rules! say {
    ($($part:tt)*) => {
        $crate::output::line(format_args!($($part)*))
    };
}
/// Prints a line; see [`say!`].
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

/// Notes that standard output was written by other means, and could not be.
pub(crate) fn fail(error: &std::io::Error) {
    stream::fail(error);
}

/// From now on all is written by a thread of its own: a reader that takes nothing holds nothing up.
pub(crate) fn detach() {
    if QUEUED.load(Ordering::Acquire) {
        return;
    }
    let writer = std::thread::Builder::new().name("output".to_owned());
    let started = writer.spawn(|| QUEUE.work(Stream::write));
    // Without a thread it is written as before.
    QUEUED.store(started.is_ok(), Ordering::Release);
}

/// Waits until all is written, as long as somebody reads.
pub(crate) fn flush() {
    if QUEUED.load(Ordering::Acquire) {
        QUEUE.flush(PATIENCE);
    }
}

/// Writes what is left; the exit code of a command whose work came to `code`.
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
