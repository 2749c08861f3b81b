//! Files of flat arrays that are read by mapping them, so that all processes of a machine share one
//! copy in memory.
//!
//! Layout: magic (8 bytes), format (u32), checksum (CRC-32 of the length and the description, u32),
//! length of the description (u64), all little-endian; the description, as postcard writes it; then
//! the arrays in the machine's own byte order, each at a multiple of 64 bytes. A file belongs to the
//! machine that wrote it.
//!
//! A file is written beside its place and renamed, never changed in place. Its length is compared
//! with the description before it is mapped, so that no access goes beyond its end.

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

/// Why a mapped file could not be written or used.
#[derive(Debug, thiserror::Error)]
pub enum MappedError {
    /// The system refused to write it.
    #[error(
        "{path} cannot be written: {source}; it takes {megabytes} MB, make room for them or start the \
         run on another disk",
        path = .path.display(), megabytes = .bytes.div_ceil(1_000_000)
    )]
    Write {
        /// The file.
        path: PathBuf,
        /// Its length.
        bytes: u64,
        /// What the system said.
        source: io::Error,
    },
    /// The system refused to read it.
    #[error(
        "{path} cannot be read: {source}; `formica launch --resume` of the run makes it again",
        path = .path.display()
    )]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// Cut off, changed, or of another format.
    #[error(
        "{path} is damaged: {what}; `formica launch --resume` of the run makes it again",
        path = .path.display()
    )]
    Damaged {
        /// The file.
        path: PathBuf,
        /// What shows it.
        what: String,
    },
}

/// An array to write: its name, the size of a value and the values.
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

/// Writes a file of a kind, whole or not at all, with what is to be known about its arrays.
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

/// A file that is mapped.
#[derive(Debug)]
pub(crate) struct Mapped {
    path: PathBuf,
    map: Arc<Mmap>,
    description: Description,
}

impl Mapped {
    /// Opens a file of a kind.
    pub(crate) fn open(path: &Path, kind: &str) -> Result<Self, MappedError> {
        let refused = |source| MappedError::Read {
            path: path.to_path_buf(),
            source,
        };
        let damaged = |what| MappedError::Damaged {
            path: path.to_path_buf(),
            what,
        };
        // Opening a pipe would wait for a writer.
        if !fs::metadata(path).map_err(refused)?.is_file() {
            return Err(damaged("it is not a file".to_owned()));
        }
        let mut file = File::open(path).map_err(refused)?;
        let length = file.metadata().map_err(refused)?.len();
        let description = header::read(&mut file, length)
            .map_err(refused)?
            .map_err(damaged)?;
        if description.kind != kind {
            return Err(damaged(format!("it holds '{}'", description.kind)));
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

    /// What was to be known about its arrays.
    pub(crate) fn about<T: DeserializeOwned>(&self) -> Result<T, MappedError> {
        postcard::from_bytes(&self.description.about)
            .map_err(|_| self.damaged("it holds another kind of description"))
    }

    /// An array, by its name.
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

/// Maps a file, to be read alone.
#[allow(unsafe_code)]
pub(crate) fn map(file: &File) -> io::Result<Mmap> {
    // SAFETY: the bytes must not change while they are mapped. Such files lie in a run's folder,
    // which its owner alone may write to; they are replaced by a rename and never changed or cut in
    // place, so that what is mapped stays what it was, also after it was replaced or removed.
    unsafe { Mmap::map(file) }
}
