//! A run's folder.

use std::fs::{self, File};
use std::io::Write;
use std::path::{Path, PathBuf};

use anyhow::Context;
use config::Config;

/// Makes `runs/NAME`, or `runs/NAME-2` and so on where there is one, with its config, and points
/// `runs/latest` to it.
pub(crate) fn create(config: &Config) -> anyhow::Result<PathBuf> {
    let runs = Path::new("runs");
    fs::create_dir_all(runs).context("making the folder 'runs'")?;
    let mut number = 1;
    let folder = loop {
        let name = match number {
            1 => config.run.name.clone(),
            _ => format!("{}-{number}", config.run.name),
        };
        let folder = runs.join(name);
        match fs::create_dir(&folder) {
            Ok(()) => break folder,
            Err(error) if error.kind() == std::io::ErrorKind::AlreadyExists => number += 1,
            Err(error) => return Err(error).context(format!("making {}", folder.display())),
        }
    };
    for part in ["checkpoints", "logs", "traces"] {
        fs::create_dir(folder.join(part))?;
    }
    write_whole(&folder.join("config.toml"), config.resolved().as_bytes())?;
    let link = runs.join("latest");
    let _ = fs::remove_file(&link);
    if let Some(name) = folder.file_name() {
        let _ = std::os::unix::fs::symlink(name, &link);
    }
    Ok(folder)
}

/// Writes a file beside, syncs and renames: it is there whole or not at all.
pub(crate) fn write_whole(path: &Path, bytes: &[u8]) -> anyhow::Result<()> {
    let part = path.with_extension("part");
    let write = || {
        let mut file = File::create(&part)?;
        file.write_all(bytes)?;
        file.sync_all()?;
        fs::rename(&part, path)
    };
    write().with_context(|| format!("writing {}", path.display()))
}
