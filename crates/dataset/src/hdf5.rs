//! Arrays of HDF5 files, believed only as far as the file can bear them out.

use std::path::Path;

use hdf5_pure::{Dataset as Array, Error, File, FormatError, Group};

use crate::{DatasetError, parallel};

/// No deflated byte stands for more than 1032 bytes (zlib's technical notes), so no sound file
/// holds more bytes than this for each of its own.
const INFLATION: u64 = 1032;

/// Rows that one thread decodes at a time, about: whole chunks of them.
const PIECE: usize = 65_536;

/// An open file and what its errors need.
pub(crate) struct Reader<'p> {
    path: &'p Path,
    length: u64,
    file: File,
}

/// Values of a row.
#[derive(Clone, Copy)]
pub(crate) enum Width {
    /// So many.
    Exactly(usize),
    /// So many or more.
    AtLeast(usize),
}

/// A key whose shape is that of the layout.
pub(crate) struct Key {
    name: String,
    array: Array,
    /// Rows.
    pub(crate) rows: usize,
    /// Values of a row.
    pub(crate) width: usize,
}

/// A folder of keys within the file.
pub(crate) struct Folder {
    /// Its path within the file, with a `/` at the end; empty for the root.
    pub(crate) prefix: String,
    group: Group,
}

impl Folder {
    /// The number that its name ends with, after `word`; none for other names.
    pub(crate) fn number(&self, word: &str) -> Option<usize> {
        let digits = self.prefix.strip_prefix(word)?.strip_suffix('/')?;
        // No sign, and one name only for each number.
        let number = digits.parse().ok()?;
        (digits == format!("{number}")).then_some(number)
    }
}

impl<'p> Reader<'p> {
    /// Opens the bytes of a file; `path` is for errors.
    pub(crate) fn open(path: &'p Path, bytes: Vec<u8>) -> Result<Self, DatasetError> {
        let format = |reason: String| DatasetError::Format {
            path: path.to_path_buf(),
            reason,
        };
        let length = bytes.len() as u64;
        let file = File::from_bytes(bytes)
            .map_err(|error| format(format!("not an HDF5 file that can be read: {error}")))?;
        let whole = file.superblock().eof_address;
        if length < whole {
            return Err(format(format!(
                "cut off: {length} of {whole} bytes are there; copy it again"
            )));
        }
        Ok(Self { path, length, file })
    }

    /// The file's root.
    pub(crate) fn root(&self) -> Folder {
        Folder {
            prefix: String::new(),
            group: self.file.root(),
        }
    }

    /// Folders right below the root.
    pub(crate) fn folders(&self) -> Result<Vec<Folder>, DatasetError> {
        let groups = self
            .file
            .root()
            .iter_groups()
            .map_err(|error| self.error("/", error))?;
        Ok(groups
            .map(|(name, group)| Folder {
                prefix: format!("{name}/"),
                group,
            })
            .collect())
    }

    /// An error about a key.
    pub(crate) fn error(&self, key: &str, reason: impl std::fmt::Display) -> DatasetError {
        DatasetError::Key {
            path: self.path.to_path_buf(),
            key: key.to_owned(),
            reason: reason.to_string(),
        }
    }

    /// An error about the whole file.
    pub(crate) fn refuse(&self, reason: impl std::fmt::Display) -> DatasetError {
        DatasetError::Format {
            path: self.path.to_path_buf(),
            reason: reason.to_string(),
        }
    }

    /// A key that must be there, of `rows` rows if those are known. No value is read yet.
    pub(crate) fn key(
        &self,
        folder: &Folder,
        name: &str,
        rows: Option<usize>,
        width: Width,
    ) -> Result<Key, DatasetError> {
        self.optional(folder, name, rows, width)?.ok_or_else(|| {
            self.error(
                &format!("{}{name}", folder.prefix),
                "is missing; the layout has it, is this a file of another kind?",
            )
        })
    }

    /// A key that may be missing. One that is there and damaged is an error all the same.
    pub(crate) fn optional(
        &self,
        folder: &Folder,
        name: &str,
        rows: Option<usize>,
        width: Width,
    ) -> Result<Option<Key>, DatasetError> {
        let array = match folder.group.dataset(name) {
            Ok(array) => array,
            Err(Error::Format(FormatError::PathNotFound(_))) => return Ok(None),
            Err(error) => return Err(self.error(&format!("{}{name}", folder.prefix), error)),
        };
        let name = format!("{}{name}", folder.prefix);
        let shape = array.shape().map_err(|error| self.error(&name, error))?;
        // Rewards come as (n,) and as (n, 1).
        let columns = shape
            .iter()
            .skip(1)
            .try_fold(1_u64, |all, side| all.checked_mul(*side));
        let found = shape.first().copied().unwrap_or(0);
        let columns = columns.filter(|columns| match width {
            Width::Exactly(width) => *columns == width as u64,
            Width::AtLeast(width) => shape.len() == 2 && *columns >= width as u64,
        });
        let columns = columns.and_then(|columns| usize::try_from(columns).ok());
        let fits = !shape.is_empty() && rows.is_none_or(|rows| rows as u64 == found);
        let Some(columns) = columns.filter(|_| fits) else {
            let rows = rows.map_or("n".to_owned(), |rows| rows.to_string());
            return Err(DatasetError::Shape {
                path: self.path.to_path_buf(),
                key: name,
                got: shape,
                expected: match width {
                    Width::Exactly(1) => format!("[{rows}]"),
                    Width::Exactly(width) => format!("[{rows}, {width}]"),
                    Width::AtLeast(width) => format!("[{rows}, {width} or more]"),
                },
            });
        };
        // Believe no length that the file cannot hold: allocation would end the process.
        if found > self.most() / columns.max(1) as u64 {
            let reason = format!("{found} rows are more than {} bytes can hold", self.length);
            return Err(self.error(&name, reason));
        }
        Ok(Some(Key {
            rows: found as usize,
            width: columns,
            name,
            array,
        }))
    }

    /// Values that the file can hold at most, each of a byte or more.
    pub(crate) fn most(&self) -> u64 {
        self.length.saturating_mul(INFLATION)
    }

    /// All values of some keys, whatever their number type; h5py's bools are 0 and 1. Decoded on
    /// all cores.
    pub(crate) fn values<const N: usize>(
        &self,
        keys: [&Key; N],
    ) -> Result<[Vec<f32>; N], DatasetError> {
        let mut arrays = [const { Vec::new() }; N];
        for (key, array) in keys.iter().zip(&mut arrays) {
            *array = zeros(key.rows * key.width).map_err(|error| self.error(&key.name, error))?;
        }
        let mut jobs = vec![];
        for (key, array) in keys.iter().zip(&mut arrays) {
            let piece = self.piece(key)?;
            let slices = array.chunks_mut((piece * key.width).max(1));
            jobs.extend(
                slices
                    .enumerate()
                    .map(|(number, into)| (*key, number * piece, into)),
            );
        }
        parallel::each(jobs, |(key, start, into)| self.rows(key, start, into))?;
        Ok(arrays)
    }

    /// Rows of a piece: whole chunks, so that none is decoded twice.
    fn piece(&self, key: &Key) -> Result<usize, DatasetError> {
        let chunk = self.chunk_rows(key)?;
        Ok(PIECE
            .div_ceil(chunk)
            .saturating_mul(chunk)
            .min(key.rows.max(1)))
    }

    /// Rows of a chunk.
    fn chunk_rows(&self, key: &Key) -> Result<usize, DatasetError> {
        let chunk = key.array.chunk_shape();
        let chunk = chunk.map_err(|error| self.error(&key.name, error))?;
        let rows = chunk.and_then(|chunk| chunk.first().copied()).unwrap_or(1);
        Ok(usize::try_from(rows).unwrap_or(usize::MAX).max(1))
    }

    /// The rows from `start` that `into` has room for.
    pub(crate) fn rows(
        &self,
        key: &Key,
        start: usize,
        into: &mut [f32],
    ) -> Result<(), DatasetError> {
        let count = into.len() / key.width.max(1);
        if count == 0 {
            return Ok(());
        }
        let read = |start: usize, count: usize| {
            if (start, count) == (0, key.rows) {
                key.array.read_f32()
            } else {
                key.array.read_f32_rows(start as u64, count as u64)
            }
        };
        let values = read(start, count).map_err(|error| {
            // Where in the array, chunk by chunk.
            let chunk = self.chunk_rows(key).unwrap_or(count).min(count);
            let found = (start..start + count)
                .step_by(chunk)
                .map(|first| (first, chunk.min(start + count - first)))
                .find_map(|(first, rows)| Some((first, rows, read(first, rows).err()?)));
            match found {
                Some((first, rows, error)) => self.error(
                    &key.name,
                    format!("rows {first} to {}: {error}", first + rows - 1),
                ),
                None => self.error(&key.name, error),
            }
        })?;
        if values.len() != into.len() {
            let reason = format!(
                "rows {start} to {} hold {} values, the shape wants {}",
                start + count - 1,
                values.len(),
                into.len()
            );
            return Err(self.error(&key.name, reason));
        }
        match values.iter().position(|value| !value.is_finite()) {
            Some(at) => Err(DatasetError::NotFinite {
                path: self.path.to_path_buf(),
                key: key.name.clone(),
                row: start + at / key.width,
            }),
            None => {
                into.copy_from_slice(&values);
                Ok(())
            }
        }
    }
}

/// Zeros, or an error where there is no room for them.
pub(crate) fn zeros(count: usize) -> Result<Vec<f32>, std::collections::TryReserveError> {
    let mut values = Vec::new();
    values.try_reserve_exact(count)?;
    values.resize(count, 0.0);
    Ok(values)
}
