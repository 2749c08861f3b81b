//! Files of flat arrays, read by mapping them into memory: all processes that map a file share its
//! pages.
//!
//! Layout: magic (8 bytes), format version (u32), CRC-32 of the length and the description (u32),
//! length of the description (u64), all little-endian; the description, encoded with postcard; the
//! arrays in native byte order, each aligned to 64 bytes. The format is private to one machine.
//!
//! A file is written under a temporary name and renamed. It is never modified in place. Its length is
//! checked against the description before it is mapped, so no access can go past its end.

mod header;
#[cfg(test)]
mod tests;

use std::fs::{self, File};
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use bytemuck::Pod;
use memmap2::Mmap;
use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::Array;
use header::{Description, Section};

/// What to do about a file that cannot be written.
fn remedy(source: &io::Error) -> &'static str {
    match source.kind() {
        io::ErrorKind::FileTooLarge => "raise the limit with `ulimit -f`",
        _ => "make room, or start the run on another disk",
    }
}

/// Error from writing or opening a mapped file.
#[derive(Debug, thiserror::Error)]
pub enum MappedError {
    /// The file could not be written.
    #[error(
        "{path} cannot be written: {source}; it needs {megabytes} MB: {remedy}",
        path = .path.display(), megabytes = .bytes.div_ceil(1_000_000), remedy = remedy(.source)
    )]
    Write {
        /// The file.
        path: PathBuf,
        /// Its length.
        bytes: u64,
        /// The system's error.
        source: io::Error,
    },
    /// The file could not be opened, read or mapped.
    #[error(
        "{path} cannot be read: {source}; `formica launch --resume RUN` recreates it",
        path = .path.display()
    )]
    Read {
        /// The file.
        path: PathBuf,
        /// The system's error.
        source: io::Error,
    },
    /// The file is truncated, corrupt, or has another format.
    #[error(
        "{path} is damaged: {what}; `formica launch --resume RUN` recreates it",
        path = .path.display()
    )]
    Damaged {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        what: String,
    },
}

/// An array to write: its name, the size of an element, and the elements as bytes.
pub(crate) struct Values<'a> {
    name: &'static str,
    size: usize,
    bytes: &'a [u8],
}

impl<'a> Values<'a> {
    pub(crate) fn new<T: Pod>(name: &'static str, values: &'a [T]) -> Self {
        Self {
            name,
            size: size_of::<T>(),
            bytes: bytemuck::cast_slice(values),
        }
    }
}

/// Atomically writes a file of the given kind. `about` is metadata for [`Mapped::about`].
pub(crate) fn write(
    path: &Path,
    kind: &str,
    about: &impl Serialize,
    arrays: &[Values<'_>],
) -> Result<(), MappedError> {
    let sizes = arrays
        .iter()
        .map(|array| (array.name, array.size, array.bytes.len()));
    let encoded = header::encode(kind, about, sizes);
    let written = encoded.and_then(|(head, description)| {
        let bytes = description.length;
        let result = durable::write_with(path, |file| {
            file.write_all(&head)?;
            let mut at = head.len() as u64;
            for (array, section) in arrays.iter().zip(&description.sections) {
                pad(file, section.start - at)?;
                file.write_all(array.bytes)?;
                at = section.start + array.bytes.len() as u64;
            }
            pad(file, bytes - at)
        });
        result.map_err(|error| (bytes, error))
    });
    written.map_err(|(bytes, source)| MappedError::Write {
        path: path.to_path_buf(),
        bytes,
        source,
    })
}

fn pad(file: &mut impl Write, count: u64) -> io::Result<()> {
    io::copy(&mut io::Read::take(io::repeat(0), count), file).map(drop)
}

/// A mapped file.
#[derive(Debug)]
pub(crate) struct Mapped {
    path: PathBuf,
    map: Arc<Mmap>,
    description: Description,
}

impl Mapped {
    /// Opens a file of the given kind.
    pub(crate) fn open(path: &Path, kind: &str) -> Result<Self, MappedError> {
        let refused = |source| MappedError::Read {
            path: path.to_path_buf(),
            source,
        };
        let damaged = |what| MappedError::Damaged {
            path: path.to_path_buf(),
            what,
        };
        // Opening a pipe would block until it has a writer.
        if !fs::metadata(path).map_err(refused)?.is_file() {
            return Err(damaged("it is not a file".to_owned()));
        }
        let mut file = File::open(path).map_err(refused)?;
        let length = file.metadata().map_err(refused)?.len();
        let description = header::read(&mut file, length)
            .map_err(refused)?
            .map_err(damaged)?;
        if description.kind != kind {
            return Err(damaged(format!("it contains '{}'", description.kind)));
        }
        Ok(Self {
            path: path.to_path_buf(),
            map: Arc::new(map(&file).map_err(refused)?),
            description,
        })
    }

    pub(crate) fn damaged(&self, what: impl Into<String>) -> MappedError {
        MappedError::Damaged {
            path: self.path.clone(),
            what: what.into(),
        }
    }

    /// The metadata that the file was written with.
    pub(crate) fn about<T: DeserializeOwned>(&self) -> Result<T, MappedError> {
        postcard::from_bytes(&self.description.about)
            .map_err(|_| self.damaged("its metadata cannot be decoded"))
    }

    /// Returns an array by name.
    pub(crate) fn array<T: Pod>(&self, name: &str) -> Result<Array<T>, MappedError> {
        let named = |section: &&Section| section.name == name;
        let section = self.description.sections.iter().find(named);
        let fits = section.filter(|section| section.size == size_of::<T>() as u64);
        let bytes = fits.and_then(Section::bytes);
        bytes
            .and_then(|bytes| Array::mapped(&self.map, bytes))
            .ok_or_else(|| {
                self.damaged(format!("its array '{name}' is missing or of another type"))
            })
    }
}

/// Maps a file read-only.
#[allow(unsafe_code)]
pub(crate) fn map(file: &File) -> io::Result<Mmap> {
    // SAFETY: the mapped bytes must not change. These files are in a run's folder, which only its
    // owner can write to, and are replaced by a rename, never modified or truncated in place. A
    // mapping keeps the old content after a rename or a removal.
    unsafe { Mmap::map(file) }
}
