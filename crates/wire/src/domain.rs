//! A run's own domain of channels: a folder for sockets and names, a prefix in /dev/shm.
//!
//! Both are short, since Unix socket names are limited to about 100 bytes.

use std::fs::{self, DirBuilder, File};
use std::io::ErrorKind;
use std::os::unix::fs::{DirBuilderExt, PermissionsExt};
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use crate::WireError;

const SHARED_MEMORY: &str = "/dev/shm";
/// Names of domains that are being made begin with this.
const UNBORN: &str = ".new-";
/// A domain is made faster than this; what is older was never finished.
const BIRTH: Duration = Duration::from_secs(60);

fn user_folder() -> PathBuf {
    let user = rustix::process::getuid().as_raw();
    PathBuf::from(format!("/tmp/formica-{user}"))
}

fn prefix_of(id: &str) -> String {
    let user = rustix::process::getuid().as_raw();
    format!("formica{user}_{id}_")
}

fn io(path: &Path) -> impl FnOnce(std::io::Error) -> WireError + '_ {
    |source| WireError::Io {
        path: path.display().to_string(),
        source,
    }
}

/// A run's domain. The one that created it holds its lock for as long as the run lives, so that
/// anyone can tell a live domain from one that a killed run left behind.
#[derive(Debug)]
pub struct RunDomain {
    id: String,
    root: PathBuf,
    lock: Option<File>,
}

impl RunDomain {
    /// Makes a new domain, readable by this user alone.
    ///
    /// # Errors
    /// What the file system refuses.
    pub fn create() -> Result<Self, WireError> {
        let folder = user_folder();
        make_private(&folder)?;
        let clock = SystemTime::now()
            .duration_since(UNIX_EPOCH)
            .unwrap_or_default();
        let mut id = clock.subsec_nanos() ^ (std::process::id() << 12);
        // Made elsewhere and renamed once it is locked: nobody sees it without its lock.
        let unborn = folder.join(format!("{UNBORN}{id:08x}-{}", std::process::id()));
        DirBuilder::new()
            .mode(0o700)
            .create(&unborn)
            .map_err(io(&unborn))?;
        let path = unborn.join("lock");
        let lock = File::create(&path).map_err(io(&path))?;
        lock.lock().map_err(io(&path))?;
        loop {
            let name = format!("{id:08x}");
            let root = folder.join(&name);
            let taken = |error: &std::io::Error| {
                let kind = error.kind();
                kind == ErrorKind::AlreadyExists || kind == ErrorKind::DirectoryNotEmpty
            };
            match fs::rename(&unborn, &root) {
                Ok(()) => {
                    return Ok(Self {
                        id: name,
                        root,
                        lock: Some(lock),
                    });
                }
                Err(error) if taken(&error) => {
                    id = id.wrapping_mul(747_796_405).wrapping_add(1);
                }
                Err(error) => return Err(io(&root)(error)),
            }
        }
    }

    /// The domain of a live run.
    ///
    /// # Errors
    /// [`WireError::NoSuchRun`] when no run of this id is alive.
    pub fn open(id: &str) -> Result<Self, WireError> {
        let plain = id.len() == 8 && id.bytes().all(|b| b.is_ascii_hexdigit());
        let root = user_folder().join(id);
        if !plain || !is_alive(&root) {
            return Err(WireError::NoSuchRun(id.to_owned()));
        }
        Ok(Self {
            id: id.to_owned(),
            root,
            lock: None,
        })
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
        prefix_of(&self.id)
    }

    /// Lets nobody but the owner open what the domain has in shared memory.
    pub(crate) fn make_private(&self) -> std::io::Result<()> {
        for file in shared_files(&self.id) {
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
    pub fn remove(mut self) {
        remove_files(&self.id);
        self.lock = None;
    }
}

/// What a run left behind, or a live run's own.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Leftover {
    /// The domain's id.
    pub id: String,
    /// Whether its run is alive.
    pub alive: bool,
    /// Number of files in shared memory.
    pub files: usize,
    /// Their size (bytes).
    pub bytes: u64,
}

/// All domains of this user on this machine.
#[must_use]
pub fn leftovers() -> Vec<Leftover> {
    let folder = user_folder();
    let mut ids: Vec<String> = names(&folder);
    for name in ids.iter().filter(|name| name.starts_with(UNBORN)) {
        let path = folder.join(name);
        let age = fs::metadata(&path).and_then(|m| m.modified());
        let age = age.ok().and_then(|made| made.elapsed().ok());
        if age.is_some_and(|age| age > BIRTH) {
            let _ = fs::remove_dir_all(path);
        }
    }
    let start = prefix_of("");
    let start = start.trim_end_matches('_').to_owned() + "_";
    for name in names(Path::new(SHARED_MEMORY)) {
        if let Some(id) = name
            .strip_prefix(&start)
            .and_then(|rest| rest.split('_').next())
        {
            ids.push(id.to_owned());
        }
    }
    ids.retain(|id| id.len() == 8 && id.bytes().all(|b| b.is_ascii_hexdigit()));
    ids.sort();
    ids.dedup();
    ids.into_iter()
        .map(|id| {
            let files = shared_files(&id);
            let size = |path: &PathBuf| fs::metadata(path).map_or(0, |file| file.len());
            Leftover {
                alive: is_alive(&folder.join(&id)),
                files: files.len(),
                bytes: files.iter().map(size).sum(),
                id,
            }
        })
        .collect()
}

/// Removes what a dead run left; a live one's files stay. Whether it was removed.
#[must_use]
pub fn clear(leftover: &Leftover) -> bool {
    let dead = !is_alive(&user_folder().join(&leftover.id));
    if dead {
        remove_files(&leftover.id);
    }
    dead
}

fn names(folder: &Path) -> Vec<String> {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    entries
        .filter_map(|entry| entry.file_name().into_string().ok())
        .collect()
}

fn shared_files(id: &str) -> Vec<PathBuf> {
    let prefix = prefix_of(id);
    let folder = Path::new(SHARED_MEMORY);
    // iceoryx2 marks some names with leading dots.
    let own = |name: &String| name.trim_start_matches('.').starts_with(&prefix);
    names(folder)
        .into_iter()
        .filter(own)
        .map(|name| folder.join(name))
        .collect()
}

fn remove_files(id: &str) {
    for file in shared_files(id) {
        let _ = fs::remove_file(file);
    }
    // The user's folder stays: another run may be about to make its own in it.
    let _ = fs::remove_dir_all(user_folder().join(id));
}

/// A domain is alive while somebody holds its lock.
fn is_alive(root: &Path) -> bool {
    match File::open(root.join("lock")) {
        Ok(file) => matches!(file.try_lock(), Err(fs::TryLockError::WouldBlock)),
        Err(_) => false,
    }
}

fn make_private(folder: &Path) -> Result<(), WireError> {
    use std::os::unix::fs::MetadataExt;
    match DirBuilder::new().mode(0o700).create(folder) {
        Err(error) if error.kind() != ErrorKind::AlreadyExists => return Err(io(folder)(error)),
        _ => {}
    }
    // Another user may have made the folder first; its owner could read and replace all within.
    let owner = fs::symlink_metadata(folder).map_err(io(folder))?;
    if !owner.is_dir() || owner.uid() != rustix::process::getuid().as_raw() {
        let source = std::io::Error::new(ErrorKind::PermissionDenied, "not a folder of this user");
        return Err(io(folder)(source));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_live_domain_is_seen_and_never_cleared_a_dead_one_is() {
        let domain = RunDomain::create().unwrap();
        let id = domain.id().to_owned();
        let find = || leftovers().into_iter().find(|leftover| leftover.id == id);
        let own = find().unwrap();
        assert!(own.alive);
        assert!(!clear(&own));
        assert!(RunDomain::open(&id).is_ok());
        // As after kill -9: the lock is gone, the files are not.
        let RunDomain { lock, .. } = domain;
        drop(lock);
        let dead = find().unwrap();
        assert!(!dead.alive);
        assert!(matches!(RunDomain::open(&id), Err(WireError::NoSuchRun(_))));
        assert!(clear(&dead));
        assert!(find().is_none());
    }

    #[test]
    fn strange_ids_name_no_run() {
        for id in ["", "../../etc", "zzzzzzzz", "0123456"] {
            assert!(matches!(RunDomain::open(id), Err(WireError::NoSuchRun(_))));
        }
    }
}
