//! Arrays of an npz archive.

use std::io::{Cursor, Read};
use std::path::Path;

use zip::{CompressionMethod, ZipArchive};

use super::npy;
use crate::DatasetError;
use crate::fault::Faults;
use crate::hdf5::{Width, zeros};

/// No deflated byte stands for more than 1032 bytes (zlib's technical notes).
const INFLATION: u64 = 1032;
/// Entries of the archive that an error tells at most.
const NAMES: usize = 12;
/// Values that are decoded at a time.
const BLOCK: usize = 1 << 14;

/// An array of the archive.
pub(super) struct Entry<'a> {
    /// Path of the archive, for errors.
    pub(super) path: &'a Path,
    pub(super) name: &'static str,
    /// Expected values per row.
    pub(super) width: Width,
    /// Hint if it is missing.
    pub(super) layout: &'static str,
}

/// Contents of an entry.
pub(super) struct Array {
    pub(super) rows: usize,
    /// Dimensions of a row; empty if it is one value.
    pub(super) sides: Vec<usize>,
    /// Values per row.
    pub(super) width: usize,
    pub(super) values: Values,
}

/// Values, row by row.
pub(super) enum Values {
    Floats(Vec<f32>),
    /// Pixels.
    Bytes(Vec<u8>),
}

impl Values {
    pub(super) fn into_floats(self) -> Vec<f32> {
        match self {
            Self::Floats(values) => values,
            Self::Bytes(bytes) => bytes.into_iter().map(f32::from).collect(),
        }
    }
}

impl Entry<'_> {
    fn error(&self, reason: impl std::fmt::Display) -> DatasetError {
        DatasetError::Key {
            path: self.path.to_path_buf(),
            key: self.name.to_owned(),
            reason: reason.to_string(),
        }
    }

    fn shape(&self, got: Vec<u64>, rows: Option<usize>, width: Option<usize>) -> DatasetError {
        DatasetError::Shape {
            path: self.path.to_path_buf(),
            key: self.name.to_owned(),
            got,
            expected: self.width.expected(rows, width),
        }
    }

    /// Checks the number of rows.
    pub(super) fn of_rows(&self, array: &Array, rows: usize) -> Result<(), DatasetError> {
        if array.rows == rows {
            return Ok(());
        }
        let got = vec![array.rows as u64, array.width as u64];
        Err(self.shape(got, Some(rows), Some(array.width)))
    }

    /// The number of the archive's entry that holds the array: `NAME.npy`, as numpy has it, or that
    /// within a folder.
    fn number(&self, archive: &ZipArchive<Cursor<&[u8]>>) -> Result<usize, DatasetError> {
        let file = format!("{}.npy", self.name);
        let within = format!("/{file}");
        if let Some(number) = archive.index_for_name(&file) {
            return Ok(number);
        }
        // A name that is no text is none of numpy's.
        let mut names: Vec<_> = archive.file_names().flatten().collect();
        let mut found = names.iter().filter(|name| name.ends_with(&within));
        if let (Some(name), None) = (found.next(), found.next())
            && let Some(number) = archive.index_for_name(name)
        {
            return Ok(number);
        }
        names.sort_unstable();
        let more = names.len().saturating_sub(NAMES);
        names.truncate(NAMES);
        let more = if more > 0 {
            format!(" and {more} more")
        } else {
            String::new()
        };
        let names = names.join(", ");
        let layout = self.layout;
        Err(self.error(format!("is missing among {names}{more}; {layout}")))
    }

    /// Reads the array.
    pub(super) fn array(
        &self,
        archive: &mut ZipArchive<Cursor<&[u8]>>,
        faults: &Faults,
    ) -> Result<Array, DatasetError> {
        let number = self.number(archive)?;
        let method = archive.by_index_raw(number).map(|file| file.compression());
        let method = method.map_err(|error| self.error(error))?;
        if !matches!(
            method,
            CompressionMethod::Stored | CompressionMethod::Deflated
        ) {
            return Err(self.error(format!(
                "is compressed with {method}, which is not read; np.savez_compressed('new.npz', \
                 **np.load('old.npz')) writes one that is"
            )));
        }
        let mut file = archive
            .by_index(number)
            .map_err(|error| self.error(error))?;
        let packed = file.compressed_size();
        let head = npy::header(&mut file).map_err(|reason| self.error(reason))?;
        let mut array = self.room(&head, packed)?;
        match &mut array.values {
            Values::Floats(values) => self.floats(&head, array.width, &mut file, values)?,
            Values::Bytes(bytes) => file
                .read_exact(bytes)
                .map_err(|error| self.error(format!("damaged: {error}")))?,
        }
        // The archive's checksum is compared at its entry's end.
        match file.read(&mut [0]) {
            Ok(0) => {}
            Ok(_) => return Err(self.error("holds more values than its shape")),
            Err(error) => return Err(self.error(error)),
        }
        self.finish(&head, array, faults)
    }

    /// Allocates an array of the header's shape; `packed` is its size in the archive.
    fn room(&self, head: &npy::Header, packed: u64) -> Result<Array, DatasetError> {
        // Flags come as (n,) and as (n, 1).
        let columns = head
            .shape
            .iter()
            .skip(1)
            .try_fold(1_u64, |all, side| all.checked_mul(*side));
        let width = columns.and_then(|columns| usize::try_from(columns).ok());
        let width = width.filter(|width| self.width.fits(*width));
        let (Some((rows, sides)), Some(width)) = (head.shape.split_first(), width) else {
            return Err(self.shape(head.shape.clone(), None, None));
        };
        let Some((size, _)) = npy::number(&head.descr) else {
            return Err(self.error(format!("is of type {}, not of numbers", head.descr)));
        };
        // Believe no length that the archive cannot hold: allocation would end the process.
        let most = packed.saturating_mul(INFLATION);
        if *rows > most / (size as u64).saturating_mul(width as u64) {
            return Err(self.error(format!("{rows} rows are more than {packed} bytes can hold")));
        }
        if head.fortran && sides.len() > 1 {
            return Err(self.error(
                "is stored in Fortran order, which is read for vectors only; convert it with \
                 np.ascontiguousarray",
            ));
        }
        let rows = *rows as usize;
        let count = rows * width;
        let values = if sides.len() > 1 && head.descr == "|u1" {
            zeros(count).map(Values::Bytes)
        } else {
            let mut values = Vec::new();
            let room = values.try_reserve_exact(count);
            room.map(|()| Values::Floats(values))
        };
        Ok(Array {
            rows,
            sides: sides.iter().map(|side| *side as usize).collect(),
            width,
            values: values.map_err(|error| self.error(error))?,
        })
    }

    /// Reads all values as `f32`.
    fn floats(
        &self,
        head: &npy::Header,
        width: usize,
        file: &mut impl Read,
        values: &mut Vec<f32>,
    ) -> Result<(), DatasetError> {
        let Some((size, number)) = npy::number(&head.descr) else {
            return Ok(());
        };
        let count = head.shape.first().map_or(0, |rows| *rows as usize) * width;
        let mut block = vec![0; BLOCK.min(count) * size];
        while values.len() < count {
            let row = values.len() / width;
            let bytes = &mut block[..BLOCK.min(count - values.len()) * size];
            file.read_exact(bytes)
                .map_err(|error| self.error(format!("damaged at or after row {row}: {error}")))?;
            values.extend(bytes.chunks_exact(size).map(number));
        }
        Ok(())
    }

    /// Converts values to row-major order, and reports those that are not finite.
    fn finish(
        &self,
        head: &npy::Header,
        mut array: Array,
        faults: &Faults,
    ) -> Result<Array, DatasetError> {
        let Values::Floats(values) = &mut array.values else {
            return Ok(array);
        };
        let (rows, width) = (array.rows, array.width);
        if head.fortran {
            let columns = std::mem::take(values);
            *values = (0..columns.len())
                .map(|at| columns[at % width * rows + at / width])
                .collect();
        }
        for (row, values) in values.chunks_exact(width).enumerate() {
            if !values.iter().all(|value| value.is_finite()) {
                let error = DatasetError::NotFinite {
                    path: self.path.to_path_buf(),
                    key: self.name.to_owned(),
                    row,
                };
                faults.note(row..row + 1, error)?;
            }
        }
        Ok(array)
    }
}
