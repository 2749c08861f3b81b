//! Terminal modes of the view, which are restored in any case.
//!
//! Keys such as Ctrl-C still raise signals. Only echo and line buffering are switched off.

use std::fs::File;
use std::io::{self, IsTerminal};
use std::os::fd::OwnedFd;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, MutexGuard, Once, PoisonError, TryLockError};
use std::time::{Duration, Instant};

use rustix::process::getpgrp;
use rustix::stdio::{dup2_stderr, stderr, stdin, stdout};
use rustix::termios::{
    InputModes, LocalModes, OptionalActions, QueueSelector, SpecialCodeIndex, Termios, tcflush,
    tcgetattr, tcgetpgrp, tcgetwinsize, tcsetattr,
};
use signal_hook::consts::{SIGCONT, SIGINT, SIGQUIT};
use signal_hook::iterator::Signals;
use signal_hook::low_level;

use crate::interrupts::{Stops, not_ignored};

/// Switches to the alternate screen and hides the cursor.
const ENTER: &[u8] = b"\x1b[?1049h\x1b[?25l";
/// Ends a partial frame, and restores text style, cursor and main screen.
const LEAVE: &[u8] = b"\x1b[?2026l\x1b[0m\x1b[?25h\x1b[?1049l";
/// If a frame takes longer to write, the terminal is blocked.
const STUCK: Duration = Duration::from_millis(300);

/// The original state of the terminal, while the view is shown.
static SAVED: Mutex<Option<Saved>> = Mutex::new(None);
/// Held during a write.
static WRITING: Mutex<()> = Mutex::new(());
/// Ctrl-Z or Ctrl-\ is about to stop or end the process.
static SUSPENDED: AtomicBool = AtomicBool::new(false);
/// The process was continued. Others may have used the terminal meanwhile.
static CONTINUED: AtomicBool = AtomicBool::new(false);
/// The view is closed for good.
static CLOSED: AtomicBool = AtomicBool::new(false);

struct Saved {
    modes: Termios,
    /// Standard error, which goes to a file meanwhile; `None` if it is not a terminal.
    stderr: Option<OwnedFd>,
}

/// Whether there is a terminal that can show the view.
pub(crate) fn is_fit() -> bool {
    let dumb = std::env::var_os("TERM").is_none_or(|term| term.is_empty() || term == "dumb");
    // A build server shows a log, even if it claims to be a terminal.
    let server = std::env::var_os("CI").is_some_and(|word| !word.is_empty() && word != "false");
    let terminal = io::stdin().is_terminal() && io::stdout().is_terminal();
    !dumb && !server && terminal && is_foreground()
}

/// Whether colours are allowed (<https://no-color.org>).
pub(crate) fn has_colour() -> bool {
    std::env::var_os("NO_COLOR").is_none_or(|word| word.is_empty())
}

/// Whether this process is in the foreground of the terminal.
fn is_foreground() -> bool {
    // Without job control there is no other foreground process.
    tcgetpgrp(stdin()).is_ok_and(|group| group == getpgrp()) || tcgetpgrp(stdin()).is_err()
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Makes panics and Ctrl-\ restore the terminal first.
pub(crate) fn guard() -> io::Result<()> {
    static ONCE: Once = Once::new();
    let mut result = Ok(());
    ONCE.call_once(|| {
        let hook = std::panic::take_hook();
        std::panic::set_hook(Box::new(move |info| {
            close();
            hook(info);
        }));
        result = listen();
    });
    result
}

fn listen() -> io::Result<()> {
    let mut signals = Signals::new(not_ignored(&[SIGCONT, SIGQUIT]))?;
    std::thread::spawn(move || {
        for signal in signals.forever() {
            if signal == SIGCONT {
                CONTINUED.store(true, Ordering::SeqCst);
                continue;
            }
            SUSPENDED.store(true, Ordering::SeqCst);
            restore();
            let _ = low_level::emulate_default_handler(signal);
        }
    });
    Ok(())
}

/// Restores the terminal and stops this process until it is continued.
pub(crate) fn stop() {
    SUSPENDED.store(true, Ordering::SeqCst);
    restore();
    Stops::stop();
    SUSPENDED.store(false, Ordering::SeqCst);
}

/// Takes the terminal; `None` if it is not available now. Meanwhile standard error goes to `log`.
pub(crate) fn take(log: &File) -> io::Result<Option<Taken>> {
    let writing = lock(&WRITING);
    let away = || SUSPENDED.load(Ordering::SeqCst) || CLOSED.load(Ordering::SeqCst);
    let mut saved = lock(&SAVED);
    if away() || !is_foreground() {
        return Ok(None);
    }
    // After SIGSTOP the terminal was not restored.
    let lost = CONTINUED.swap(false, Ordering::SeqCst);
    if let Some(saved) = saved.take_if(|_| lost) {
        if let Some(stderr) = saved.stderr {
            dup2_stderr(stderr)?;
        }
        tcsetattr(stdin(), OptionalActions::Now, &saved.modes)?;
    }
    let anew = saved.is_none();
    if anew {
        let modes = tcgetattr(stdin())?;
        let mut own = modes.clone();
        own.local_modes
            .remove(LocalModes::ICANON | LocalModes::ECHO);
        // Ctrl-S must not block writes.
        own.input_modes.remove(InputModes::IXON);
        own.special_codes[SpecialCodeIndex::VMIN] = 0;
        own.special_codes[SpecialCodeIndex::VTIME] = 0;
        let other = io::stderr().is_terminal();
        let kept = other.then(|| rustix::io::fcntl_dupfd_cloexec(stderr(), 3));
        *saved = Some(Saved {
            modes,
            stderr: kept.transpose()?,
        });
        tcsetattr(stdin(), OptionalActions::Now, &own)?;
        if other {
            dup2_stderr(log)?;
        }
        write_all(ENTER)?;
    }
    Ok(Some(Taken {
        anew,
        _writing: writing,
    }))
}

/// The terminal, held for writing.
pub(crate) struct Taken {
    /// Whether the screen has no frame yet.
    pub(crate) anew: bool,
    _writing: MutexGuard<'static, ()>,
}

impl Taken {
    /// Columns and rows.
    pub(crate) fn size(&self) -> io::Result<(u16, u16)> {
        let size = tcgetwinsize(stdout())?;
        Ok(match (size.ws_col, size.ws_row) {
            // Unknown.
            (0, _) | (_, 0) => (80, 24),
            known => known,
        })
    }

    pub(crate) fn write(&mut self, bytes: &[u8]) -> io::Result<()> {
        write_all(bytes)
    }

    /// Handles pressed keys: q is Ctrl-C.
    pub(crate) fn handle_keys(&mut self) {
        let mut keys = [0_u8; 64];
        let n = rustix::io::read(stdin(), &mut keys).unwrap_or(0);
        // Special keys send an escape and letters.
        if keys[..n].contains(&b'q') && !keys[..n].contains(&b'\x1b') {
            let _ = low_level::raise(SIGINT);
        }
    }
}

/// Restores the terminal for good. If it is blocked, its screen stays as it is.
pub(crate) fn close() {
    CLOSED.store(true, Ordering::SeqCst);
    restore();
}

fn restore() {
    let writing = lock_within(&WRITING);
    let Some(saved) = lock(&SAVED).take() else {
        return;
    };
    if let Some(stderr) = saved.stderr {
        let _ = dup2_stderr(stderr);
    }
    if !is_foreground() {
        return;
    }
    // Drops keys that were typed meanwhile.
    let _ = tcflush(stdin(), QueueSelector::IFlush);
    let _ = tcsetattr(stdin(), OptionalActions::Now, &saved.modes);
    if writing.is_some() {
        let _ = write_all(LEAVE);
    }
}

/// Locks a mutex; `None` if that takes too long.
fn lock_within(mutex: &'static Mutex<()>) -> Option<MutexGuard<'static, ()>> {
    let start = Instant::now();
    loop {
        match mutex.try_lock() {
            Ok(guard) => return Some(guard),
            Err(TryLockError::Poisoned(poisoned)) => return Some(poisoned.into_inner()),
            Err(TryLockError::WouldBlock) if start.elapsed() > STUCK => return None,
            Err(TryLockError::WouldBlock) => std::thread::sleep(Duration::from_millis(5)),
        }
    }
}

fn write_all(mut bytes: &[u8]) -> io::Result<()> {
    while !bytes.is_empty() {
        match rustix::io::write(stdout(), bytes) {
            Ok(0) => return Err(io::ErrorKind::WriteZero.into()),
            Ok(n) => bytes = &bytes[n..],
            Err(rustix::io::Errno::INTR) => {}
            Err(error) => return Err(error.into()),
        }
    }
    Ok(())
}
