//! Values of arrays, decoded on all cores.

use hdf5_reader::error::Error;
use hdf5_reader::{H5Type, SliceInfo, SliceInfoElem};

use super::number::Number;
use super::told::{root_cause, told};
use super::wide::Wide;
use super::{Key, Reader};
use crate::fault::Faults;
use crate::{DatasetError, parallel};

/// Rows that one thread decodes at a time, about: whole chunks of them.
const PIECE: usize = 65_536;
/// Values of those at most, but for a chunk that has more.
const PIECE_VALUES: usize = 1 << 22;

/// What an array is read as.
pub(crate) trait Value: Copy + Default + Send {
    /// What the file's values are decoded to.
    type Stored: H5Type;

    fn of(stored: &Self::Stored) -> Self;

    fn is_finite(self) -> bool;

    /// From chunks that are found in another way.
    fn wide(wide: &Wide, start: usize, width: usize, into: &mut [Self]) -> Result<(), Error>;
}

impl Value for f32 {
    type Stored = Number;

    fn of(Number(value): &Number) -> Self {
        *value
    }

    fn is_finite(self) -> bool {
        f32::is_finite(self)
    }

    fn wide(wide: &Wide, start: usize, width: usize, into: &mut [Self]) -> Result<(), Error> {
        wide.read(start, width, into)
    }
}

impl Value for u8 {
    type Stored = Self;

    fn of(stored: &Self) -> Self {
        *stored
    }

    fn is_finite(self) -> bool {
        true
    }

    fn wide(_: &Wide, _: usize, _: usize, _: &mut [Self]) -> Result<(), Error> {
        // Images have more sides than such arrays.
        Err(Error::UnsupportedChunkIndexType(0))
    }
}

impl Reader<'_> {
    /// All values of some keys, as `f32` whatever their number type, with h5py's bools as 0 and 1,
    /// or the bytes of images. Decoded on all cores. Rows with a fault are noted where `faults`
    /// takes them, and hold anything.
    pub(crate) fn values<T: Value, const N: usize>(
        &self,
        keys: [&Key; N],
        faults: &Faults,
    ) -> Result<[Vec<T>; N], DatasetError> {
        let mut arrays = [const { Vec::new() }; N];
        for (key, array) in keys.iter().zip(&mut arrays) {
            *array = zeros(key.rows * key.width).map_err(|error| self.error(&key.name, error))?;
        }
        let mut jobs = vec![];
        for (key, array) in keys.iter().zip(&mut arrays) {
            let piece = piece(key);
            let slices = array.chunks_mut((piece * key.width).max(1));
            jobs.extend(
                slices
                    .enumerate()
                    .map(|(number, into)| (*key, number * piece, into)),
            );
        }
        parallel::each(jobs, |(key, start, into)| {
            self.rows(key, start, into, faults)
        })?;
        Ok(arrays)
    }

    /// The rows from `start` that `into` has room for. Rows with a fault are noted where `faults`
    /// takes them.
    pub(crate) fn rows<T: Value>(
        &self,
        key: &Key,
        start: usize,
        into: &mut [T],
        faults: &Faults,
    ) -> Result<(), DatasetError> {
        let width = key.width.max(1);
        if into.is_empty() {
            return Ok(());
        }
        if let Err(error) = read(key, start, into) {
            // No fault of some rows.
            if let Error::UnsupportedFilter(_) = root_cause(&error) {
                return Err(self.refuse(format!("'{}': {}", key.name, told(&error))));
            }
            // Where in the array, chunk by chunk.
            let chunk = chunk_rows(key).min(key.rows.max(1));
            for (number, into) in into.chunks_mut(chunk * width).enumerate() {
                let first = start + number * chunk;
                let rows = into.len() / width;
                if let Err(error) = read(key, first, into) {
                    let error = DatasetError::Rows {
                        path: self.path.to_path_buf(),
                        key: key.name.clone(),
                        first,
                        last: first + rows - 1,
                        reason: told(&error),
                    };
                    faults.note(first..first + rows, error)?;
                    into.fill(T::default());
                }
            }
        }
        for (row, values) in into.chunks(width).enumerate() {
            if !values.iter().all(|value| value.is_finite()) {
                let row = start + row;
                let error = DatasetError::NotFinite {
                    path: self.path.to_path_buf(),
                    key: key.name.clone(),
                    row,
                };
                faults.note(row..row + 1, error)?;
            }
        }
        Ok(())
    }
}

/// Rows of a piece: whole chunks, so that none is decoded twice.
fn piece(key: &Key) -> usize {
    let chunk = chunk_rows(key);
    PIECE
        .min(PIECE_VALUES / key.width.max(1))
        .max(1)
        .div_ceil(chunk)
        .saturating_mul(chunk)
        .min(key.rows.max(1))
}

/// Rows of a chunk.
fn chunk_rows(key: &Key) -> usize {
    let chunk = key.array.chunks();
    let rows = chunk.and_then(|chunk| chunk.first().copied()).unwrap_or(1);
    usize::try_from(rows).unwrap_or(usize::MAX).max(1)
}

/// The rows from `start` that `into` has room for.
fn read<T: Value>(key: &Key, start: usize, into: &mut [T]) -> Result<(), Error> {
    if let Some(wide) = &key.wide {
        return T::wide(wide, start, key.width, into);
    }
    let count = into.len() / key.width.max(1);
    let values = if (start, count) == (0, key.rows) {
        key.array.read_array::<T::Stored>()?
    } else {
        let mut window = SliceInfo::all(key.array.shape().len());
        if let Some(rows) = window.selections.first_mut() {
            *rows = SliceInfoElem::Slice {
                start: start as u64,
                end: (start + count) as u64,
                step: 1,
            };
        }
        key.array.read_slice::<T::Stored>(&window)?
    };
    if values.len() != into.len() {
        let (found, wanted) = (values.len(), into.len());
        return Err(Error::InvalidData(format!(
            "{found} values are there, the shape wants {wanted}"
        )));
    }
    for (into, stored) in into.iter_mut().zip(&values) {
        *into = T::of(stored);
    }
    Ok(())
}

/// Zeros, or an error where there is no room for them.
pub(crate) fn zeros<T: Copy + Default>(
    count: usize,
) -> Result<Vec<T>, std::collections::TryReserveError> {
    let mut values = Vec::new();
    values.try_reserve_exact(count)?;
    values.resize(count, T::default());
    Ok(values)
}
