//! Finding a run that is alive, to join it from any shell.

use std::fs::{File, TryLockError};
use std::io;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use wire::{RunDomain, WireError};

/// How often an attached actor looks whether its run is still there.
const LOOK: Duration = Duration::from_millis(250);

/// Why a run cannot be joined.
#[derive(Debug, thiserror::Error)]
pub(crate) enum AttachError {
    /// No folder of that name.
    #[error("there is no run '{name}': neither '{name}' nor 'runs/{name}' is a run's folder")]
    NoFolder {
        /// As given.
        name: String,
    },
    /// A run of somebody else.
    #[error(
        "the run in '{folder}' belongs to the user with number {owner}, this is number {own}; a \
         run takes its owner's processes alone", folder = .folder.display()
    )]
    Foreign {
        /// Its folder.
        folder: PathBuf,
        /// Its user.
        owner: u32,
        /// This user.
        own: u32,
    },
    /// The run is over.
    #[error(
        "the run in '{folder}' is not alive; `formica launch --resume {folder}` goes on with one \
         that was stopped", folder = .folder.display()
    )]
    Dead {
        /// Its folder.
        folder: PathBuf,
    },
    /// The run is alive, and none of its channels is to be seen.
    #[error(
        "the run in '{folder}' is alive, but its channels are not visible from here: neither \
         '{sockets}/formica-{own}/{id}' nor '{memory}/formica{own}_{id}_lock' is there; attach from \
         where it was launched, or from a container or service with the same {sockets} and {memory}, \
         or try again if it has just been launched",
        folder = .folder.display(), sockets = wire::SOCKETS, memory = wire::SHARED_MEMORY
    )]
    Elsewhere {
        /// Its folder.
        folder: PathBuf,
        /// Its domain of channels.
        id: String,
        /// This user.
        own: u32,
    },
    /// What the channels refuse.
    #[error(transparent)]
    Wire(#[from] WireError),
}

/// Folder and domain of a run, by its name or its folder.
pub(crate) fn find(name: &str) -> Result<(PathBuf, RunDomain), AttachError> {
    let candidates = [PathBuf::from(name), Path::new("runs").join(name)];
    let own = rustix::process::getuid().as_raw();
    for folder in candidates {
        let Ok(about) = std::fs::metadata(&folder) else {
            continue;
        };
        if about.uid() != own {
            let owner = about.uid();
            return Err(AttachError::Foreign { folder, owner, own });
        }
        let Ok(id) = std::fs::read_to_string(folder.join("domain")) else {
            continue;
        };
        return match RunDomain::open(id.trim()) {
            Ok(domain) => Ok((folder, domain)),
            Err(WireError::NoSuchRun(id)) if is_led(&folder) => {
                Err(AttachError::Elsewhere { folder, id, own })
            }
            Err(WireError::NoSuchRun(_)) => Err(AttachError::Dead { folder }),
            Err(error) => Err(error.into()),
        };
    }
    let name = name.to_owned();
    Err(AttachError::NoFolder { name })
}

/// Whether a launcher works in a run's folder: it holds a lock there, too.
fn is_led(folder: &Path) -> bool {
    let lock = File::open(folder.join("lock"));
    lock.is_ok_and(|lock| matches!(lock.try_lock_shared(), Err(TryLockError::WouldBlock)))
}

/// Sets `stop` when the run is no longer alive: an attached actor has no launcher for a parent.
///
/// # Errors
/// A thread that the system does not let us have.
pub(crate) fn watch(domain: RunDomain, stop: &Arc<AtomicBool>) -> io::Result<Arc<AtomicBool>> {
    let ended = Arc::new(AtomicBool::new(false));
    let (told, stop) = (Arc::clone(&ended), Arc::clone(stop));
    let watcher = std::thread::Builder::new();
    watcher.spawn(move || {
        while !stop.load(Ordering::Relaxed) {
            if domain.is_over() {
                told.store(true, Ordering::Relaxed);
                stop.store(true, Ordering::Relaxed);
            }
            std::thread::sleep(LOOK);
        }
    })?;
    Ok(ended)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_no_run_is_said_so() {
        let folder = tempfile::tempdir().unwrap();
        let name = folder.path().display().to_string();
        assert!(matches!(find(&name), Err(AttachError::NoFolder { .. })));
        assert!(matches!(
            find("no-such-run"),
            Err(AttachError::NoFolder { .. })
        ));
        std::fs::write(folder.path().join("domain"), "0badcafe").unwrap();
        let told = find(&name).unwrap_err().to_string();
        assert!(told.contains("is not alive"), "{told}");
        // A launcher holds the folder's lock, and its channels are nowhere.
        let lock = File::create(folder.path().join("lock")).unwrap();
        lock.lock().unwrap();
        let told = find(&name).unwrap_err().to_string();
        assert!(told.contains("not visible from here"), "{told}");
    }
}
