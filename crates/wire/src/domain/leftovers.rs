//! What runs left behind, and whether it may be cleared.
//!
//! What a process cannot see is not dead. A domain is dead only when a lock of it is seen, can be
//! opened, and nobody holds it or its other lock.

use std::fs;
use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};

use super::lock::{Lock, Sight, Unseen, look};
use super::places::{Places, is_id};

/// Whether a domain's run is alive.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Liveness {
    /// A process holds a lock of it.
    Alive,
    /// Nobody holds a lock of it, and one is seen.
    Dead,
    /// It cannot be told from here.
    Unknown(Unseen),
}

/// What a run left behind, or a live run's own.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Leftover {
    /// The domain's id.
    pub id: String,
    /// Whether its run is alive.
    pub liveness: Liveness,
    /// Its folder of sockets and names, where there is one.
    pub folder: Option<PathBuf>,
    /// Number of files in shared memory.
    pub files: usize,
    /// Their size (bytes).
    pub bytes: u64,
}

/// Why a domain was not cleared.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum Kept {
    /// There is nothing of this id.
    #[error("there is nothing of it")]
    Nothing,
    /// A live run, or another process that clears it just now.
    #[error("a process holds it")]
    Held,
    /// It cannot be told whether its run is alive.
    #[error(transparent)]
    Unseen(#[from] Unseen),
    /// The system refuses to remove a file of it.
    #[error("'{}' cannot be removed: {reason}", .path.display())]
    Failed {
        /// The file or folder.
        path: PathBuf,
        /// What the system said.
        reason: String,
    },
}

/// What is seen of a domain.
#[derive(Debug)]
pub(super) struct View {
    pub(super) folder: Sight,
    pub(super) shared: Sight,
    files: Vec<PathBuf>,
    root: PathBuf,
}

impl View {
    pub(super) fn of(places: &Places, id: &str) -> Self {
        let folder = match places.strange_folder() {
            Some(unseen) => Sight::Unseen(unseen),
            None => look(&places.folder_lock(id), places.user),
        };
        Self {
            folder,
            shared: look(&places.shared_lock(id), places.user),
            files: places.shared_files(id),
            root: places.root(id),
        }
    }

    pub(super) fn liveness(&self) -> Liveness {
        match (&self.folder, &self.shared) {
            (Sight::Held(_), _) | (_, Sight::Held(_)) => Liveness::Alive,
            (Sight::Unseen(unseen), _) | (_, Sight::Unseen(unseen)) => {
                Liveness::Unknown(unseen.clone())
            }
            (_, Sight::Free) | (Sight::Free, _) => Liveness::Dead,
            // Its lock goes last, so an empty folder was left by one that was killed there.
            (Sight::Absent, Sight::Absent) if self.files.is_empty() && is_empty(&self.root) => {
                Liveness::Dead
            }
            (Sight::Absent, Sight::Absent) => Liveness::Unknown(Unseen::NoLock),
        }
    }

    /// Whether there is anything at all.
    pub(super) fn is_nothing(&self) -> bool {
        let absent = |sight: &Sight| matches!(sight, Sight::Absent);
        absent(&self.shared) && self.files.is_empty() && absent(&self.folder) && !self.root.exists()
    }
}

fn is_empty(folder: &Path) -> bool {
    fs::read_dir(folder).is_ok_and(|mut entries| entries.next().is_none())
}

/// All domains of this user on this machine.
#[must_use]
pub fn leftovers() -> Vec<Leftover> {
    leftovers_in(&Places::system())
}

/// Removes what a dead run left. A live one's files stay, and those of a run that cannot be told
/// to be dead.
///
/// # Errors
/// Why it was kept.
pub fn clear(id: &str) -> Result<(), Kept> {
    clear_in(&Places::system(), id, false)
}

/// Removes a domain that cannot be told to be dead, on its user's word. One that somebody is seen
/// to hold stays.
///
/// # Errors
/// Why it was kept.
pub fn clear_unseen(id: &str) -> Result<(), Kept> {
    clear_in(&Places::system(), id, true)
}

pub(super) fn leftovers_in(places: &Places) -> Vec<Leftover> {
    sweep_unborn(places);
    let size = |path: &PathBuf| fs::symlink_metadata(path).map_or(0, |file| file.len());
    let ids = places.ids().into_iter();
    ids.filter_map(|id| {
        let view = View::of(places, &id);
        // It may have been removed meanwhile.
        (!view.is_nothing()).then(|| Leftover {
            liveness: view.liveness(),
            folder: view.root.is_dir().then(|| view.root.clone()),
            files: view.files.len(),
            bytes: view.files.iter().map(size).sum(),
            id,
        })
    })
    .collect()
}

/// Removes folders of domains that were never finished. Their makers hold a lock in them from the
/// first moment on, or make them again when they are removed before that.
fn sweep_unborn(places: &Places) {
    for path in places.unborn() {
        let lock = path.join("lock");
        match look(&lock, places.user) {
            Sight::Held(_) | Sight::Unseen(_) => {}
            Sight::Absent => {
                // Goes only when it is empty.
                let _ = fs::remove_dir(&path);
            }
            Sight::Free => {
                if let Ok(Some(lock)) = Lock::take(&lock, places.user) {
                    let _ = remove_folder(&path, Some(&lock));
                }
            }
        }
    }
}

/// Clears a domain; with `unseen`, also one of which no lock is seen. Whoever clears holds the
/// lock in shared memory, so that nobody makes a domain of this id meanwhile.
pub(super) fn clear_in(places: &Places, id: &str, unseen: bool) -> Result<(), Kept> {
    let view = View::of(places, id);
    if !is_id(id) || view.is_nothing() {
        return Err(Kept::Nothing);
    }
    match view.liveness() {
        Liveness::Alive => return Err(Kept::Held),
        // Another user's files are not ours to remove, whatever this user says.
        Liveness::Unknown(why) if !unseen || !matches!(why, Unseen::NoLock) => {
            return Err(why.into());
        }
        Liveness::Unknown(_) | Liveness::Dead => {}
    }
    let path = places.shared_lock(id);
    let (shared, made) = match Lock::take(&path, places.user)? {
        Some(lock) => (lock, false),
        None => match Lock::create(&path) {
            Ok(lock) => (lock, true),
            Err(error) if error.kind() == ErrorKind::AlreadyExists => return Err(Kept::Held),
            Err(error) => return Err(failed(&path, &error)),
        },
    };
    // The folder's is looked at again, now that nobody makes it anew.
    match take_folder(places, id) {
        Ok(folder) => remove(places, id, folder.as_ref(), &shared),
        Err(kept) => {
            if made {
                remove_file(&path)?;
            }
            Err(kept)
        }
    }
}

/// Holds the lock in a domain's folder, where there is one.
fn take_folder(places: &Places, id: &str) -> Result<Option<Lock>, Kept> {
    let path = places.folder_lock(id);
    match look(&path, places.user) {
        Sight::Absent => Ok(None),
        Sight::Unseen(why) => Err(why.into()),
        Sight::Held(_) => Err(Kept::Held),
        Sight::Free => match Lock::take(&path, places.user)? {
            Some(lock) => Ok(Some(lock)),
            None => Err(Kept::Held),
        },
    }
}

/// Removes a domain whose locks are held by the caller: the locks last, so that what remains of
/// it when the caller is killed is seen to be dead.
pub(super) fn remove(
    places: &Places,
    id: &str,
    folder: Option<&Lock>,
    shared: &Lock,
) -> Result<(), Kept> {
    for file in places.shared_files(id) {
        if file != shared.path() {
            remove_file(&file)?;
        }
    }
    if places.strange_folder().is_none() {
        // The user's folder stays: another run may be about to make its own in it.
        remove_folder(&places.root(id), folder)?;
    }
    remove_file(shared.path())
}

/// Removes a folder, the lock in it after all else.
fn remove_folder(folder: &Path, lock: Option<&Lock>) -> Result<(), Kept> {
    let entries = match fs::read_dir(folder) {
        Ok(entries) => entries,
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(()),
        Err(error) => return Err(failed(folder, &error)),
    };
    let mut locked = None;
    for entry in entries.flatten() {
        let path = entry.path();
        if entry.file_name() == "lock" {
            locked = Some(path);
        } else if entry.file_type().is_ok_and(|kind| kind.is_dir()) {
            fs::remove_dir_all(&path).map_err(|error| failed(&path, &error))?;
        } else {
            remove_file(&path)?;
        }
    }
    match (locked, lock) {
        (Some(path), Some(_)) => remove_file(&path)?,
        // Somebody has made it anew.
        (Some(_), None) => return Err(Kept::Held),
        (None, _) => {}
    }
    match fs::remove_dir(folder) {
        Err(error) if error.kind() != ErrorKind::NotFound => Err(failed(folder, &error)),
        _ => Ok(()),
    }
}

fn remove_file(path: &Path) -> Result<(), Kept> {
    match fs::remove_file(path) {
        Err(error) if error.kind() != ErrorKind::NotFound => Err(failed(path, &error)),
        _ => Ok(()),
    }
}

fn failed(path: &Path, error: &io::Error) -> Kept {
    Kept::Failed {
        path: path.to_path_buf(),
        reason: error.to_string(),
    }
}
