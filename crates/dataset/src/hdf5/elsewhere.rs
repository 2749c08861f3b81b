//! Other files that a file's links lead to.

use std::collections::HashMap;
use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use hdf5_reader::error::{Error, Result};
use hdf5_reader::storage::FileStorage;
use hdf5_reader::{ExternalLinkResolver, Hdf5File};

use super::options::options;

/// What errors begin with.
pub(super) const LINK: &str = "is a link";

/// Opens the files that links lead to, each once. Links in those are followed within the same file
/// alone.
pub(super) struct Elsewhere {
    /// Where the linking file lies.
    folder: PathBuf,
    opened: Mutex<HashMap<PathBuf, Hdf5File>>,
    /// Bytes of all of them.
    length: Arc<AtomicU64>,
}

impl Elsewhere {
    /// For the links of the file `path`; `length` is added to.
    pub(super) fn of(path: &Path, length: Arc<AtomicU64>) -> Self {
        // HDF5 takes the folder of the file itself, not of a link to it.
        let path = fs::canonicalize(path).unwrap_or_else(|_| path.to_path_buf());
        Self {
            folder: path.parent().unwrap_or(Path::new("")).to_path_buf(),
            opened: Mutex::default(),
            length,
        }
    }

    /// The folder that links are looked for in.
    pub(super) fn folder(&self) -> &Path {
        &self.folder
    }

    fn open(&self, name: &str, path: &Path) -> Result<Hdf5File> {
        let told = |reason: &dyn std::fmt::Display| {
            Error::Other(format!("{LINK} into the file {name}: {reason}"))
        };
        let path = fs::canonicalize(path).map_err(|error| told(&error))?;
        let mut opened = self.opened.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(file) = opened.get(&path) {
            return Ok(file.clone());
        }
        // Opening a pipe would wait for a writer.
        if !path.is_file() {
            return Err(told(&"it is not a file"));
        }
        let file = File::open(&path).map_err(|error| told(&error))?;
        let storage = FileStorage::from_file(file)?;
        let length = hdf5_reader::Storage::len(&storage);
        let options = options(length);
        let file = Hdf5File::from_storage_with_options(Arc::new(storage), options)
            .map_err(|error| told(&error))?;
        self.length.fetch_add(length, Ordering::Relaxed);
        opened.insert(path, file.clone());
        Ok(file)
    }
}

impl ExternalLinkResolver for Elsewhere {
    fn resolve_external_link(&self, name: &str) -> Result<Option<Hdf5File>> {
        // An absolute path that is gone is looked for beside the linking file, as HDF5 does.
        let given = self.folder.join(name);
        let named = Path::new(name);
        let absolute = named.file_name().filter(|_| named.is_absolute());
        let beside = absolute.map(|name| self.folder.join(name));
        let path = match beside {
            Some(beside) if !given.exists() && beside.exists() => beside,
            _ => given,
        };
        self.open(name, &path).map(Some)
    }
}
