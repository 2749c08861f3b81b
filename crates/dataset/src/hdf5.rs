//! Arrays of HDF5 files, believed only as far as the file can bear them out.

mod elsewhere;
mod filters;
mod links;
mod number;
mod options;
#[cfg(test)]
mod tests;
mod told;
mod values;
mod wide;

use std::fs::File;
use std::io::Read;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use hdf5_reader::error::Error;
use hdf5_reader::group::Group;
use hdf5_reader::{
    BytesStorage, Dataset as Array, Datatype, FileStorage, FilesystemExternalFileResolver,
    Hdf5File, Storage,
};

use crate::DatasetError;
use crate::error::io_error;
use elsewhere::Elsewhere;
use links::{Link, Target};
use options::{INFLATION, options};
use told::{root_cause, told};
pub(crate) use values::{Value, zeros};

/// Names of a folder that an error tells at most.
const NAMES: usize = 12;

/// An open file and what its errors need.
pub(crate) struct Reader<'p> {
    path: &'p Path,
    /// Bytes of the file and of those that its links lead to.
    length: Arc<AtomicU64>,
    file: Hdf5File,
}

/// Whether links that lead to other files are followed.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum OtherFiles {
    /// From the folder of the file.
    Follow,
    /// The bytes have no folder.
    Refuse,
}

/// Values of a row.
#[derive(Clone, Copy)]
pub(crate) enum Width {
    /// So many.
    Exactly(usize),
    /// So many or more.
    AtLeast(usize),
}

impl Width {
    pub(crate) fn fits(self, width: usize) -> bool {
        match self {
            Self::Exactly(wanted) => width == wanted,
            Self::AtLeast(least) => width >= least,
        }
    }

    /// The shape that is wanted, for errors; a width that was found and fits stays.
    pub(crate) fn expected(self, rows: Option<usize>, found: Option<usize>) -> String {
        let rows = rows.map_or("n".to_owned(), |rows| rows.to_string());
        match (self, found) {
            (Self::Exactly(1), _) => format!("[{rows}]"),
            (Self::Exactly(width), _) | (Self::AtLeast(_), Some(width)) => {
                format!("[{rows}, {width}]")
            }
            (Self::AtLeast(least), None) => format!("[{rows}, {least} or more]"),
        }
    }
}

/// A key whose shape is that of the layout.
pub(crate) struct Key {
    name: String,
    array: Array,
    /// Its chunks, where those are found in another way.
    wide: Option<wide::Wide>,
    /// Rows.
    pub(crate) rows: usize,
    /// Values of a row.
    pub(crate) width: usize,
}

impl Key {
    /// Whether values are bytes.
    pub(crate) fn is_bytes(&self) -> bool {
        matches!(
            self.array.dtype(),
            Datatype::FixedPoint {
                size: 1,
                signed: false,
                ..
            }
        )
    }

    /// Sides of a row's image; none where a row is no image of bytes.
    pub(crate) fn image(&self) -> Option<Vec<usize>> {
        let sides = self.array.shape().get(1..).unwrap_or_default();
        // Their product is the width, which was looked at.
        let sides: Vec<usize> = sides.iter().map(|side| *side as usize).collect();
        (sides.len() > 1 && self.is_bytes()).then_some(sides)
    }
}

/// A folder of keys within the file.
pub(crate) struct Folder {
    /// Its path within the file, with a `/` at the end; empty for the root.
    pub(crate) prefix: String,
    group: Group,
}

impl<'p> Reader<'p> {
    /// Opens the bytes of a file; `path` is for errors, and where `others` says so for links.
    pub(crate) fn of_bytes(
        path: &'p Path,
        bytes: Vec<u8>,
        others: OtherFiles,
    ) -> Result<Self, DatasetError> {
        Self::open(path, Arc::new(BytesStorage::new(bytes)), others)
    }

    /// Opens a file, of which only what is asked for is in memory; links to other files are followed.
    pub(crate) fn of_file(path: &'p Path) -> Result<Self, DatasetError> {
        let io = |error| io_error(path, error);
        let mut file = File::open(path).map_err(io)?;
        if !file.metadata().map_err(io)?.is_file() {
            // A pipe gives its bytes once, in order.
            let mut bytes = vec![];
            file.read_to_end(&mut bytes).map_err(io)?;
            return Self::of_bytes(path, bytes, OtherFiles::Follow);
        }
        let storage = FileStorage::from_file(file);
        let storage = storage.map_err(|error| io(std::io::Error::other(told(&error))))?;
        Self::open(path, Arc::new(storage), OtherFiles::Follow)
    }

    fn open(
        path: &'p Path,
        storage: Arc<dyn Storage>,
        others: OtherFiles,
    ) -> Result<Self, DatasetError> {
        let format = |reason: String| DatasetError::Format {
            path: path.to_path_buf(),
            reason,
        };
        let size = storage.len();
        let length = Arc::new(AtomicU64::new(size));
        let mut options = options(size);
        if others == OtherFiles::Follow {
            let elsewhere = Elsewhere::of(path, Arc::clone(&length));
            let raw = FilesystemExternalFileResolver::new(elsewhere.folder());
            options = options
                .with_external_link_resolver(Arc::new(elsewhere))
                .with_external_file_resolver(Arc::new(raw));
        }
        let file = Hdf5File::from_storage_with_options(storage, options)
            .map_err(|error| format(format!("not an HDF5 file that can be read: {error}")))?;
        let superblock = file.superblock();
        let whole = superblock.eof_address;
        if size < whole {
            return Err(format(format!(
                "cut off: {size} of {whole} bytes are there; copy it again"
            )));
        }
        Ok(Self { path, length, file })
    }

    /// What errors name.
    pub(crate) fn path(&self) -> &'p Path {
        self.path
    }

    /// The file's root.
    pub(crate) fn root(&self) -> Result<Folder, DatasetError> {
        let group = self.file.root_group();
        Ok(Folder {
            prefix: String::new(),
            group: group.map_err(|error| self.error("/", told(&error)))?,
        })
    }

    /// Numbers of the root's names that are a word and a number, whatever they lead to.
    pub(crate) fn numbered(&self, word: &str) -> Result<Vec<usize>, DatasetError> {
        let number = |link: Link| {
            let digits = link.name.strip_prefix(word)?;
            // No sign, and one name only for each number.
            let number: usize = digits.parse().ok()?;
            (digits == number.to_string()).then_some(number)
        };
        let names = links::links(&self.root()?.group);
        let names = names.map_err(|error| self.error("/", told(&error)))?;
        Ok(names.into_iter().filter_map(number).collect())
    }

    /// A folder within another.
    pub(crate) fn folder(&self, within: &Folder, name: &str) -> Result<Folder, DatasetError> {
        let group = within.group.group(name).map_err(|error| {
            let reason = self.instead(within, name, &error, "a group");
            let name = format!("{}{name}", within.prefix);
            self.error(&name, reason.unwrap_or_else(|| "is missing".to_owned()))
        })?;
        Ok(Folder {
            prefix: format!("{}{name}/", within.prefix),
            group,
        })
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

    /// Why a name is not what was looked for; none where there is no such name.
    fn instead(&self, within: &Folder, name: &str, error: &Error, wanted: &str) -> Option<String> {
        let cause = root_cause(error);
        let absent = matches!(cause, Error::DatasetNotFound(_) | Error::GroupNotFound(_));
        let found = match links::links(&within.group) {
            Ok(links) => links.into_iter().find(|link| link.name == name),
            Err(_) if !absent => return Some(told(cause)),
            Err(error) => return Some(told(&error)),
        };
        if !absent {
            let told = told(cause);
            return Some(match found.map(|link| link.target) {
                Some(Target::External { file, path }) if !told.starts_with(elsewhere::LINK) => {
                    format!("is a link to '{path}' in the file {file}: {told}")
                }
                _ => told,
            });
        }
        Some(match found?.target {
            Target::Object => format!("is there, but is not {wanted}"),
            Target::Soft(path) => {
                format!(
                    "is a link to '{path}', which leads to nothing that can be read as {wanted}"
                )
            }
            Target::External { file, path } => format!(
                "is a link to '{path}' in the file {file}, which is not followed from here; copy \
                 what it leads to into one file, as h5py's Group.copy does with expand_external=True"
            ),
        })
    }

    /// A key that must be there, of `rows` rows if those are known. No value is read yet.
    /// `layout` tells what a file of the format has.
    pub(crate) fn key(
        &self,
        folder: &Folder,
        name: &str,
        rows: Option<usize>,
        width: Width,
        layout: &str,
    ) -> Result<Key, DatasetError> {
        let found = self.optional(folder, name, rows, width)?;
        found.ok_or_else(|| {
            let key = format!("{}{name}", folder.prefix);
            self.error(&key, format!("is missing {}; {layout}", self.names(folder)))
        })
    }

    /// What a folder has, in a few words.
    fn names(&self, folder: &Folder) -> String {
        let links = links::links(&folder.group).unwrap_or_default();
        let mut names: Vec<String> = links.into_iter().map(|link| link.name).collect();
        names.sort_unstable();
        let more = names.len().saturating_sub(NAMES);
        names.truncate(NAMES);
        match (names.is_empty(), more) {
            (true, _) => "as nothing is there".to_owned(),
            (_, 0) => format!("among {}", names.join(", ")),
            _ => format!("among {} and {more} more", names.join(", ")),
        }
    }

    /// A key that may be missing. One that is there and damaged is an error all the same.
    pub(crate) fn optional(
        &self,
        folder: &Folder,
        name: &str,
        rows: Option<usize>,
        width: Width,
    ) -> Result<Option<Key>, DatasetError> {
        let whole = format!("{}{name}", folder.prefix);
        let (parent, last) = match name.rsplit_once('/') {
            None => (None, name),
            Some((parent, last)) => match self.present(folder, parent)? {
                None => return Ok(None),
                parent => (parent, last),
            },
        };
        let folder = parent.as_ref().unwrap_or(folder);
        let array = match folder.group.dataset(last) {
            Ok(array) => array,
            Err(error) => {
                return match self.instead(folder, last, &error, "an array") {
                    None => Ok(None),
                    Some(reason) => Err(self.error(&whole, reason)),
                };
            }
        };
        number::check(&array).map_err(|error| self.error(&whole, told(&error)))?;
        let mut key = self.shaped(whole, array, rows, width)?;
        key.wide = wide::wide(&folder.group, &key.array)
            .map_err(|error| self.error(&key.name, told(&error)))?;
        Ok(Some(key))
    }

    /// A folder that may be missing.
    fn present(&self, within: &Folder, name: &str) -> Result<Option<Folder>, DatasetError> {
        match within.group.group(name) {
            Ok(group) => Ok(Some(Folder {
                prefix: format!("{}{name}/", within.prefix),
                group,
            })),
            Err(error) => match self.instead(within, name, &error, "a group") {
                None => Ok(None),
                Some(reason) => Err(self.error(&format!("{}{name}", within.prefix), reason)),
            },
        }
    }

    /// The array as a key, if its shape is that of the layout.
    fn shaped(
        &self,
        name: String,
        array: Array,
        rows: Option<usize>,
        width: Width,
    ) -> Result<Key, DatasetError> {
        let shape = array.shape();
        // Rewards come as (n,) and as (n, 1).
        let columns = shape
            .iter()
            .skip(1)
            .try_fold(1_u64, |all, side| all.checked_mul(*side));
        let found = shape.first().copied().unwrap_or(0);
        let columns = columns.and_then(|columns| usize::try_from(columns).ok());
        // Without rows there are no values, whatever the columns: Minari's episodes of no step.
        let columns = columns.filter(|columns| found == 0 || width.fits(*columns));
        let fits = !shape.is_empty() && rows.is_none_or(|rows| rows as u64 == found);
        let Some(columns) = columns.filter(|_| fits) else {
            return Err(DatasetError::Shape {
                path: self.path.to_path_buf(),
                key: name,
                got: shape.to_vec(),
                expected: width.expected(rows, columns),
            });
        };
        // Believe no length that the file cannot hold: allocation would end the process.
        if found > self.most() / columns.max(1) as u64 {
            let length = self.length.load(Ordering::Relaxed);
            let reason = format!("{found} rows are more than {length} bytes can hold");
            return Err(self.error(&name, reason));
        }
        Ok(Key {
            rows: found as usize,
            width: columns,
            name,
            array,
            wide: None,
        })
    }

    /// Values that the file can hold at most, each of a byte or more.
    pub(crate) fn most(&self) -> u64 {
        let length = self.length.load(Ordering::Relaxed);
        length.saturating_mul(INFLATION)
    }
}
