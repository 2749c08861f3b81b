//! Files of a run's folder, read and written with messages that name them.

use std::fs;
use std::io::ErrorKind;
use std::path::Path;

use anyhow::Context;

/// A file's bytes; `None` if there is no such file.
///
/// # Errors
/// Cannot read the file.
pub fn read(path: &Path) -> anyhow::Result<Option<Vec<u8>>> {
    match fs::read(path) {
        Ok(bytes) => Ok(Some(bytes)),
        Err(error) if error.kind() == ErrorKind::NotFound => Ok(None),
        Err(error) => Err(error).with_context(|| reading(path)),
    }
}

/// Writes a file completely or not at all.
///
/// # Errors
/// Cannot write the file.
pub fn write(path: &Path, bytes: &[u8]) -> anyhow::Result<()> {
    durable::write(path, bytes).with_context(|| format!("writing {}", path.display()))
}

/// Context of an error in reading a file.
pub(crate) fn reading(path: &Path) -> String {
    format!("reading {}", path.display())
}
