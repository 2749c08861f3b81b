//! A run's folder.

use std::fs::{self, DirBuilder, File, OpenOptions};
use std::io::Write;
use std::os::unix::fs::{DirBuilderExt, OpenOptionsExt};
use std::path::{Path, PathBuf};

use anyhow::Context;
use config::Config;
use rustix::fs::{Access, access};

use crate::inputs::Inputs;
use crate::runs;

/// A run's folder, which one launcher at a time works in.
pub(crate) struct RunFolder {
    pub(crate) path: PathBuf,
    /// Held locked.
    pub(crate) _lock: File,
}

/// Makes `runs/NAME`, or `runs/NAME-2` and so on where there is one, with its config, and points
/// `runs/latest` to it. Its owner alone may read it.
pub(crate) fn create(config: &Config) -> anyhow::Result<RunFolder> {
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
    Inputs::note(config, &path)?;
    if let Some(told) = runs::point(&path) {
        let _ = writeln!(std::io::stderr(), "formica: {told}");
    }
    Ok(RunFolder { path, _lock: lock })
}

/// The parts of a run's folder, made where they are missing.
pub(crate) fn make_parts(folder: &Path) -> anyhow::Result<()> {
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

/// Where the config that a run's states were made with is kept.
pub(crate) fn made(folder: &Path) -> PathBuf {
    folder.join("checkpoints").join("config.toml")
}

/// Writes a run's config, and that its states are made with it.
pub(crate) fn write_config(config: &Config, folder: &Path) -> anyhow::Result<()> {
    for path in [folder.join("config.toml"), made(folder)] {
        let text = config.resolved().as_bytes();
        // What is the same stays untouched.
        if !fs::read(&path).is_ok_and(|bytes| bytes == text) {
            write(&path, text)?;
        }
    }
    Ok(())
}

pub(crate) fn lock(folder: &Path) -> anyhow::Result<File> {
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

/// Writes a file whole or not at all.
pub(crate) fn write(path: &Path, bytes: &[u8]) -> anyhow::Result<()> {
    durable::write(path, bytes).with_context(|| format!("writing {}", path.display()))
}
