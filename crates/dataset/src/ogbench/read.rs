//! Reads npz files of OGBench.

use std::fs;
use std::io::{Cursor, Read};
use std::path::Path;

use zip::{CompressionMethod, ZipArchive};

use super::npy;
use crate::error::io_error;
use crate::fault::Faults;
use crate::{ACTION, Dataset, DatasetError, Dropped, OBSERVATION, OnFault, episodes, parallel};

/// No deflated byte stands for more than 1032 bytes (zlib's technical notes).
const INFLATION: u64 = 1032;

/// Entries of the archive that an error tells at most.
const NAMES: usize = 12;
/// What is said where an array is missing.
const LAYOUT: &str = "OGBench's layout wants observations, actions and terminals, D4RL's and \
                      Minari's an HDF5 file";

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
    read_with(path, bytes, OnFault::Refuse).map(|(data, _)| data)
}

/// [`read_bytes`], and what becomes of faulty episodes.
pub(crate) fn read_with(
    path: &Path,
    bytes: &[u8],
    on_fault: OnFault,
) -> Result<(Dataset, Dropped), DatasetError> {
    let faults = Faults::new(on_fault);
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
        // Without the marks of their ends episodes cannot be told apart.
        let strict = Faults::new(OnFault::Refuse);
        let faults = if name == "terminals" {
            &strict
        } else {
            &faults
        };
        *values = entry.values(&mut archive.clone(), faults)?;
        Ok::<(), DatasetError>(())
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
    let data = Dataset {
        observations,
        actions,
        rewards: vec![0.0; rows],
        terminals: vec![false; rows],
        episodes: episodes(&ends),
        goals: vec![],
    };
    faults.drop_rows(path, data)
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

    /// The number of the archive's entry that holds the array: `NAME.npy`, as numpy has it, or that
    /// within a folder.
    fn entry(&self, archive: &ZipArchive<Cursor<&[u8]>>) -> Result<usize, DatasetError> {
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
        Err(self.error(format!("is missing among {names}{more}; {LAYOUT}")))
    }

    /// All values, row by row.
    fn values(
        &self,
        archive: &mut ZipArchive<Cursor<&[u8]>>,
        faults: &Faults,
    ) -> Result<Vec<f32>, DatasetError> {
        let number = self.entry(archive)?;
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
        for (row, values) in values.chunks_exact(self.width).enumerate() {
            if !values.iter().all(|value| value.is_finite()) {
                let error = DatasetError::NotFinite {
                    path: self.path.to_path_buf(),
                    key: self.name.to_owned(),
                    row,
                };
                faults.note(row..row + 1, error)?;
            }
        }
        Ok(values)
    }
}

#[cfg(test)]
mod tests {
    use std::io::Write;

    use zip::write::SimpleFileOptions;
    use zip::{CompressionMethod, ZipWriter};

    use super::*;
    use crate::{made, ogbench};

    /// An archive of arrays: name, type, shape, bytes of the values.
    fn archive(method: CompressionMethod, arrays: &[(&str, &str, &[usize], Vec<u8>)]) -> Vec<u8> {
        let mut zip = ZipWriter::new(Cursor::new(vec![]));
        for (name, descr, shape, values) in arrays {
            let options = SimpleFileOptions::default().compression_method(method);
            zip.start_file(format!("{name}.npy"), options).unwrap();
            zip.write_all(&npy::written(descr, shape)).unwrap();
            zip.write_all(values).unwrap();
        }
        zip.finish().unwrap().into_inner()
    }

    fn f4(count: usize) -> Vec<u8> {
        (0..count)
            .flat_map(|at| (at as f32).to_le_bytes())
            .collect()
    }

    fn of(arrays: &[(&str, &str, &[usize], Vec<u8>)]) -> Result<Dataset, DatasetError> {
        let bytes = archive(CompressionMethod::Deflated, arrays);
        read_bytes(Path::new("x.npz"), &bytes)
    }

    #[test]
    fn arrays_deflated_or_stored_are_read_and_the_rest_is_an_episode() {
        for method in [CompressionMethod::Deflated, CompressionMethod::Stored] {
            let bytes = archive(
                method,
                &[
                    ("observations", "<f4", &[3, 29], f4(87)),
                    (
                        "actions",
                        "<f8",
                        &[3, 8],
                        [0.5_f64; 24].iter().flat_map(|v| v.to_le_bytes()).collect(),
                    ),
                    ("terminals", "|b1", &[3], vec![0, 1, 0]),
                    ("qpos", "|S1", &[1], vec![0]),
                ],
            );
            let data = read_bytes(Path::new("x.npz"), &bytes).unwrap();
            made::sound(&data);
            assert_eq!(data.episodes, [0..2, 2..3]);
            assert_eq!(data.observation(2)[28], 86.0);
            assert_eq!(data.actions, [0.5; 24]);
            assert_eq!(data.rewards, [0.0; 3]);
            assert!(data.goals.is_empty() && data.terminals == [false; 3]);
        }
    }

    #[test]
    fn the_order_of_columns_first_is_turned() {
        // Value 100 c + r in column c and row r, columns one after the other.
        let values = (0..29).flat_map(|c| (0..2).map(move |r| (100 * c + r) as f32));
        let mut header = String::from_utf8_lossy(&npy::written("<f4", &[2, 29])[10..]).into_owned();
        header = header.replace("False", "True ");
        let mut bytes = npy::written("<f4", &[2, 29])[..10].to_vec();
        bytes.extend(header.as_bytes());
        bytes.extend(values.flat_map(f32::to_le_bytes));
        let mut zip = ZipWriter::new(Cursor::new(vec![]));
        for (name, bytes) in [
            ("observations", bytes),
            ("actions", [npy::written("<f4", &[2, 8]), f4(16)].concat()),
            (
                "terminals",
                [npy::written("|b1", &[2]), vec![0, 1]].concat(),
            ),
        ] {
            zip.start_file(format!("{name}.npy"), SimpleFileOptions::default())
                .unwrap();
            zip.write_all(&bytes).unwrap();
        }
        let bytes = zip.finish().unwrap().into_inner();
        let data = read_bytes(Path::new("x.npz"), &bytes).unwrap();
        assert_eq!(data.observation(1)[..3], [1.0, 101.0, 201.0]);
        assert_eq!(data.observation(0)[28], 2800.0);
    }

    #[test]
    fn what_is_wrong_is_named_with_key_and_row() {
        let actions = || ("actions", "<f4", &[2, 8][..], f4(16));
        let terminals = || ("terminals", "|b1", &[2][..], vec![0, 1]);
        let observations = |descr: &'static str, shape: &'static [usize], values: Vec<u8>| {
            of(&[
                ("observations", descr, shape, values),
                actions(),
                terminals(),
            ])
            .unwrap_err()
            .to_string()
        };
        let mut nan = f4(58);
        nan[4 * 30..4 * 31].copy_from_slice(&f32::NAN.to_le_bytes());
        for (error, wanted) in [
            (
                of(&[actions(), terminals()]).unwrap_err().to_string(),
                "'observations': is missing",
            ),
            (observations("<f4", &[2, 29], nan), "not finite in row 1"),
            (
                observations("<f4", &[2, 27], f4(54)),
                "shape [2, 27], expected [n, 29]",
            ),
            (
                observations("<f4", &[58], f4(58)),
                "shape [58], expected [n, 29]",
            ),
            (
                observations("<f4", &[], f4(1)),
                "shape [], expected [n, 29]",
            ),
            (
                observations("<f4", &[3, 29], f4(87)),
                "'actions' has shape [2, 8], expected [3, 8]",
            ),
            (
                observations("<f4", &[2, 29], f4(57)),
                "'observations': damaged at or after row 0",
            ),
            (
                observations("<f4", &[2, 29], f4(59)),
                "holds more values than its shape",
            ),
            (
                observations("<f4", &[1 << 40, 29], f4(58)),
                "rows are more than",
            ),
            (observations("<c8", &[2, 29], f4(116)), "is of type <c8"),
        ] {
            assert!(
                error.contains(wanted) && error.starts_with("x.npz: "),
                "{error}"
            );
        }
        let none = of(&[
            ("observations", "<f4", &[0, 29], vec![]),
            ("actions", "<f4", &[0, 8], vec![]),
            ("terminals", "|b1", &[0], vec![]),
        ]);
        assert!(none.unwrap_err().to_string().contains("no episode"));
        assert!(matches!(
            read(Path::new("none.npz")),
            Err(DatasetError::Io { .. })
        ));
    }

    #[test]
    fn cut_and_flipped_files_are_errors_or_sound_never_a_panic() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("small.npz");
        let wanted = made::varied(&[3, 2]);
        ogbench::write(&path, &wanted).unwrap();
        let bytes = fs::read(&path).unwrap();
        for length in 0..bytes.len() {
            assert!(
                read_bytes(&path, &bytes[..length]).is_err(),
                "cut at {length}"
            );
        }
        let mut errors = 0;
        for at in 0..bytes.len() {
            for mask in [0x01, 0x5a, 0xff] {
                let mut flipped = bytes.clone();
                flipped[at] ^= mask;
                match read_bytes(&path, &flipped) {
                    // The archive's checksums leave no value changed.
                    Ok(data) => assert_eq!(data.observations, wanted.observations, "byte {at}"),
                    Err(_) => errors += 1,
                }
            }
        }
        assert!(
            errors > bytes.len(),
            "{errors} errors in {} bytes",
            bytes.len()
        );
    }

    #[test]
    fn damage_within_a_long_array_names_the_row() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("long.npz");
        ogbench::write(&path, &made::varied(&[20_000])).unwrap();
        let mut bytes = fs::read(&path).unwrap();
        let middle = bytes.len() / 3;
        bytes[middle..middle + 64].fill(0xff);
        let error = read_bytes(&path, &bytes).unwrap_err().to_string();
        assert!(
            error.contains("damaged at or after row") && !error.contains("row 0:"),
            "{error}"
        );
    }
}
