//! Lock files. Whoever holds one is alive, wherever the one who looks stands.
//!
//! The lock is `flock`'s: it belongs to the file, not to a process id. A process in another PID,
//! IPC, user or mount namespace sees it wherever it sees the file.

use std::fs::{self, File, Metadata, OpenOptions, Permissions, TryLockError};
use std::io::{self, ErrorKind};
use std::os::unix::fs::{FileTypeExt, MetadataExt, OpenOptionsExt, PermissionsExt};
use std::path::{Path, PathBuf};

use rustix::fs::OFlags;

/// Why it cannot be told whether a domain's run is alive.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum Unseen {
    /// There are files, and no lock file.
    #[error("no lock of it is visible from here")]
    NoLock,
    /// A file of another user.
    #[error("'{}' belongs to the user with number {owner}", .path.display())]
    Foreign {
        /// The file or folder.
        path: PathBuf,
        /// Its user.
        owner: u32,
    },
    /// Something else stands where the lock file or its folder should be.
    #[error("'{}' is {what}", .path.display())]
    Strange {
        /// What stands there.
        path: PathBuf,
        /// What it is, as in "a symbolic link".
        what: &'static str,
    },
    /// The lock file cannot be opened or locked.
    #[error("'{}' cannot be looked at: {reason}", .path.display())]
    Closed {
        /// The file.
        path: PathBuf,
        /// What the system said.
        reason: String,
    },
}

/// What is seen of a lock file.
#[derive(Debug)]
pub(super) enum Sight {
    /// There is no such file.
    Absent,
    /// Somebody holds it.
    Held(File),
    /// Nobody holds it.
    Free,
    /// It cannot be told.
    Unseen(Unseen),
}

/// What something is that should be a file.
pub(super) fn not_a_file(about: &Metadata) -> Option<&'static str> {
    let kind = about.file_type();
    if kind.is_file() {
        None
    } else if kind.is_dir() {
        Some("a folder")
    } else if kind.is_symlink() {
        Some("a symbolic link")
    } else if kind.is_fifo() {
        Some("a pipe")
    } else {
        Some("neither a file nor a folder")
    }
}

/// Opens a lock file of a user; none where there is none. Nothing else is followed or waited for:
/// neither a link nor a pipe.
fn open(path: &Path, user: u32) -> Result<Option<File>, Unseen> {
    let closed = |error: &io::Error| Unseen::Closed {
        path: path.to_path_buf(),
        reason: error.to_string(),
    };
    let about = match fs::symlink_metadata(path) {
        Ok(about) => about,
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(None),
        Err(error) => return Err(closed(&error)),
    };
    if let Some(what) = not_a_file(&about) {
        let path = path.to_path_buf();
        return Err(Unseen::Strange { path, what });
    }
    let flags = OFlags::NOFOLLOW | OFlags::NONBLOCK;
    let opened = OpenOptions::new()
        .read(true)
        .custom_flags(flags.bits().cast_signed())
        .open(path);
    let file = match opened {
        Ok(file) => file,
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(None),
        Err(error) => return Err(closed(&error)),
    };
    let owner = file.metadata().map_err(|error| closed(&error))?.uid();
    if owner != user {
        let path = path.to_path_buf();
        return Err(Unseen::Foreign { path, owner });
    }
    Ok(Some(file))
}

/// Whether somebody holds the lock of a file that is open.
pub(super) fn is_held(file: &File) -> io::Result<bool> {
    match file.try_lock_shared() {
        Ok(()) => file.unlock().map(|()| false),
        Err(TryLockError::WouldBlock) => Ok(true),
        Err(TryLockError::Error(error)) => Err(error),
    }
}

/// Looks at a lock file of a user.
pub(super) fn look(path: &Path, user: u32) -> Sight {
    let file = match open(path, user) {
        Ok(Some(file)) => file,
        Ok(None) => return Sight::Absent,
        Err(unseen) => return Sight::Unseen(unseen),
    };
    match is_held(&file) {
        Ok(true) => Sight::Held(file),
        Ok(false) => Sight::Free,
        Err(error) => Sight::Unseen(Unseen::Closed {
            path: path.to_path_buf(),
            reason: error.to_string(),
        }),
    }
}

/// A lock file that this process holds.
#[derive(Debug)]
pub(super) struct Lock {
    file: File,
    path: PathBuf,
}

impl Lock {
    /// Makes a lock file and holds it.
    ///
    /// Between the two another process may see it free and remove it: what was removed is made
    /// again, so that what is returned is held under its name.
    ///
    /// # Errors
    /// [`ErrorKind::AlreadyExists`] when there is one; what the file system refuses.
    pub(super) fn create(path: &Path) -> io::Result<Self> {
        loop {
            let file = OpenOptions::new()
                .write(true)
                .create_new(true)
                .mode(0o600)
                .open(path)?;
            // Whatever the umask is.
            file.set_permissions(Permissions::from_mode(0o600))?;
            file.lock()?;
            let path = path.to_path_buf();
            let lock = Self { file, path };
            if lock.is_in_place() {
                return Ok(lock);
            }
        }
    }

    /// Holds a lock file that is there; none when somebody else holds it or it is gone.
    ///
    /// # Errors
    /// When it cannot be told.
    pub(super) fn take(path: &Path, user: u32) -> Result<Option<Self>, Unseen> {
        let Some(file) = open(path, user)? else {
            return Ok(None);
        };
        let path = path.to_path_buf();
        match file.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => return Ok(None),
            Err(TryLockError::Error(error)) => {
                let reason = error.to_string();
                return Err(Unseen::Closed { path, reason });
            }
        }
        let lock = Self { file, path };
        Ok(lock.is_in_place().then_some(lock))
    }

    /// Whether the file that is held still has its name: another holder may have removed it, and
    /// somebody made a new one, before this one got the lock.
    fn is_in_place(&self) -> bool {
        let same = |a: &Metadata, b: &Metadata| a.dev() == b.dev() && a.ino() == b.ino();
        match (self.file.metadata(), fs::symlink_metadata(&self.path)) {
            (Ok(held), Ok(named)) => same(&held, &named),
            _ => false,
        }
    }

    /// The file has another name now.
    pub(super) fn moved_to(mut self, path: PathBuf) -> Self {
        self.path = path;
        self
    }

    pub(super) fn path(&self) -> &Path {
        &self.path
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn own() -> u32 {
        rustix::process::getuid().as_raw()
    }

    #[test]
    fn a_held_lock_is_seen_as_held_and_a_dropped_one_as_free() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("lock");
        assert!(matches!(look(&path, own()), Sight::Absent));
        let lock = Lock::create(&path).unwrap();
        assert!(matches!(look(&path, own()), Sight::Held(_)));
        assert!(Lock::take(&path, own()).unwrap().is_none());
        assert_eq!(
            Lock::create(&path).unwrap_err().kind(),
            ErrorKind::AlreadyExists
        );
        drop(lock);
        assert!(matches!(look(&path, own()), Sight::Free));
        assert!(Lock::take(&path, own()).unwrap().is_some());
    }

    #[test]
    fn one_who_locks_a_file_that_was_removed_meanwhile_does_not_hold_it() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("lock");
        drop(Lock::create(&path).unwrap());
        let file = File::open(&path).unwrap();
        fs::remove_file(&path).unwrap();
        let other = Lock::create(&path).unwrap();
        file.try_lock().unwrap();
        let late = Lock { file, path };
        assert!(!late.is_in_place());
        assert!(other.is_in_place());
    }

    #[test]
    fn a_lock_that_is_removed_while_it_is_made_is_made_again() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("lock");
        std::thread::scope(|scope| {
            let clearer = scope.spawn(|| {
                let mut removed = 0;
                while !path.with_extension("end").exists() {
                    if let Ok(Some(lock)) = Lock::take(&path, own()) {
                        fs::remove_file(lock.path()).unwrap();
                        removed += 1;
                    }
                }
                removed
            });
            for _ in 0..2000 {
                let lock = Lock::create(&path).unwrap();
                assert!(lock.is_in_place());
                fs::remove_file(&path).unwrap();
            }
            File::create(path.with_extension("end")).unwrap();
            clearer.join().unwrap();
        });
    }

    #[test]
    fn what_is_no_lock_file_is_neither_free_nor_followed() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("lock");
        let unseen = |path: &Path| match look(path, own()) {
            Sight::Unseen(unseen) => unseen.to_string(),
            sight => panic!("{sight:?}"),
        };
        std::os::unix::fs::symlink("/dev/null", &path).unwrap();
        assert!(unseen(&path).contains("a symbolic link"));
        fs::remove_file(&path).unwrap();
        fs::create_dir(&path).unwrap();
        assert!(unseen(&path).contains("a folder"));
        fs::remove_dir(&path).unwrap();
        // A pipe would keep one who opens it waiting.
        let made = std::process::Command::new("mkfifo").arg(&path).status();
        assert!(made.unwrap().success());
        assert!(unseen(&path).contains("a pipe"));
        fs::remove_file(&path).unwrap();
        drop(Lock::create(&path).unwrap());
        let Sight::Unseen(unseen) = look(&path, own() + 1) else {
            panic!("a file of another user");
        };
        assert!(matches!(unseen, Unseen::Foreign { .. }), "{unseen}");
    }
}
