//! Finding a run that is alive, to join it from any shell.

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
        return match RunDomain::open(&id) {
            Ok(domain) => Ok((folder, domain)),
            Err(WireError::NoSuchRun(_)) => Err(AttachError::Dead { folder }),
            Err(error) => Err(error.into()),
        };
    }
    let name = name.to_owned();
    Err(AttachError::NoFolder { name })
}

/// Sets `stop` when the run is no longer alive: an attached actor has no launcher for a parent.
pub(crate) fn watch(domain: &RunDomain, stop: &Arc<AtomicBool>) -> Arc<AtomicBool> {
    let ended = Arc::new(AtomicBool::new(false));
    let (told, stop, id) = (Arc::clone(&ended), Arc::clone(stop), domain.id().to_owned());
    std::thread::spawn(move || {
        while !stop.load(Ordering::Relaxed) {
            if RunDomain::open(&id).is_err() {
                told.store(true, Ordering::Relaxed);
                stop.store(true, Ordering::Relaxed);
            }
            std::thread::sleep(LOOK);
        }
    });
    ended
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
    }
}
