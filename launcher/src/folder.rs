//! A run's folder.

use std::fs::{self, DirBuilder, File, OpenOptions};
use std::os::unix::fs::{DirBuilderExt, MetadataExt, OpenOptionsExt};
use std::path::{Path, PathBuf};

use anyhow::Context;
use config::Config;

use crate::recorded;

/// A run's folder, which one launcher at a time works in.
pub(crate) struct RunFolder {
    pub(crate) path: PathBuf,
    /// Held locked.
    _lock: File,
}

/// Makes `runs/NAME`, or `runs/NAME-2` and so on where there is one, with its config, and points
/// `runs/latest` to it. Its owner alone may read it.
pub(crate) fn create(config: &Config) -> anyhow::Result<RunFolder> {
    let runs = Path::new("runs");
    fs::create_dir_all(runs).context("making the folder 'runs'")?;
    let mut private = DirBuilder::new();
    private.mode(0o700);
    let mut number = 1;
    let path = loop {
        let name = match number {
            1 => config.run.name.clone(),
            _ => format!("{}-{number}", config.run.name),
        };
        let folder = runs.join(name);
        match private.create(&folder) {
            Ok(()) => break folder,
            Err(error) if error.kind() == std::io::ErrorKind::AlreadyExists => number += 1,
            Err(error) => return Err(error).context(format!("making {}", folder.display())),
        }
    };
    let lock = lock(&path)?;
    for part in ["checkpoints", "logs", "traces"] {
        private.create(path.join(part))?;
    }
    write(&path.join("config.toml"), config.resolved().as_bytes())?;
    point(runs, &path);
    Ok(RunFolder { path, _lock: lock })
}

/// The folder of a run that was stopped, by its name or path, and its config.
pub(crate) fn reopen(name: &str) -> anyhow::Result<(RunFolder, Config)> {
    let path = recorded::find(Path::new(name))?;
    // Not as a link that may come to point elsewhere.
    let path = fs::canonicalize(&path)
        .ok()
        .and_then(|whole| {
            let here = std::env::current_dir().ok()?;
            whole.strip_prefix(here).ok().map(Path::to_path_buf)
        })
        .unwrap_or(path);
    let (owner, own) = (
        fs::metadata(&path)?.uid(),
        rustix::process::getuid().as_raw(),
    );
    anyhow::ensure!(
        owner == own,
        "the run in {} belongs to the user with number {owner}, this is number {own}",
        path.display()
    );
    let config = Config::load(&path.join("config.toml"), &[])?;
    let lock = lock(&path)?;
    if let Some(runs) = path.parent().filter(|runs| runs.ends_with("runs")) {
        point(runs, &path);
    }
    Ok((RunFolder { path, _lock: lock }, config))
}

fn lock(folder: &Path) -> anyhow::Result<File> {
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

/// Points `latest` to a run.
fn point(runs: &Path, folder: &Path) {
    let link = runs.join("latest");
    let _ = fs::remove_file(&link);
    if let Some(name) = folder.file_name() {
        let _ = std::os::unix::fs::symlink(name, &link);
    }
}

/// Writes a file whole or not at all.
pub(crate) fn write(path: &Path, bytes: &[u8]) -> anyhow::Result<()> {
    durable::write(path, bytes).with_context(|| format!("writing {}", path.display()))
}
