//! Outputs that a user names: looked at before the work, put in place after it.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use rustix::fs::{Access, access};

use crate::existing::{self, Inputs};

/// Symbolic links that lead from one to the next, at most; as many as Linux follows.
const LINKS: usize = 40;

/// What becomes of something that is there already.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Existing {
    /// It is left, and the output refused.
    Refuse,
    /// A file is replaced, and a folder that holds nothing but what an output like this one holds.
    Replace,
}

/// Why an output is refused or failed.
#[derive(Debug, thiserror::Error)]
pub enum OutputError {
    /// Something is there.
    #[error("{path} is there already; --force replaces it", path = .0.display())]
    Exists(PathBuf),
    /// It was not there when the work began.
    #[error("{path} was made by another process meanwhile, and is left as it is", path = .0.display())]
    Appeared(PathBuf),
    /// It is what is read.
    #[error(
        "{path} is the input {input} itself; name another output",
        path = .path.display(), input = .input.display()
    )]
    Input {
        /// The output.
        path: PathBuf,
        /// The input.
        input: PathBuf,
    },
    /// A folder, device, pipe or socket where a file goes, or a file where a folder goes.
    #[error("{path} is {found}; name {wanted} to write", path = .path.display())]
    Kind {
        /// The output.
        path: PathBuf,
        /// What it is.
        found: &'static str,
        /// What it should be.
        wanted: &'static str,
    },
    /// A folder that holds files of other kinds.
    #[error(
        "{path} holds other files too, so it is not replaced; name another folder",
        path = .0.display()
    )]
    Foreign(PathBuf),
    /// A path without a last part.
    #[error("'{path}' names nothing that can be written", path = .0.display())]
    Nameless(PathBuf),
    /// The system refused.
    #[error("{path} cannot be written: {source}", path = .path.display())]
    Io {
        /// The output, or the folder that it goes to.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
}

/// Where an output goes. Making one looks at what is there and changes nothing, so that a command
/// is refused before its work and not after it; [`Output::stage`] and [`Output::stage_folder`]
/// write, beside the place, and [`crate::Staged::place`] puts what was written in it.
///
/// A symbolic link is followed: what it leads to is what is written, and the link stays.
#[derive(Debug, Clone)]
pub struct Output {
    /// As the user named it, for messages.
    pub(crate) path: PathBuf,
    /// Where it is, all links followed.
    pub(crate) target: PathBuf,
    pub(crate) existing: Existing,
    /// Files that a folder of this kind holds, by their path in it; none for a file.
    pub(crate) holds: Option<&'static [&'static str]>,
}

impl Output {
    /// A file. `inputs` are files and folders that the command reads, which no output replaces.
    ///
    /// # Errors
    /// Something is there and is not to be replaced, or cannot be; the folder cannot be written to.
    pub fn file(path: &Path, existing: Existing, inputs: &[&Path]) -> Result<Self, OutputError> {
        Self::new(path, existing, inputs, None)
    }

    /// A folder of the files `holds`, by their path in it.
    ///
    /// # Errors
    /// Those of [`Output::file`]; a folder that is to be replaced holds other files, too.
    pub fn folder(
        path: &Path,
        existing: Existing,
        inputs: &[&Path],
        holds: &'static [&'static str],
    ) -> Result<Self, OutputError> {
        Self::new(path, existing, inputs, Some(holds))
    }

    fn new(
        path: &Path,
        existing: Existing,
        inputs: &[&Path],
        holds: Option<&'static [&'static str]>,
    ) -> Result<Self, OutputError> {
        // Without slashes and dots at its end.
        let named: PathBuf = path.components().collect();
        if named.file_name().is_none() {
            return Err(OutputError::Nameless(path.to_path_buf()));
        }
        // What has no path of its own, such as the pipe behind /dev/stdout, is seen from here alone.
        if let Ok(there) = fs::metadata(&named)
            && !there.is_file()
            && !there.is_dir()
        {
            return Err(OutputError::Kind {
                path: named,
                found: existing::kind(&there),
                wanted: if holds.is_some() {
                    "a folder"
                } else {
                    "a file"
                },
            });
        }
        let output = Self {
            target: followed(&named).map_err(|error| io_error(&named, error))?,
            path: named,
            existing,
            holds,
        };
        if let Some(input) = Inputs::of(inputs).replaced_by(&output.target) {
            return Err(OutputError::Input {
                input: input.to_path_buf(),
                path: output.path,
            });
        }
        output.look()?;
        output.writable()?;
        Ok(output)
    }

    /// The path, as the user named it.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Refuses what is there, if it may not or cannot be replaced.
    pub(crate) fn look(&self) -> Result<(), OutputError> {
        let there = match fs::symlink_metadata(&self.target) {
            Ok(there) => there,
            Err(error) if absent(&error) => return Ok(()),
            Err(error) => return Err(io_error(&self.path, error)),
        };
        let wanted = match self.holds {
            None => "a file",
            Some(_) => "a folder",
        };
        let found = existing::kind(&there);
        if found != wanted {
            return Err(OutputError::Kind {
                path: self.path.clone(),
                found,
                wanted,
            });
        }
        if self.existing == Existing::Refuse {
            return Err(OutputError::Exists(self.path.clone()));
        }
        match self.holds {
            Some(holds) if !existing::only(&self.target, holds).map_err(|e| self.io(e))? => {
                Err(OutputError::Foreign(self.path.clone()))
            }
            _ => Ok(()),
        }
    }

    /// Refuses a folder that cannot be written to. Folders that are missing are made later.
    fn writable(&self) -> Result<(), OutputError> {
        let mut folder = folder(&self.target);
        loop {
            match fs::metadata(folder) {
                Ok(there) if !there.is_dir() => {
                    return Err(OutputError::Kind {
                        path: folder.to_path_buf(),
                        found: existing::kind(&there),
                        wanted: "a path within a folder",
                    });
                }
                Ok(_) => break,
                Err(error) if absent(&error) => {
                    folder = self::folder(folder);
                }
                Err(error) => return Err(io_error(folder, error)),
            }
        }
        access(folder, Access::WRITE_OK | Access::EXEC_OK)
            .map_err(|error| io_error(folder, error.into()))
    }

    /// What the system refused about it.
    pub(crate) fn io(&self, source: io::Error) -> OutputError {
        io_error(&self.path, source)
    }
}

fn io_error(path: &Path, source: io::Error) -> OutputError {
    OutputError::Io {
        path: path.to_path_buf(),
        source,
    }
}

/// Whether nothing is there, or a part of the path is no folder.
fn absent(error: &io::Error) -> bool {
    matches!(
        error.kind(),
        io::ErrorKind::NotFound | io::ErrorKind::NotADirectory
    )
}

/// The path that symbolic links lead to, there or not.
fn followed(path: &Path) -> io::Result<PathBuf> {
    let mut path = path.to_path_buf();
    for _ in 0..LINKS {
        match fs::read_link(&path) {
            Ok(to) => path = folder(&path).join(to).components().collect(),
            // No link, or nothing at all.
            Err(_) => return Ok(path),
        }
    }
    Err(rustix::io::Errno::LOOP.into())
}

/// The folder that a path lies in.
pub(crate) fn folder(path: &Path) -> &Path {
    path.parent()
        .filter(|folder| !folder.as_os_str().is_empty())
        .unwrap_or(Path::new("."))
}
