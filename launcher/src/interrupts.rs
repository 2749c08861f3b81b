//! Ctrl-C and its kin, for the commands that people start themselves.

use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use signal_hook::iterator::Signals;

/// Counts SIGINT, SIGTERM and SIGHUP: the first asks for an end, a second one for haste.
pub(crate) struct Interrupts {
    count: Arc<AtomicUsize>,
    stop: Arc<AtomicBool>,
}

impl Interrupts {
    /// Listens from now on; the process no longer ends by these signals alone.
    pub(crate) fn listen() -> io::Result<Self> {
        let (count, stop) = (
            Arc::new(AtomicUsize::new(0)),
            Arc::new(AtomicBool::new(false)),
        );
        let mut signals = Signals::new([SIGINT, SIGTERM, SIGHUP])?;
        let (counted, stopped) = (Arc::clone(&count), Arc::clone(&stop));
        std::thread::spawn(move || {
            for _ in signals.forever() {
                counted.fetch_add(1, Ordering::Relaxed);
                stopped.store(true, Ordering::Relaxed);
            }
        });
        Ok(Self { count, stop })
    }

    /// Signals so far.
    pub(crate) fn count(&self) -> usize {
        self.count.load(Ordering::Relaxed)
    }

    /// Set by the first signal.
    pub(crate) fn stop(&self) -> &AtomicBool {
        &self.stop
    }
}
