//! Files that are whole or untouched, and training states that outlive their process.
//!
//! Everything that a run writes and may need again is written beside its place, synced and
//! renamed; a process that is killed, a disk that fills up or a machine that loses power leaves
//! the file of before. States are kept as the newest two, so that a damaged one has one before it.
//!
//! What a user names as an output goes through [`Output`], which replaces nothing unless told to.

mod existing;
mod output;
mod staged;
mod states;
#[cfg(test)]
mod tests;

pub use output::{Existing, Output, OutputError};
pub use staged::{Staged, discard_staged};
pub use states::{Damaged, Newest, Stamp, StateError, States};

use std::ffi::OsString;
use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use output::folder;

/// Writes a file beside `path`, syncs and renames it: it is there whole or not at all.
///
/// # Errors
/// What the system refuses; nothing is left beside `path` then.
pub fn write(path: &Path, bytes: &[u8]) -> io::Result<()> {
    write_with(path, |file| file.write_all(bytes))
}

/// [`write`] of what `fill` writes.
///
/// # Errors
/// Those of `fill`, and what the system refuses; nothing is left beside `path` then.
pub fn write_with(
    path: &Path,
    fill: impl FnOnce(&mut BufWriter<File>) -> io::Result<()>,
) -> io::Result<()> {
    let part = part(path);
    let write = || {
        let mut file = BufWriter::new(File::create(&part)?);
        fill(&mut file)?;
        file.flush()?;
        file.get_ref().sync_all()?;
        fs::rename(&part, path)?;
        // The new name outlasts a loss of power only once its folder is synced.
        File::open(folder(path))?.sync_all()
    };
    let written = write();
    if written.is_err() {
        // That it cannot be removed changes nothing.
        let _ = fs::remove_file(&part);
    }
    written
}

fn part(path: &Path) -> PathBuf {
    let mut part = OsString::from(path);
    part.push(".part");
    part.into()
}

#[cfg(test)]
mod writing {
    use super::*;

    #[test]
    fn a_file_that_cannot_be_written_leaves_the_one_before() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.txt");
        write(&path, b"first").unwrap();
        // The part's place is taken by a folder.
        fs::create_dir(part(&path)).unwrap();
        assert!(write(&path, b"second").is_err());
        assert_eq!(fs::read(&path).unwrap(), b"first");
        fs::remove_dir(part(&path)).unwrap();
        write(&path, b"second").unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"second");
        let failed = write_with(&path, |file| {
            file.write_all(b"thi")?;
            Err(io::Error::other("no more"))
        });
        assert!(failed.is_err());
        assert_eq!(fs::read(&path).unwrap(), b"second");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    }
}
