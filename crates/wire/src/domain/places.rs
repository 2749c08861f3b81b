//! Where domains lie: a folder of sockets and names, and shared memory.
//!
//! Neither depends on the environment: processes of one run may have another `TMPDIR` or `HOME`.

use std::fs::{self, DirBuilder, Permissions};
use std::io::ErrorKind;
use std::os::unix::fs::{DirBuilderExt, MetadataExt, PermissionsExt};
use std::path::{Path, PathBuf};

use rustix::fs::{Access, StatVfsMountFlags, access, statfs, statvfs};

use super::lock::{Unseen, not_a_file};
use crate::WireError;

/// Where the folders of sockets and names lie.
pub const SOCKETS: &str = "/tmp";
/// Where shared memory lies; the C library knows no other place.
pub const SHARED_MEMORY: &str = "/dev/shm";
/// Names of domains that are being made begin with this.
pub(super) const UNBORN: &str = ".new-";
/// Type of a file system that is in memory, as `statfs` tells it.
const TMPFS: i64 = 0x0102_1994;

const SHARED_REMEDY: &str = "`mount -t tmpfs -o size=1g tmpfs /dev/shm` makes it, and a container \
                             has it by --shm-size=1g";
const SOCKETS_REMEDY: &str = "it has to be a folder that this user may write to; a container gets \
                              one by --tmpfs /tmp";

/// Folders and user that domains belong to.
#[derive(Debug, Clone)]
pub(super) struct Places {
    /// This user's domains, each a folder.
    pub(super) folder: PathBuf,
    /// Shared memory of all users.
    pub(super) shared: PathBuf,
    pub(super) user: u32,
}

/// Whether a text can be a domain's id.
pub(super) fn is_id(text: &str) -> bool {
    text.len() == 8 && text.bytes().all(|b| b.is_ascii_hexdigit())
}

impl Places {
    /// Those of this process's user.
    pub(super) fn system() -> Self {
        let user = rustix::process::getuid().as_raw();
        Self {
            folder: Path::new(SOCKETS).join(format!("formica-{user}")),
            shared: PathBuf::from(SHARED_MEMORY),
            user,
        }
    }

    /// A domain's folder.
    pub(super) fn root(&self, id: &str) -> PathBuf {
        self.folder.join(id)
    }

    /// What names of a domain's files in shared memory begin with.
    pub(super) fn prefix(&self, id: &str) -> String {
        format!("formica{}_{id}_", self.user)
    }

    pub(super) fn folder_lock(&self, id: &str) -> PathBuf {
        self.root(id).join("lock")
    }

    pub(super) fn shared_lock(&self, id: &str) -> PathBuf {
        self.shared.join(self.prefix(id) + "lock")
    }

    /// A domain's files in shared memory, its lock file included.
    pub(super) fn shared_files(&self, id: &str) -> Vec<PathBuf> {
        let prefix = self.prefix(id);
        // iceoryx2 marks some names with leading dots.
        let own = |name: &String| name.trim_start_matches('.').starts_with(&prefix);
        names(&self.shared)
            .into_iter()
            .filter(own)
            .map(|name| self.shared.join(name))
            .collect()
    }

    /// Ids of which there is a folder or a file in shared memory, each once.
    pub(super) fn ids(&self) -> Vec<String> {
        let start = format!("formica{}_", self.user);
        let id_of = |name: &String| {
            let rest = name.trim_start_matches('.').strip_prefix(&start)?;
            rest.split('_').next().map(str::to_owned)
        };
        let mut ids: Vec<String> = names(&self.shared).iter().filter_map(id_of).collect();
        if self.strange_folder().is_none() {
            ids.extend(names(&self.folder));
        }
        ids.retain(|id| is_id(id));
        ids.sort();
        ids.dedup();
        ids
    }

    /// Names of domains that are being made, or were never finished.
    pub(super) fn unborn(&self) -> Vec<PathBuf> {
        if self.strange_folder().is_some() {
            return vec![];
        }
        let names = names(&self.folder).into_iter();
        names
            .filter(|name| name.starts_with(UNBORN))
            .map(|name| self.folder.join(name))
            .collect()
    }

    /// Why the user's folder is none of this user's, where something stands in its place: another
    /// user may have made it first, and could read and replace all within.
    pub(super) fn strange_folder(&self) -> Option<Unseen> {
        let path = self.folder.clone();
        let about = match fs::symlink_metadata(&path) {
            Ok(about) => about,
            Err(error) if error.kind() == ErrorKind::NotFound => return None,
            Err(error) => {
                let reason = error.to_string();
                return Some(Unseen::Closed { path, reason });
            }
        };
        if about.uid() != self.user {
            let owner = about.uid();
            return Some(Unseen::Foreign { path, owner });
        }
        let what = if about.is_file() {
            "a file"
        } else {
            not_a_file(&about)?
        };
        (!about.is_dir()).then_some(Unseen::Strange { path, what })
    }

    /// Makes the user's folder, readable by this user alone, where it is missing.
    pub(super) fn make_folder(&self) -> Result<(), WireError> {
        match make_private(&self.folder) {
            Err(error) if error.kind() != ErrorKind::AlreadyExists => {
                let parent = self.folder.parent().unwrap_or(&self.folder);
                check(parent, SOCKETS_REMEDY)?;
                return Err(unfit(parent, &error.to_string(), SOCKETS_REMEDY));
            }
            _ => {}
        }
        match self.strange_folder() {
            None => Ok(()),
            Some(unseen) => Err(WireError::Obstructed {
                folder: self.folder.clone(),
                unseen,
            }),
        }
    }

    /// Whether shared memory is there and may be written to.
    pub(super) fn check_shared(&self) -> Result<(), WireError> {
        check(&self.shared, SHARED_REMEDY)
    }
}

/// Makes a folder that its owner alone may open, whatever the umask is.
pub(super) fn make_private(folder: &Path) -> std::io::Result<()> {
    DirBuilder::new().mode(0o700).create(folder)?;
    fs::set_permissions(folder, Permissions::from_mode(0o700))
}

fn unfit(path: &Path, fault: &str, remedy: &'static str) -> WireError {
    WireError::Unfit {
        path: path.to_path_buf(),
        fault: fault.to_owned(),
        remedy,
    }
}

fn check(path: &Path, remedy: &'static str) -> Result<(), WireError> {
    let unfit = |fault: &str| Err(unfit(path, fault, remedy));
    match fs::metadata(path) {
        Err(error) if error.kind() == ErrorKind::NotFound => return unfit("it is not there"),
        Err(error) => return unfit(&error.to_string()),
        Ok(about) if !about.is_dir() => return unfit("it is not a folder"),
        Ok(_) => {}
    }
    let read_only = statvfs(path).is_ok_and(|fs| fs.f_flag.contains(StatVfsMountFlags::RDONLY));
    if read_only {
        return unfit("it is mounted read-only");
    }
    match access(path, Access::READ_OK | Access::WRITE_OK | Access::EXEC_OK) {
        Ok(()) => Ok(()),
        Err(_) => unfit("this user may not write to it"),
    }
}

fn available(path: &Path, remedy: &'static str) -> Result<u64, WireError> {
    check(path, remedy)?;
    match statvfs(path) {
        Ok(space) => Ok(space.f_bavail * space.f_frsize),
        Err(error) => Err(unfit(path, &error.to_string(), remedy)),
    }
}

/// Shared memory that is free on this machine (bytes).
///
/// # Errors
/// [`WireError::Unfit`] where there is none, or none that this user may write to.
pub fn shared_memory_available() -> Result<u64, WireError> {
    available(Path::new(SHARED_MEMORY), SHARED_REMEDY)
}

/// Space that is free where sockets and names lie (bytes).
///
/// # Errors
/// [`WireError::Unfit`] where this user may not write to it, [`WireError::Obstructed`] where
/// something else stands in the place of this user's folder.
pub fn sockets_available() -> Result<u64, WireError> {
    let places = Places::system();
    if let Some(unseen) = places.strange_folder() {
        let folder = places.folder;
        return Err(WireError::Obstructed { folder, unseen });
    }
    // One that is there is enough: /tmp itself may be closed to this user.
    let there = places.folder.is_dir();
    let path = if there {
        places.folder.as_path()
    } else {
        Path::new(SOCKETS)
    };
    available(path, SOCKETS_REMEDY)
}

/// Whether shared memory is in memory: elsewhere every message would go to a disk.
#[must_use]
pub fn shared_memory_is_in_memory() -> bool {
    statfs(SHARED_MEMORY).is_ok_and(|fs| fs.f_type == TMPFS)
}

fn names(folder: &Path) -> Vec<String> {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    entries
        .filter_map(|entry| entry.file_name().into_string().ok())
        .collect()
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// Folders in place of the machine's.
    pub(in crate::domain) fn places(folder: &Path) -> Places {
        let shared = folder.join("shared");
        fs::create_dir_all(&shared).unwrap();
        Places {
            folder: folder.join("formica"),
            shared,
            user: rustix::process::getuid().as_raw(),
        }
    }

    #[test]
    fn what_stands_in_the_place_of_the_folder_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let places = places(folder.path());
        let told = || places.make_folder().unwrap_err().to_string();
        std::os::unix::fs::symlink(folder.path(), &places.folder).unwrap();
        assert!(told().contains("is a symbolic link"), "{}", told());
        fs::remove_file(&places.folder).unwrap();
        fs::write(&places.folder, "").unwrap();
        assert!(told().contains("is a file"), "{}", told());
        fs::remove_file(&places.folder).unwrap();
        places.make_folder().unwrap();
        places.make_folder().unwrap();
        let other = Places {
            user: places.user + 1,
            ..places.clone()
        };
        let told = other.make_folder().unwrap_err().to_string();
        assert!(told.contains("belongs to the user with number"), "{told}");
        assert!(other.ids().is_empty() && other.unborn().is_empty());
    }

    #[test]
    fn a_place_that_is_missing_or_closed_is_named_with_a_remedy() {
        let folder = tempfile::tempdir().unwrap();
        let mut places = places(folder.path());
        places.check_shared().unwrap();
        places.shared = folder.path().join("none");
        let told = places.check_shared().unwrap_err().to_string();
        assert!(told.contains("none': it is not there"), "{told}");
        assert!(told.contains("--shm-size"), "{told}");
        fs::write(&places.shared, "").unwrap();
        let told = places.check_shared().unwrap_err().to_string();
        assert!(told.contains("it is not a folder"), "{told}");
    }

    #[test]
    fn ids_are_read_from_both_places_and_nothing_else_is_taken_for_one() {
        let folder = tempfile::tempdir().unwrap();
        let places = places(folder.path());
        places.make_folder().unwrap();
        for name in ["0000000a", "strange", ".new-1", "0000000A_"] {
            fs::create_dir(places.folder.join(name)).unwrap();
        }
        let user = places.user;
        for name in ["0000000b_lock", "0000000b_x", "tooshort_", "0000000a_y"] {
            fs::write(places.shared.join(format!("formica{user}_{name}")), "").unwrap();
        }
        let dotted = format!(".formica{user}_0000000c_z");
        fs::write(places.shared.join(dotted), "").unwrap();
        let strange = format!("formica{user}0_0000000d_z");
        fs::write(places.shared.join(strange), "").unwrap();
        assert_eq!(places.ids(), ["0000000a", "0000000b", "0000000c"]);
        assert_eq!(places.shared_files("0000000b").len(), 2);
    }
}
