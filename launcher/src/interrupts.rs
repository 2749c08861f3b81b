//! Ctrl-C and its kin, for the commands that people start themselves.

use std::io;
use std::os::raw::c_int;
use std::sync::Arc;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM, SIGTSTP, SIGXFSZ};
use signal_hook::iterator::Signals;

/// Counts SIGINT, SIGTERM and SIGHUP: the first asks for an end, a second one for haste.
pub(crate) struct Interrupts(Arc<AtomicUsize>);

impl Interrupts {
    /// Listens from now on; the process no longer ends by these signals alone.
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

    /// Signals so far.
    pub(crate) fn count(&self) -> usize {
        self.0.load(Ordering::Relaxed)
    }
}

/// Notes Ctrl-Z, which then stops the process no more by itself.
pub(crate) struct Stops(Arc<AtomicBool>);

impl Stops {
    /// Listens from now on.
    pub(crate) fn listen() -> io::Result<Self> {
        let asked = Arc::new(AtomicBool::new(false));
        for signal in not_ignored(&[SIGTSTP]) {
            signal_hook::flag::register(signal, Arc::clone(&asked))?;
        }
        Ok(Self(asked))
    }

    /// Whether the process was asked to stop since the last call.
    pub(crate) fn take(&self) -> bool {
        self.0.swap(false, Ordering::Relaxed)
    }

    /// Stops this process; returns when it is continued.
    pub(crate) fn stop() {
        let _ = signal_hook::low_level::emulate_default_handler(SIGTSTP);
    }
}

/// Makes writing beyond `ulimit -f` an error, as on a full disk. By default the signal ends the process.
pub(crate) fn outlive_small_files() -> io::Result<()> {
    let unread = Arc::new(AtomicBool::new(false));
    signal_hook::flag::register(SIGXFSZ, unread).map(|_| ())
}

/// Those of the signals that were not ignored when the process began. Whoever had them ignored,
/// `nohup` or a shell that starts a job in the background, wants it to stay like that.
pub(crate) fn not_ignored(signals: &[c_int]) -> Vec<c_int> {
    // Once: which signals are ignored is asked of before and after handlers are there.
    static IGNORED: OnceLock<u64> = OnceLock::new();
    let ignored = *IGNORED.get_or_init(|| {
        let status = std::fs::read_to_string("/proc/self/status");
        status.map_or(0, |status| ignored(&status))
    });
    let is_kept = |signal: &c_int| ignored & (1 << (signal - 1)) == 0;
    signals.iter().copied().filter(is_kept).collect()
}

/// A bit for each signal that is ignored, the first for signal 1, by a process's `status`.
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
        // Rust's runtime ignores SIGPIPE in every program.
        let pipe = signal_hook::consts::SIGPIPE;
        assert_eq!(not_ignored(&[pipe, SIGTERM]), [SIGTERM]);
    }
}
