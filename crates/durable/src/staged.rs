//! Outputs that are written and not yet in their place.

use std::collections::BTreeSet;
use std::fs::{self, File, Permissions};
use std::io::{self, BufWriter};
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use rustix::fs::{CWD, RenameFlags, renameat_with};
use rustix::io::Errno;
use tempfile::{Builder, NamedTempFile, TempDir};

use crate::existing;
use crate::output::{Existing, Output, OutputError, folder};

/// What names of staged outputs begin and end with; between them stands a random word.
const NAME: (&str, &str) = (".formica-", ".part");

/// All that this process has staged and neither placed nor dropped.
static STAGED: Mutex<BTreeSet<PathBuf>> = Mutex::new(BTreeSet::new());

/// Removes all that this process has staged: for an exit that drops nothing, such as one by a
/// signal.
pub fn discard_staged() {
    let staged = std::mem::take(&mut *STAGED.lock().unwrap_or_else(PoisonError::into_inner));
    for path in staged {
        // It is a file or a folder, and of no use to anyone.
        let _ = fs::remove_file(&path).or_else(|_| fs::remove_dir_all(&path));
    }
}

/// An output that is written and synced, under a name of its own beside its place. Dropped, it
/// leaves nothing behind.
#[derive(Debug)]
pub struct Staged {
    output: Output,
    written: Written,
    /// Folders that were made for it, the deepest last; removed with it.
    made: Vec<PathBuf>,
    placed: bool,
}

#[derive(Debug)]
enum Written {
    File(NamedTempFile),
    Folder(TempDir),
}

impl Written {
    fn path(&self) -> &Path {
        match self {
            Self::File(file) => file.path(),
            Self::Folder(folder) => folder.path(),
        }
    }
}

impl Output {
    /// Writes a file and syncs it. Folders that are missing around it are made.
    ///
    /// # Errors
    /// Those of `fill`, and what the system refuses; nothing is left behind then.
    pub fn stage<E: From<OutputError>>(
        &self,
        fill: impl FnOnce(&mut BufWriter<File>) -> Result<(), E>,
    ) -> Result<Staged, E> {
        let staged = self.begin(|within| {
            // As others are: the user's mask takes away what it takes from all files.
            let anyone = Permissions::from_mode(0o666);
            let mut builder = Builder::new();
            builder.prefix(NAME.0).suffix(NAME.1).permissions(anyone);
            builder.tempfile_in(within).map(Written::File)
        })?;
        if let Written::File(file) = &staged.written {
            let file = file.as_file().try_clone().map_err(|error| self.io(error))?;
            let mut writer = BufWriter::new(file);
            fill(&mut writer)?;
            writer
                .into_inner()
                .map_err(io::IntoInnerError::into_error)
                .and_then(|file| file.sync_all())
                .map_err(|error| self.io(error))?;
        }
        Ok(staged)
    }

    /// Makes a folder; `fill` writes its files and syncs them.
    ///
    /// # Errors
    /// Those of `fill`, and what the system refuses; nothing is left behind then.
    pub fn stage_folder<E: From<OutputError>>(
        &self,
        fill: impl FnOnce(&Path) -> Result<(), E>,
    ) -> Result<Staged, E> {
        let staged = self.begin(|within| {
            let anyone = Permissions::from_mode(0o777);
            let mut builder = Builder::new();
            builder.prefix(NAME.0).suffix(NAME.1).permissions(anyone);
            builder.tempdir_in(within).map(Written::Folder)
        })?;
        fill(staged.written.path())?;
        sync(staged.written.path()).map_err(|error| self.io(error))?;
        Ok(staged)
    }

    fn begin(
        &self,
        make: impl FnOnce(&Path) -> io::Result<Written>,
    ) -> Result<Staged, OutputError> {
        let within = folder(&self.target);
        let missing = |folder: &&Path| !folder.as_os_str().is_empty() && !folder.exists();
        let mut made: Vec<PathBuf> = within
            .ancestors()
            .take_while(missing)
            .map(Into::into)
            .collect();
        made.reverse();
        let begun = fs::create_dir_all(within).and_then(|()| make(within));
        let written = begun.map_err(|error| {
            remove_empty(&made);
            self.io(error)
        })?;
        let mut staged = STAGED.lock().unwrap_or_else(PoisonError::into_inner);
        staged.insert(written.path().to_path_buf());
        Ok(Staged {
            output: self.clone(),
            written,
            made,
            placed: false,
        })
    }
}

impl Staged {
    /// Puts the output in its place, in one step.
    ///
    /// # Errors
    /// Something appeared there meanwhile, and what the system refuses; nothing is changed then.
    pub fn place(mut self) -> Result<(), OutputError> {
        let output = &self.output;
        let target = &output.target;
        match output.look() {
            Err(OutputError::Exists(path)) => return Err(OutputError::Appeared(path)),
            looked => looked?,
        }
        let from = self.written.path();
        let there = fs::symlink_metadata(target);
        let placed = match (&there, output.existing) {
            (Ok(there), Existing::Replace) if there.is_dir() => exchange(output, from),
            (Ok(there), Existing::Replace) => fs::set_permissions(from, there.permissions())
                .and_then(|()| fs::rename(from, target))
                .map_err(|error| output.io(error)),
            _ => fresh(output, from),
        };
        placed?;
        self.placed = true;
        // A new name outlasts a loss of power only once its folder is synced.
        sync(folder(target)).map_err(|error| output.io(error))
    }
}

impl Drop for Staged {
    fn drop(&mut self) {
        let mut staged = STAGED.lock().unwrap_or_else(PoisonError::into_inner);
        staged.remove(self.written.path());
        drop(staged);
        match &mut self.written {
            // What now has the name is another's.
            Written::File(file) if self.placed => file.disable_cleanup(true),
            Written::Folder(folder) if self.placed => folder.disable_cleanup(true),
            Written::File(_) => {
                let _ = fs::remove_file(self.written.path());
            }
            Written::Folder(_) => {
                let _ = fs::remove_dir_all(self.written.path());
            }
        }
        if !self.placed {
            remove_empty(&self.made);
        }
    }
}

/// Moves to a place where nothing is.
fn fresh(output: &Output, from: &Path) -> Result<(), OutputError> {
    match renameat_with(CWD, from, CWD, &output.target, RenameFlags::NOREPLACE) {
        Ok(()) => Ok(()),
        Err(Errno::EXIST | Errno::NOTEMPTY) => Err(OutputError::Appeared(output.path.clone())),
        // Some file systems, of networks above all, cannot do it in one step. A second name for a
        // file is refused where the name is taken, and so is a folder where one that is not empty is.
        Err(Errno::INVAL | Errno::NOSYS | Errno::NOTSUP) => {
            let moved = if from.is_dir() {
                fs::rename(from, &output.target)
            } else {
                fs::hard_link(from, &output.target).and_then(|()| fs::remove_file(from))
            };
            moved.map_err(|error| match error.kind() {
                io::ErrorKind::AlreadyExists | io::ErrorKind::DirectoryNotEmpty => {
                    OutputError::Appeared(output.path.clone())
                }
                _ => output.io(error),
            })
        }
        Err(error) => Err(output.io(error.into())),
    }
}

/// Changes places with a folder, which is removed then: it holds what outputs like this one hold.
fn exchange(output: &Output, from: &Path) -> Result<(), OutputError> {
    let swap = || renameat_with(CWD, from, CWD, &output.target, RenameFlags::EXCHANGE);
    swap().map_err(|error| output.io(error.into()))?;
    // Looked at again now that nobody finds it by its name.
    let holds = output.holds.unwrap_or_default();
    if existing::only(from, holds).unwrap_or(false) {
        return fs::remove_dir_all(from).map_err(|error| output.io(error));
    }
    swap().map_err(|error| output.io(error.into()))?;
    Err(OutputError::Foreign(output.path.clone()))
}

/// Removes folders that were made and are empty.
fn remove_empty(made: &[PathBuf]) {
    for folder in made.iter().rev() {
        let _ = fs::remove_dir(folder);
    }
}

fn sync(folder: &Path) -> io::Result<()> {
    File::open(folder)?.sync_all()
}
