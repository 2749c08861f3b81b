//! A run's own domain of channels: a folder for sockets and names, a prefix in shared memory.
//! Both are short, since Unix socket names are limited to about 100 bytes.
//!
//! The run's creator holds two locks for as long as the run lives, one in each place: processes
//! may share one of them and not the other (containers, mount namespaces, systemd's PrivateTmp).
//! A domain is made in this order: its folder, locked before it gets its name; its lock in shared
//! memory; all else. It is removed in the opposite order, by one that holds both locks.

mod leftovers;
mod lock;
mod places;

use std::fs::{self, File};
use std::io::ErrorKind;
use std::os::unix::fs::{MetadataExt, PermissionsExt};
use std::path::{Path, PathBuf};

pub use leftovers::{Kept, Leftover, Liveness, clear, clear_unseen, leftovers};
pub use lock::Unseen;
pub use places::{
    SHARED_MEMORY, SOCKETS, shared_memory_available, shared_memory_is_in_memory, sockets_available,
};

use crate::WireError;
use leftovers::View;
use lock::{Lock, Sight};
use places::{Places, UNBORN, is_id};

/// Ids that are tried before a domain is not made: each is taken once in four billion times.
const ATTEMPTS: usize = 100;

/// Why the files in shared memory of a run that is alive may be gone.
const LOGGED_OUT: &str = "; systemd removes a user's shared memory at log-out unless logind.conf has \
                          RemoveIPC=no or the user lingers (`loginctl enable-linger`)";

fn io(path: &Path, reason: std::io::Error) -> WireError {
    WireError::Io {
        path: path.display().to_string(),
        reason,
    }
}

/// A run's domain. The one that created it holds its locks for as long as the run lives, so that
/// anyone can tell a live domain from one that a killed run left behind.
#[derive(Debug)]
pub struct RunDomain {
    id: String,
    root: PathBuf,
    places: Places,
    hold: Hold,
}

/// What keeps a domain, or tells that it is kept.
#[derive(Debug)]
enum Hold {
    /// The creator's.
    Own {
        folder: Lock,
        shared: Lock,
        /// Held too: what clears /tmp of old files passes by a folder that is locked.
        _root: Option<File>,
    },
    /// A lock that the creator holds, open to look at.
    Seen(File),
}

impl RunDomain {
    /// Makes a new domain, readable by this user alone.
    ///
    /// # Errors
    /// [`WireError::Unfit`] and [`WireError::Obstructed`] for the places where domains lie, or
    /// what the file system refuses.
    pub fn create() -> Result<Self, WireError> {
        Self::create_in(Places::system())
    }

    fn create_in(places: Places) -> Result<Self, WireError> {
        places.check_shared()?;
        for _ in 0..ATTEMPTS {
            places.make_folder()?;
            let id = format!("{:08x}", crate::random());
            let Some(folder) = make_root(&places, &id)? else {
                continue;
            };
            let path = places.shared_lock(&id);
            let shared = match Lock::create(&path) {
                Ok(lock) => Some(lock),
                Err(error) if error.kind() == ErrorKind::AlreadyExists => None,
                Err(error) => {
                    unmake(&places, &id, &folder);
                    return Err(io(&path, error));
                }
            };
            // Files without a lock are another run's too.
            let alone = places.shared_files(&id).len() == 1;
            if let Some(shared) = shared.filter(|_| alone) {
                let root = places.root(&id);
                let handle = File::open(&root).ok();
                let _root = handle.filter(|handle| handle.try_lock_shared().is_ok());
                let hold = Hold::Own {
                    folder,
                    shared,
                    _root,
                };
                return Ok(Self {
                    id,
                    root,
                    places,
                    hold,
                });
            }
            unmake(&places, &id, &folder);
        }
        let reason = std::io::Error::other("every name that was tried is taken");
        Err(io(&places.folder, reason))
    }

    /// The domain of a live run.
    ///
    /// # Errors
    /// [`WireError::NoSuchRun`] when no run of this id is alive, [`WireError::Hidden`] when it is
    /// or may be, but its channels are not to be seen from here.
    pub fn open(id: &str) -> Result<Self, WireError> {
        Self::open_in(Places::system(), id)
    }

    fn open_in(places: Places, id: &str) -> Result<Self, WireError> {
        if !is_id(id) {
            return Err(WireError::NoSuchRun(id.to_owned()));
        }
        let root = places.root(id);
        let hidden = |path: PathBuf, removed| WireError::Hidden {
            id: id.to_owned(),
            path,
            removed,
        };
        let View { folder, shared, .. } = match View::of(&places, id) {
            view if view.is_nothing() => return Err(WireError::NoSuchRun(id.to_owned())),
            view => match view.liveness() {
                Liveness::Alive => view,
                Liveness::Dead => return Err(WireError::NoSuchRun(id.to_owned())),
                Liveness::Unknown(Unseen::NoLock) => {
                    return Err(hidden(places.folder_lock(id), ""));
                }
                Liveness::Unknown(unseen) => {
                    let id = id.to_owned();
                    return Err(WireError::Unseen { id, unseen });
                }
            },
        };
        if !root.is_dir() {
            return Err(hidden(root, ""));
        }
        if places.shared_files(id).is_empty() {
            return Err(hidden(places.shared_lock(id), LOGGED_OUT));
        }
        match (folder, shared) {
            (Sight::Held(file), _) | (_, Sight::Held(file)) => Ok(Self {
                id: id.to_owned(),
                root,
                places,
                hold: Hold::Seen(file),
            }),
            _ => Err(WireError::NoSuchRun(id.to_owned())),
        }
    }

    /// Whether the run has ended, or was killed.
    #[must_use]
    pub fn is_over(&self) -> bool {
        match &self.hold {
            Hold::Own { .. } => false,
            // What cannot be told is not over.
            Hold::Seen(file) => {
                let removed = file.metadata().is_ok_and(|about| about.nlink() == 0);
                removed || matches!(lock::is_held(file), Ok(false))
            }
        }
    }

    /// The domain's id: 8 hexadecimal digits.
    #[must_use]
    pub fn id(&self) -> &str {
        &self.id
    }

    pub(crate) fn root(&self) -> &Path {
        &self.root
    }

    pub(crate) fn prefix(&self) -> String {
        self.places.prefix(&self.id)
    }

    /// Lets nobody but the owner open what the domain has in shared memory.
    pub(crate) fn make_private(&self) -> std::io::Result<()> {
        for file in self.places.shared_files(&self.id) {
            let private = fs::Permissions::from_mode(0o600);
            let open = |about: &fs::Metadata| about.permissions().mode() & 0o077 != 0;
            // Another process may have removed its own meanwhile.
            if fs::metadata(&file).is_ok_and(|about| open(&about)) {
                match fs::set_permissions(&file, private) {
                    Err(error) if error.kind() != ErrorKind::NotFound => return Err(error),
                    _ => {}
                }
            }
        }
        Ok(())
    }

    /// Removes all files of the domain. For its creator, once all other processes are gone.
    pub fn remove(self) {}
}

impl Drop for RunDomain {
    /// No way out of the creator leaves files behind.
    fn drop(&mut self) {
        if let Hold::Own { folder, shared, .. } = &self.hold {
            // What cannot be removed is seen to be dead by the next one that looks.
            let _ = leftovers::remove(&self.places, &self.id, Some(folder), shared);
        }
    }
}

/// Makes a domain's folder with a lock in it; none where another process was in the way. It is
/// made elsewhere and renamed once it is locked: nobody sees it without its lock.
fn make_root(places: &Places, id: &str) -> Result<Option<Lock>, WireError> {
    let unborn = format!("{UNBORN}{id}{:08x}", crate::random());
    let unborn = places.folder.join(unborn);
    let in_the_way = |error: &std::io::Error| {
        // Removed by one that saw it without its lock, or the name is taken.
        let kinds = [
            ErrorKind::NotFound,
            ErrorKind::AlreadyExists,
            ErrorKind::DirectoryNotEmpty,
        ];
        kinds.contains(&error.kind())
    };
    if let Err(error) = places::make_private(&unborn) {
        return if in_the_way(&error) {
            Ok(None)
        } else {
            Err(io(&unborn, error))
        };
    }
    let path = unborn.join("lock");
    let lock = match Lock::create(&path) {
        Ok(lock) => lock,
        Err(error) => {
            let _ = fs::remove_dir(&unborn);
            return if in_the_way(&error) {
                Ok(None)
            } else {
                Err(io(&path, error))
            };
        }
    };
    let root = places.root(id);
    match fs::rename(&unborn, &root) {
        Ok(()) => Ok(Some(lock.moved_to(root.join("lock")))),
        Err(error) => {
            let _ = fs::remove_dir_all(&unborn);
            if in_the_way(&error) {
                Ok(None)
            } else {
                Err(io(&root, error))
            }
        }
    }
}

/// Takes back a folder whose id is taken in shared memory.
fn unmake(places: &Places, id: &str, folder: &Lock) {
    let _ = fs::remove_file(folder.path());
    let _ = fs::remove_dir(places.root(id));
}

#[cfg(test)]
mod tests;
