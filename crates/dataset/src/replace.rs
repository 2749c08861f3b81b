//! Files that are whole or untouched, whatever happens while they are written.

use std::ffi::OsString;
use std::fs::{self, File};
use std::io::{self, BufWriter};
use std::path::{Path, PathBuf};

use crate::DatasetError;

/// Where a file is written before it is renamed to `path`.
pub(crate) fn part(path: &Path) -> PathBuf {
    let mut part = OsString::from(path);
    part.push(".part");
    part.into()
}

/// The folder that `path` lies in.
pub(crate) fn folder(path: &Path) -> &Path {
    path.parent()
        .filter(|folder| !folder.as_os_str().is_empty())
        .unwrap_or(Path::new("."))
}

/// Writes a file beside `path`, syncs and renames it; its folders are made.
///
/// # Errors
/// Those of `fill`, and what the system refuses; nothing is left beside `path` then.
pub(crate) fn file(
    path: &Path,
    fill: impl FnOnce(&mut BufWriter<File>) -> Result<(), DatasetError>,
) -> Result<(), DatasetError> {
    let failed = |source: io::Error| io_error(path, source);
    fs::create_dir_all(folder(path)).map_err(failed)?;
    let part = part(path);
    let written = create(&part, path, fill).and_then(|()| {
        fs::rename(&part, path)
            .and_then(|()| sync(folder(path)))
            .map_err(failed)
    });
    if written.is_err() {
        // The part is of no use to anyone; that it cannot be removed changes nothing.
        let _ = fs::remove_file(part);
    }
    written
}

/// Writes and syncs a new file at `part`; errors name `path`.
pub(crate) fn create(
    part: &Path,
    path: &Path,
    fill: impl FnOnce(&mut BufWriter<File>) -> Result<(), DatasetError>,
) -> Result<(), DatasetError> {
    let mut writer = BufWriter::new(File::create(part).map_err(|error| io_error(path, error))?);
    fill(&mut writer)?;
    writer
        .into_inner()
        .map_err(io::IntoInnerError::into_error)
        .and_then(|file| file.sync_all())
        .map_err(|error| io_error(path, error))
}

/// A new name outlasts a crash only once its folder is synced.
pub(crate) fn sync(folder: &Path) -> io::Result<()> {
    File::open(folder)?.sync_all()
}

/// What the system refused about a file.
pub(crate) fn io_error(path: &Path, source: io::Error) -> DatasetError {
    DatasetError::Io {
        path: path.to_path_buf(),
        source,
    }
}
