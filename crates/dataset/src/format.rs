//! The formats, and which of them a path holds.

use std::fmt;
use std::fs;
use std::path::Path;

use crate::hdf5::Reader;
use crate::replace::io_error;
use crate::{Dataset, DatasetError, d4rl, minari, ogbench};

/// How a data set lies on disk.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Format {
    /// One HDF5 file of flat arrays: [`d4rl`].
    D4rl,
    /// An HDF5 file with a group for each episode, in a folder with metadata: [`minari`].
    Minari,
    /// Flat arrays in a zip archive: [`ogbench`].
    Ogbench,
}

impl fmt::Display for Format {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::D4rl => "D4RL HDF5",
            Self::Minari => "Minari",
            Self::Ogbench => "OGBench npz",
        })
    }
}

impl Format {
    /// Writes a data set; `path` is whole or untouched. For what each format cannot hold see
    /// [`d4rl::write`], [`minari::write`] and [`ogbench::write`].
    ///
    /// # Errors
    /// What the system or the format refuses.
    pub fn write(self, path: &Path, data: &Dataset) -> Result<(), DatasetError> {
        match self {
            Self::D4rl => d4rl::write(path, data),
            Self::Minari => minari::write(path, data),
            Self::Ogbench => ogbench::write(path, data),
        }
    }
}

/// Reads a data set of any format and says which it is. The content tells, not the name: a folder
/// is Minari's, a zip archive OGBench's, an HDF5 file Minari's if it has groups `episode_0` and so
/// on, else D4RL's.
///
/// # Errors
/// A path of no known format, and anything that is wrong with it, by key and row.
pub fn open(path: &Path) -> Result<(Format, Dataset), DatasetError> {
    if path.is_dir() {
        return Ok((Format::Minari, minari::read(path)?));
    }
    let bytes = fs::read(path).map_err(|error| io_error(path, error))?;
    // Every zip archive begins with an entry, or with its end when there is none.
    if bytes.starts_with(b"PK\x03\x04") || bytes.starts_with(b"PK\x05\x06") {
        return Ok((Format::Ogbench, ogbench::read_bytes(path, &bytes)?));
    }
    if !hdf5_pure::is_hdf5_bytes(&bytes) {
        return Err(DatasetError::Format {
            path: path.to_path_buf(),
            reason: "neither HDF5 (D4RL, Minari) nor npz (OGBench)".to_owned(),
        });
    }
    let reader = Reader::open(path, bytes)?;
    let folders = reader.folders()?;
    if folders
        .iter()
        .any(|folder| folder.number("episode_").is_some())
    {
        return Ok((Format::Minari, minari::from_reader(&reader, None)?));
    }
    Ok((Format::D4rl, d4rl::from_reader(&reader)?))
}
