//! Why iceoryx2 may have refused something. Its errors are names such as `InternalFailure`; what is
//! behind them stands in the state of the machine.

use std::fmt::{self, Display};
use std::fs::File;
use std::path::Path;

use rustix::fs::statvfs;
use rustix::io::Errno;
use rustix::process::{Resource, getrlimit};

use crate::WireError;
use crate::domain::SHARED_MEMORY;

/// What iceoryx2 said, and what the machine tells of it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Cause {
    reason: String,
    likely: Option<String>,
}

impl Cause {
    /// Looks at the machine as it is now, just after the refusal; `root` is the folder of the run's
    /// sockets and names, where it is known.
    pub(crate) fn of(reason: String, root: Option<&Path>) -> Self {
        let likely = open_files()
            .or_else(|| root.and_then(gone))
            .or_else(|| full(Path::new(SHARED_MEMORY)))
            .or_else(|| root.and_then(full))
            .or_else(address_space);
        Self { reason, likely }
    }
}

impl WireError {
    /// What iceoryx2 refused of a service, with the likely cause.
    pub(crate) fn service(
        service: &str,
        action: &'static str,
        reason: String,
        root: Option<&Path>,
    ) -> Self {
        Self::Service {
            service: service.to_owned(),
            action,
            cause: Cause::of(reason, root),
        }
    }
}

impl Display for Cause {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { reason, likely } = self;
        match likely {
            Some(likely) => write!(f, "{likely} (iceoryx2 says {reason})"),
            None => write!(
                f,
                "iceoryx2 says {reason}; `formica doctor` looks at this machine"
            ),
        }
    }
}

fn open_files() -> Option<String> {
    let error = File::open("/dev/null").err()?.raw_os_error()?;
    if error == Errno::MFILE.raw_os_error() {
        let limit = getrlimit(Resource::Nofile).current?;
        return Some(format!(
            "this process has all of the {limit} open files that it may have; raise `ulimit -n`"
        ));
    }
    (error == Errno::NFILE.raw_os_error())
        .then(|| "this machine has all of the open files that it may have; see fs.file-max".into())
}

fn gone(root: &Path) -> Option<String> {
    (!root.is_dir()).then(|| format!("'{}' is gone, so the run has ended", root.display()))
}

fn full(place: &Path) -> Option<String> {
    let place = place.to_path_buf();
    let Ok(space) = statvfs(&place) else {
        return Some(format!("'{}' is gone", place.display()));
    };
    if space.f_blocks > 0 && space.f_bavail == 0 {
        return Some(format!("'{}' is full", place.display()));
    }
    (space.f_files > 0 && space.f_favail == 0)
        .then(|| format!("'{}' can hold no more files", place.display()))
}

/// Nothing tells that it is used up, but a limit is rare enough to be worth a word.
fn address_space() -> Option<String> {
    let limit = getrlimit(Resource::As).current?;
    let limit = limit >> 20;
    Some(format!(
        "this process may have {limit} MiB of address space, which may be too little; raise \
         `ulimit -v`"
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_cause_is_told_with_what_iceoryx2_says() {
        let of = |root| Cause::of("InternalFailure".to_owned(), Some(Path::new(root))).to_string();
        assert!(of("/").contains("formica doctor"), "{}", of("/"));
        let told = of("/no/such/folder");
        assert!(
            told.contains("'/no/such/folder' is gone") && told.contains("InternalFailure"),
            "{told}"
        );
    }
}
