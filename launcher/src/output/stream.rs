//! Writes to standard output and standard error without panics.

use std::io;
use std::os::fd::BorrowedFd;
use std::sync::{Mutex, MutexGuard, PoisonError};

use rustix::event::{PollFd, PollFlags, poll};
use rustix::io::Errno;
use rustix::stdio::{stderr, stdout};

/// A standard stream.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Stream {
    Out,
    Err,
}

/// The first failure to write standard output.
static FAILURE: Mutex<Option<Errno>> = Mutex::new(None);

fn first() -> MutexGuard<'static, Option<Errno>> {
    FAILURE.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The failure to write standard output; `None` if there was none, or if the reader closed it.
pub(super) fn failure() -> Option<io::Error> {
    let failure = *first();
    let failure = failure.filter(|errno| *errno != Errno::PIPE);
    failure.map(io::Error::from)
}

/// Records a failure to write standard output.
pub(super) fn record_failure(error: &io::Error) {
    let errno = Errno::from_io_error(error).unwrap_or(Errno::IO);
    first().get_or_insert(errno);
}

impl Stream {
    /// Writes a text, or records the failure. Failures of standard error are ignored.
    pub(super) fn write(self, text: &str) {
        match self {
            Self::Err => drop(write_all(stderr(), text.as_bytes())),
            Self::Out if *first() == Some(Errno::PIPE) => {}
            Self::Out => {
                if let Err(errno) = write_all(stdout(), text.as_bytes()) {
                    first().get_or_insert(errno);
                }
            }
        }
    }
}

fn write_all(to: BorrowedFd<'_>, mut bytes: &[u8]) -> Result<(), Errno> {
    while !bytes.is_empty() {
        match rustix::io::write(to, bytes) {
            Ok(0) => return Err(Errno::NOSPC),
            Ok(n) => bytes = &bytes[n..],
            Err(Errno::INTR) => {}
            // Another process made the pipe non-blocking.
            Err(Errno::AGAIN) => match poll(&mut [PollFd::new(&to, PollFlags::OUT)], None) {
                Ok(_) | Err(Errno::INTR) => {}
                Err(errno) => return Err(errno),
            },
            Err(errno) => return Err(errno),
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use std::io::Read;
    use std::os::fd::AsFd;

    use super::*;

    #[test]
    fn a_non_blocking_pipe_gets_all() {
        let (reader, writer) = rustix::pipe::pipe().unwrap();
        rustix::fs::fcntl_setfl(&writer, rustix::fs::OFlags::NONBLOCK).unwrap();
        let text = "0123456789".repeat(50_000);
        let sent = text.clone();
        let writing = std::thread::spawn(move || write_all(writer.as_fd(), sent.as_bytes()));
        let mut got = String::new();
        std::fs::File::from(reader)
            .read_to_string(&mut got)
            .unwrap();
        assert_eq!(writing.join().unwrap(), Ok(()));
        assert!(got == text, "{} bytes", got.len());
    }

    #[test]
    fn a_closed_pipe_and_a_full_disk_are_errors() {
        let (reader, writer) = rustix::pipe::pipe().unwrap();
        drop(reader);
        assert_eq!(write_all(writer.as_fd(), b"a"), Err(Errno::PIPE));
        if let Ok(full) = std::fs::OpenOptions::new().write(true).open("/dev/full") {
            assert_eq!(write_all(full.as_fd(), b"a"), Err(Errno::NOSPC));
        }
    }
}
