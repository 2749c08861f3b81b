//! Ctrl-C and its kin, for the commands that people start themselves.

use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use signal_hook::iterator::Signals;

/// Counts SIGINT, SIGTERM and SIGHUP: the first asks for an end, a second one for haste.
pub(crate) struct Interrupts(Arc<AtomicUsize>);

impl Interrupts {
    /// Exit code of a command that they ended.
    pub(crate) const EXIT: u8 = 130;

    /// Listens from now on; the process no longer ends by these signals alone.
    pub(crate) fn listen() -> io::Result<Self> {
        let count = Arc::new(AtomicUsize::new(0));
        let counted = Arc::clone(&count);
        let mut signals = Signals::new([SIGINT, SIGTERM, SIGHUP])?;
        std::thread::spawn(move || {
            for _ in signals.forever() {
                counted.fetch_add(1, Ordering::Relaxed);
            }
        });
        Ok(Self(count))
    }

    /// Signals so far.
    pub(crate) fn count(&self) -> usize {
        self.0.load(Ordering::Relaxed)
    }
}
