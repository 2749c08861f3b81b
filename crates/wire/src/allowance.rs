//! What the system lets a process have, held against what a run's channels need of it.

use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};

use crate::WireError;
use crate::limits::Limits;

/// A limit of the system, as a shell names it.
struct Allowance {
    resource: Resource,
    what: &'static str,
    /// Letter of `ulimit`.
    letter: char,
    /// What one of its units is (of the resource's own).
    unit: u64,
    /// Where else it is set.
    elsewhere: &'static str,
}

const OPEN_FILES: Allowance = Allowance {
    resource: Resource::Nofile,
    what: "open files",
    letter: 'n',
    unit: 1,
    elsewhere: "systemd by LimitNOFILE, docker by --ulimit nofile=4096",
};
const FILE_SIZE: Allowance = Allowance {
    resource: Resource::Fsize,
    what: "KiB in a file",
    letter: 'f',
    unit: 1024,
    elsewhere: "systemd by LimitFSIZE, docker by --ulimit fsize=-1",
};
const ADDRESS_SPACE: Allowance = Allowance {
    resource: Resource::As,
    what: "KiB of address space",
    letter: 'v',
    unit: 1024,
    elsewhere: "systemd by LimitAS, docker by --ulimit as=-1",
};

impl Limits {
    /// Makes sure that this process may have what the run's channels can come to need: soft limits
    /// are raised where the hard ones let it. Processes that it starts have the same.
    ///
    /// # Errors
    /// [`WireError::Limited`] with the limit that is too low, and how it is raised.
    pub fn allow(&self) -> Result<(), WireError> {
        OPEN_FILES.raise(self.open_files())?;
        ADDRESS_SPACE.raise(self.address_space())
    }

    /// The same for the files in shared memory that channels are made of.
    ///
    /// # Errors
    /// As of [`allow`](Self::allow).
    pub fn allow_segments(&self) -> Result<(), WireError> {
        FILE_SIZE.raise(self.largest_segment())
    }
}

impl Allowance {
    fn raise(&self, needed: u64) -> Result<(), WireError> {
        let Rlimit { current, maximum } = getrlimit(self.resource);
        if current.is_none_or(|soft| soft >= needed) {
            return Ok(());
        }
        let raised = Rlimit {
            current: Some(needed),
            maximum,
        };
        let allowed = maximum.is_none_or(|hard| hard >= needed);
        if allowed && setrlimit(self.resource, raised).is_ok() {
            return Ok(());
        }
        Err(WireError::Limited {
            what: self.what,
            letter: self.letter,
            limit: maximum.or(current).unwrap_or(0) / self.unit,
            needed: needed.div_ceil(self.unit),
            elsewhere: self.elsewhere,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::limits::tests::limits;

    #[test]
    fn a_soft_limit_is_raised_and_a_hard_one_is_named() {
        // Of this test's process: of all its threads, so only of a limit that nothing else needs.
        let locked = Allowance {
            resource: Resource::Core,
            what: "bytes of a core",
            letter: 'c',
            unit: 1,
            elsewhere: "nowhere",
        };
        let limit = |current, maximum| Rlimit {
            current: Some(current),
            maximum: Some(maximum),
        };
        setrlimit(Resource::Core, limit(0, 4096)).unwrap();
        locked.raise(4000).unwrap();
        assert_eq!(getrlimit(Resource::Core), limit(4000, 4096));
        locked.raise(100).unwrap();
        assert_eq!(getrlimit(Resource::Core), limit(4000, 4096));
        let told = locked.raise(5000).unwrap_err().to_string();
        assert!(told.contains("4096") && told.contains("5000"), "{told}");
    }

    #[test]
    fn what_is_needed_grows_with_the_places_for_actors() {
        let (few, mut many) = (limits(), limits());
        many.max_actors = 64;
        assert!(many.open_files() > few.open_files());
        assert!(many.largest_segment() >= few.largest_segment());
        assert!(few.open_files() > 64, "what made InternalFailure");
    }
}
