//! Creates and locks a run's folder.

use std::fs::{self, DirBuilder, File, OpenOptions};
use std::os::unix::fs::{DirBuilderExt, OpenOptionsExt};
use std::path::{Path, PathBuf};

use anyhow::Context;
use config::Config;
use rustix::fs::{Access, access};

use crate::file;
use crate::inputs::Inputs;
use crate::latest;

/// A run's folder, locked by one launcher.
pub struct RunFolder {
    /// Path of the folder.
    pub path: PathBuf,
    /// The locked file.
    _lock: File,
}

impl RunFolder {
    /// The folder of a run that exists, with its [lock](lock).
    pub fn new(path: PathBuf, lock: File) -> Self {
        Self { path, _lock: lock }
    }
}

/// Creates `runs/NAME`, or `runs/NAME-2` and so on if there is one, with its config, and points
/// `runs/latest` to it. Only the owner may read it.
///
/// # Errors
/// Cannot create, lock or write the folder.
pub fn create(config: &Config) -> anyhow::Result<RunFolder> {
    let all = Path::new("runs");
    fs::create_dir_all(all).context("making the folder 'runs'")?;
    let mut private = DirBuilder::new();
    private.mode(0o700);
    let mut number = 1;
    let path = loop {
        let name = match number {
            1 => config.run.name.clone(),
            _ => format!("{}-{number}", config.run.name),
        };
        let folder = all.join(name);
        match private.create(&folder) {
            Ok(()) => break folder,
            Err(error) if error.kind() == std::io::ErrorKind::AlreadyExists => number += 1,
            Err(error) => return Err(error).context(format!("making {}", folder.display())),
        }
    };
    let lock = lock(&path)?;
    make_parts(&path)?;
    write_config(config, &path)?;
    Inputs::record(config, &path)?;
    if let Some(problem) = latest::point(&path) {
        log::warn!("{problem}");
    }
    Ok(RunFolder::new(path, lock))
}

/// Creates the subfolders that are missing.
///
/// # Errors
/// Cannot create or write one of them.
pub fn make_parts(folder: &Path) -> anyhow::Result<()> {
    let mut private = DirBuilder::new();
    private.mode(0o700);
    for part in ["checkpoints", "logs", "traces"] {
        let path = folder.join(part);
        if !path.is_dir() {
            private
                .create(&path)
                .with_context(|| format!("making {}", path.display()))?;
        }
        access(&path, Access::WRITE_OK | Access::EXEC_OK)
            .with_context(|| format!("{} cannot be written in", path.display()))?;
    }
    Ok(())
}

/// Path of the config that the checkpoints belong to.
pub fn made(folder: &Path) -> PathBuf {
    folder.join("checkpoints").join("config.toml")
}

/// Writes a run's config, and the copy that its checkpoints belong to.
///
/// # Errors
/// Cannot write a file.
pub fn write_config(config: &Config, folder: &Path) -> anyhow::Result<()> {
    for path in [folder.join("config.toml"), made(folder)] {
        let text = config.resolved().as_bytes();
        // An unchanged file is not touched.
        if !fs::read(&path).is_ok_and(|bytes| bytes == text) {
            file::write(&path, text)?;
        }
    }
    Ok(())
}

/// Locks a run's folder.
///
/// # Errors
/// Another launcher holds the lock, or it cannot be opened.
pub fn lock(folder: &Path) -> anyhow::Result<File> {
    let path = folder.join("lock");
    let lock = OpenOptions::new()
        .write(true)
        .create(true)
        .truncate(false)
        .mode(0o600)
        .open(&path)
        .with_context(|| format!("opening {}", path.display()))?;
    match lock.try_lock() {
        Ok(()) => Ok(lock),
        Err(fs::TryLockError::WouldBlock) => anyhow::bail!(
            "the run in {0} is alive; `formica actor --attach {0}` joins it",
            folder.display()
        ),
        Err(fs::TryLockError::Error(error)) => {
            Err(error).with_context(|| format!("locking {}", path.display()))
        }
    }
}
