//! Reads npz files of OGBench.

use std::fs;
use std::io::{Cursor, Read};
use std::path::Path;

use zip::ZipArchive;

use super::npy;
use crate::replace::io_error;
use crate::{ACTION, Dataset, DatasetError, OBSERVATION, episodes, parallel};

/// No deflated byte stands for more than 1032 bytes (zlib's technical notes).
const INFLATION: u64 = 1032;

/// Values that are decoded at a time.
const BLOCK: usize = 1 << 14;

/// Reads a file of OGBench, for training or for validation. Numbers and bools of any type are
/// taken, deflated or not. Rewards are zero, [`Dataset::terminals`] false, and there are no goals;
/// rows after the last mark of an end are an episode too.
///
/// # Errors
/// Anything that is wrong with the file, by key and row.
pub fn read(path: &Path) -> Result<Dataset, DatasetError> {
    read_bytes(
        path,
        &fs::read(path).map_err(|error| io_error(path, error))?,
    )
}

/// [`read`] of a file's bytes; `path` is what errors name.
///
/// # Errors
/// Anything that is wrong with them, by key and row.
pub fn read_bytes(path: &Path, bytes: &[u8]) -> Result<Dataset, DatasetError> {
    let refuse = |reason: String| DatasetError::Format {
        path: path.to_path_buf(),
        reason,
    };
    let archive = ZipArchive::new(Cursor::new(bytes))
        .map_err(|error| refuse(format!("not a zip archive that can be read: {error}")))?;
    let mut arrays = [const { Vec::new() }; 3];
    let names = [
        ("observations", OBSERVATION),
        ("actions", ACTION),
        ("terminals", 1),
    ];
    let jobs = names.into_iter().zip(&mut arrays).collect();
    parallel::each(jobs, |((name, width), values): (_, &mut Vec<f32>)| {
        let entry = Entry { path, name, width };
        *values = entry.values(&mut archive.clone())?;
        Ok(())
    })?;
    let [observations, actions, terminals] = arrays;
    let rows = observations.len() / OBSERVATION;
    for ((name, width), length) in
        names
            .iter()
            .zip([observations.len(), actions.len(), terminals.len()])
    {
        if length != rows * width {
            let entry = Entry {
                path,
                name,
                width: *width,
            };
            return Err(entry.shape(vec![(length / width) as u64, *width as u64], Some(rows)));
        }
    }
    if rows == 0 {
        return Err(refuse("no episode: its arrays have no row".to_owned()));
    }
    let ends: Vec<bool> = terminals.iter().map(|value| *value > 0.0).collect();
    Ok(Dataset {
        observations,
        actions,
        rewards: vec![0.0; rows],
        terminals: vec![false; rows],
        episodes: episodes(&ends),
        goals: vec![],
    })
}

/// An array of the archive.
struct Entry<'a> {
    path: &'a Path,
    name: &'static str,
    width: usize,
}

impl Entry<'_> {
    fn error(&self, reason: impl std::fmt::Display) -> DatasetError {
        DatasetError::Key {
            path: self.path.to_path_buf(),
            key: self.name.to_owned(),
            reason: reason.to_string(),
        }
    }

    fn shape(&self, got: Vec<u64>, rows: Option<usize>) -> DatasetError {
        let rows = rows.map_or("n".to_owned(), |rows| rows.to_string());
        DatasetError::Shape {
            path: self.path.to_path_buf(),
            key: self.name.to_owned(),
            got,
            expected: match self.width {
                1 => format!("[{rows}]"),
                width => format!("[{rows}, {width}]"),
            },
        }
    }

    /// All values, row by row.
    fn values(&self, archive: &mut ZipArchive<Cursor<&[u8]>>) -> Result<Vec<f32>, DatasetError> {
        let mut file = match archive.by_name(&format!("{}.npy", self.name)) {
            Ok(file) => file,
            Err(zip::result::ZipError::FileNotFound) => {
                let reason = "is missing; the layout has it, is this a file of another kind?";
                return Err(self.error(reason));
            }
            Err(error) => return Err(self.error(error)),
        };
        let most = file.compressed_size().saturating_mul(INFLATION);
        let head = npy::header(&mut file).map_err(|reason| self.error(reason))?;
        // Flags come as (n,) and as (n, 1).
        let columns = head
            .shape
            .iter()
            .skip(1)
            .try_fold(1_u64, |all, side| all.checked_mul(*side));
        if head.shape.is_empty() || columns != Some(self.width as u64) {
            return Err(self.shape(head.shape, None));
        }
        let Some((size, number)) = npy::number(&head.descr) else {
            return Err(self.error(format!("is of type {}, not of numbers", head.descr)));
        };
        // Believe no length that the archive cannot hold: allocation would end the process.
        let rows = head.shape[0];
        if rows > most / (size * self.width) as u64 {
            let packed = file.compressed_size();
            return Err(self.error(format!("{rows} rows are more than {packed} bytes can hold")));
        }
        let rows = rows as usize;
        let mut values = Vec::new();
        values
            .try_reserve_exact(rows * self.width)
            .map_err(|error| self.error(error))?;
        let mut block = vec![0; BLOCK.min(rows * self.width) * size];
        while values.len() < rows * self.width {
            let count = BLOCK.min(rows * self.width - values.len());
            let row = values.len() / self.width;
            let bytes = &mut block[..count * size];
            file.read_exact(bytes)
                .map_err(|error| self.error(format!("damaged at or after row {row}: {error}")))?;
            values.extend(bytes.chunks_exact(size).map(number));
        }
        // The archive's checksum is compared at its entry's end.
        match file.read(&mut [0]) {
            Ok(0) => {}
            Ok(_) => return Err(self.error("holds more values than its shape")),
            Err(error) => return Err(self.error(error)),
        }
        if head.fortran {
            let columns = values;
            values = (0..columns.len())
                .map(|at| columns[at % self.width * rows + at / self.width])
                .collect();
        }
        match values.iter().position(|value| !value.is_finite()) {
            Some(at) => Err(DatasetError::NotFinite {
                path: self.path.to_path_buf(),
                key: self.name.to_owned(),
                row: at / self.width,
            }),
            None => Ok(values),
        }
    }
}
