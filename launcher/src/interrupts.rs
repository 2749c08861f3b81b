//! Signals of commands that are started in a terminal.

use std::io;
use std::os::raw::c_int;
use std::sync::Arc;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM, SIGTSTP, SIGXFSZ};
use signal_hook::iterator::Signals;

/// Counts SIGINT, SIGTERM and SIGHUP. The first one requests an end, the second one an end at once.
pub(crate) struct Interrupts(Arc<AtomicUsize>);

impl Interrupts {
    /// Handles these signals from now on, so that they do not end the process.
    pub(crate) fn listen() -> io::Result<Self> {
        let count = Arc::new(AtomicUsize::new(0));
        let counted = Arc::clone(&count);
        let mut signals = Signals::new(not_ignored(&[SIGINT, SIGTERM, SIGHUP]))?;
        std::thread::Builder::new()
            .name("signals".to_owned())
            .spawn(move || {
                for _ in signals.forever() {
                    counted.fetch_add(1, Ordering::Relaxed);
                }
            })?;
        Ok(Self(count))
    }

    /// Number of signals so far.
    pub(crate) fn count(&self) -> usize {
        self.0.load(Ordering::Relaxed)
    }
}

/// Handles Ctrl-Z, so that it does not stop the process directly.
pub(crate) struct Stops(Arc<AtomicBool>);

impl Stops {
    /// Handles Ctrl-Z from now on.
    pub(crate) fn listen() -> io::Result<Self> {
        let asked = Arc::new(AtomicBool::new(false));
        for signal in not_ignored(&[SIGTSTP]) {
            signal_hook::flag::register(signal, Arc::clone(&asked))?;
        }
        Ok(Self(asked))
    }

    /// Whether Ctrl-Z was pressed since the last call.
    pub(crate) fn take(&self) -> bool {
        self.0.swap(false, Ordering::Relaxed)
    }

    /// Stops this process until it is continued.
    pub(crate) fn stop() {
        let _ = signal_hook::low_level::emulate_default_handler(SIGTSTP);
    }
}

/// Makes writing beyond `ulimit -f` an error, as on a full disk. By default the signal ends the process.
pub(crate) fn outlive_small_files() -> io::Result<()> {
    let unread = Arc::new(AtomicBool::new(false));
    signal_hook::flag::register(SIGXFSZ, unread).map(|_| ())
}

/// The signals that were not ignored when the process started. Signals that `nohup` or a shell ignores for a
/// background job stay ignored.
pub(crate) fn not_ignored(signals: &[c_int]) -> Vec<c_int> {
    // Read once, since handlers change it.
    static IGNORED: OnceLock<u64> = OnceLock::new();
    let ignored = *IGNORED.get_or_init(|| {
        let status = std::fs::read_to_string("/proc/self/status");
        status.map_or(0, |status| ignored(&status))
    });
    let is_kept = |signal: &c_int| ignored & (1 << (signal - 1)) == 0;
    signals.iter().copied().filter(is_kept).collect()
}

/// A bit for each ignored signal, the lowest for signal 1, from the `status` of a process.
fn ignored(status: &str) -> u64 {
    let mut lines = status.lines();
    let mask = lines.find_map(|line| line.strip_prefix("SigIgn:"));
    mask.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok())
        .unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ignored_signals_are_read_from_the_status() {
        let hangup = "Name:\tformica\nSigBlk:\t0000000000000002\nSigIgn:\t0000000000001001\n";
        assert_eq!(ignored(hangup), 0x1001);
        assert_eq!(ignored("Name:\tformica\n"), 0);
        assert_eq!(ignored("SigIgn:\tzz\n"), 0);
        // The Rust runtime ignores SIGPIPE.
        let pipe = signal_hook::consts::SIGPIPE;
        assert_eq!(not_ignored(&[pipe, SIGTERM]), [SIGTERM]);
    }
}
