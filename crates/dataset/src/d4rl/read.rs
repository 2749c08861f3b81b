//! Reads files of D4RL and of [`write`](super::write()).

use std::fs::File as SystemFile;
use std::ops::Range;
use std::path::Path;

use hdf5_pure::{Dataset as Array, Error, File, FormatError};

use crate::{ACTION, Dataset, DatasetError, OBSERVATION};

/// Jump of the torso between two rows that only a reset can make (m); ends an episode in files
/// without `timeouts`.
const JUMP: f32 = 5.0;

/// No deflated byte stands for more than 1032 bytes (zlib's technical notes), so no sound file
/// holds more bytes than this for each of its own.
const INFLATION: u64 = 1032;

/// An open file and what its errors need.
struct Reader<'p> {
    path: &'p Path,
    length: u64,
    file: File,
}

/// A key whose shape is that of the layout.
struct Key {
    name: &'static str,
    array: Array,
    rows: usize,
    width: usize,
}

impl Reader<'_> {
    fn error(&self, key: &'static str, reason: impl std::fmt::Display) -> DatasetError {
        DatasetError::Key {
            path: self.path.to_path_buf(),
            key,
            reason: reason.to_string(),
        }
    }

    /// A key that must be there, of `rows` rows if those are known. No value is read yet.
    fn key(
        &self,
        name: &'static str,
        rows: Option<usize>,
        width: usize,
    ) -> Result<Key, DatasetError> {
        self.optional(name, rows, width)?.ok_or_else(|| {
            self.error(
                name,
                "is missing; D4RL's layout has it, is this a file of another kind?",
            )
        })
    }

    /// A key that may be missing. One that is there and damaged is an error all the same.
    fn optional(
        &self,
        name: &'static str,
        rows: Option<usize>,
        width: usize,
    ) -> Result<Option<Key>, DatasetError> {
        let array = match self.file.dataset(name) {
            Ok(array) => array,
            Err(Error::Format(FormatError::PathNotFound(_))) => return Ok(None),
            Err(error) => return Err(self.error(name, error)),
        };
        let shape = array.shape().map_err(|error| self.error(name, error))?;
        // Rewards come as (n,) and as (n, 1).
        let columns = shape
            .iter()
            .skip(1)
            .try_fold(1_u64, |all, side| all.checked_mul(*side));
        let found = shape.first().copied().unwrap_or(0);
        let fits = columns == Some(width as u64) && rows.is_none_or(|rows| rows as u64 == found);
        if shape.is_empty() || !fits {
            let rows = rows.map_or("n".to_owned(), |rows| rows.to_string());
            let expected = if width == 1 {
                format!("[{rows}]")
            } else {
                format!("[{rows}, {width}]")
            };
            let path = self.path.to_path_buf();
            return Err(DatasetError::Shape {
                path,
                key: name,
                got: shape,
                expected,
            });
        }
        // Believe no length that the file cannot hold: allocation would end the process.
        let most = self.length.saturating_mul(INFLATION) / width as u64;
        let rows = usize::try_from(found)
            .ok()
            .filter(|_| found <= most)
            .ok_or_else(|| {
                self.error(
                    name,
                    format!("{found} rows are more than {} bytes can hold", self.length),
                )
            })?;
        Ok(Some(Key {
            name,
            array,
            rows,
            width,
        }))
    }

    /// All values of a key, whatever their number type; h5py's bools are 0 and 1.
    fn values(&self, key: &Key) -> Result<Vec<f32>, DatasetError> {
        let count = key.rows * key.width;
        Vec::<f32>::new()
            .try_reserve_exact(count)
            .map_err(|error| self.error(key.name, error))?;
        let values = key
            .array
            .read_f32()
            .map_err(|error| self.error(key.name, error))?;
        if values.len() != count {
            let reason = format!("holds {} values, its shape wants {count}", values.len());
            return Err(self.error(key.name, reason));
        }
        match values.iter().position(|value| !value.is_finite()) {
            Some(at) => Err(DatasetError::NotFinite {
                path: self.path.to_path_buf(),
                key: key.name,
                row: at / key.width,
            }),
            None => Ok(values),
        }
    }
}

/// Reads a file in D4RL's layout: `observations`, `actions`, `rewards`, `terminals`, and where
/// they are there `timeouts` and `infos/goal`. Numbers and bools of any type are taken. Without
/// `timeouts` a jump of the torso by more than 5 m ends an episode; `terminals` never do.
///
/// # Errors
/// Anything that is wrong with the file, by key and row.
pub fn read(path: &Path) -> Result<Dataset, DatasetError> {
    let length = SystemFile::open(path)
        .and_then(|file| file.metadata())
        .map_err(|source| DatasetError::Io {
            path: path.to_path_buf(),
            source,
        })?
        .len();
    let format = |reason: String| DatasetError::Format {
        path: path.to_path_buf(),
        reason,
    };
    let file = File::open(path)
        .map_err(|error| format(format!("not an HDF5 file that can be read: {error}")))?;
    let whole = file.superblock().eof_address;
    if length < whole {
        return Err(format(format!(
            "cut off: {length} of {whole} bytes are there; copy it again"
        )));
    }
    let reader = Reader { path, length, file };
    // All shapes before any value: a length that is wrong then disagrees before it is allocated.
    let observations = reader.key("observations", None, OBSERVATION)?;
    let n = observations.rows;
    let actions = reader.key("actions", Some(n), ACTION)?;
    let rewards = reader.key("rewards", Some(n), 1)?;
    let terminals = reader.key("terminals", Some(n), 1)?;
    let timeouts = reader.optional("timeouts", Some(n), 1)?;
    let goals = reader.optional("infos/goal", Some(n), 2)?;
    if n == 0 {
        return Err(format("no episode: its arrays have no row".to_owned()));
    }
    let observations = reader.values(&observations)?;
    let flags = |key: &Key| -> Result<Vec<bool>, DatasetError> {
        Ok(reader
            .values(key)?
            .iter()
            .map(|value| *value > 0.0)
            .collect())
    };
    let last = match &timeouts {
        Some(key) => flags(key)?,
        None => jumps(&observations),
    };
    let goals = goals
        .map(|key| reader.values(&key))
        .transpose()?
        .unwrap_or_default();
    Ok(Dataset {
        actions: reader.values(&actions)?,
        rewards: reader.values(&rewards)?,
        terminals: flags(&terminals)?,
        episodes: episodes(&last),
        goals: goals.as_chunks::<2>().0.to_vec(),
        observations,
    })
}

/// Whether the torso is elsewhere in the next row.
fn jumps(observations: &[f32]) -> Vec<bool> {
    let (rows, _) = observations.as_chunks::<OBSERVATION>();
    let mut last: Vec<bool> = rows
        .windows(2)
        .map(|pair| (pair[0][0] - pair[1][0]).hypot(pair[0][1] - pair[1][1]) > JUMP)
        .collect();
    last.push(true);
    last
}

/// Episodes from the marks of their last rows; rows after the last mark are an episode too.
fn episodes(last: &[bool]) -> Vec<Range<usize>> {
    let mut episodes = vec![];
    let mut start = 0;
    for (row, last_row) in last.iter().enumerate() {
        if *last_row || row + 1 == last.len() {
            episodes.push(start..row + 1);
            start = row + 1;
        }
    }
    episodes
}

#[cfg(test)]
mod tests {
    use std::fs;

    use hdf5_pure::FileBuilder;

    use super::*;
    use crate::d4rl::write::made::{ROWS, written};

    #[test]
    fn a_value_that_is_not_finite_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let path = written(folder.path(), |o| o[3 * OBSERVATION + 7] = f32::NAN);
        let error = read(&path).unwrap_err();
        assert!(
            matches!(
                error,
                DatasetError::NotFinite {
                    key: "observations",
                    row: 3,
                    ..
                }
            ),
            "{error}"
        );
        assert!(
            error.to_string().contains("small.hdf5: 'observations'"),
            "{error}"
        );
    }

    #[test]
    fn missing_keys_wrong_shapes_and_no_rows_are_named() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("x.hdf5");
        let with = |width: u64, actions: Option<u64>| {
            let mut builder = FileBuilder::new();
            let zeros = vec![0.0_f32; 2 * width as usize];
            builder
                .create_dataset("observations")
                .with_f32_data(&zeros)
                .with_shape(&[2, width]);
            if let Some(rows) = actions {
                let zeros = vec![0.0_f32; 8 * rows as usize];
                builder
                    .create_dataset("actions")
                    .with_f32_data(&zeros)
                    .with_shape(&[rows, 8]);
            }
            builder.write(&path).unwrap();
            read(&path).unwrap_err()
        };
        let missing = with(29, None);
        assert!(
            matches!(missing, DatasetError::Key { key: "actions", .. }),
            "{missing}"
        );
        assert!(missing.to_string().contains("is missing"), "{missing}");
        let missing = with(29, Some(2));
        assert!(
            matches!(missing, DatasetError::Key { key: "rewards", .. }),
            "{missing}"
        );
        assert!(matches!(
            with(27, None),
            DatasetError::Shape {
                key: "observations",
                ..
            }
        ));
        let unequal = with(29, Some(3));
        assert!(matches!(
            unequal,
            DatasetError::Shape { key: "actions", .. }
        ));
        assert!(
            unequal.to_string().contains("[3, 8], expected [2, 8]"),
            "{unequal}"
        );
        let none = read(&folder.path().join("none.hdf5")).unwrap_err();
        assert!(matches!(none, DatasetError::Io { .. }));
    }

    /// A file of four rows, the torso at x = 0, 1, 9, 10, with arrays in other types than ours.
    fn of_other_types(
        path: &Path,
        flags: impl FnOnce(&mut FileBuilder),
    ) -> Result<Dataset, DatasetError> {
        let mut builder = FileBuilder::new();
        let mut observations = vec![0.0_f64; 4 * OBSERVATION];
        for (row, x) in [0.0, 1.0, 9.0, 10.0].into_iter().enumerate() {
            observations[row * OBSERVATION] = x;
        }
        builder
            .create_dataset("observations")
            .with_f64_data(&observations)
            .with_shape(&[4, 29]);
        builder
            .create_dataset("actions")
            .with_f32_data(&[0.0; 32])
            .with_shape(&[4, 8]);
        builder
            .create_dataset("rewards")
            .with_f64_data(&[0.0, 0.5, 1.0, 0.0])
            .with_shape(&[4, 1]);
        flags(&mut builder);
        builder.write(path).unwrap();
        read(path)
    }

    #[test]
    fn without_timeouts_a_jump_ends_an_episode_and_terminals_never_do() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("x.hdf5");
        let data = of_other_types(&path, |builder| {
            builder
                .create_dataset("terminals")
                .with_f64_data(&[0.0, 1.0, 1.0, 0.0]);
        })
        .unwrap();
        assert_eq!(data.episodes, [0..2, 2..4]);
        assert_eq!(data.terminals, [false, true, true, false]);
        assert_eq!(data.rewards, [0.0, 0.5, 1.0, 0.0]);
        assert!(data.goals.is_empty());
        assert_eq!(data.place(2), [9.0, 0.0]);
    }

    #[test]
    fn timeouts_overrule_jumps_and_the_rest_is_an_episode() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("x.hdf5");
        let data = of_other_types(&path, |builder| {
            builder
                .create_dataset("terminals")
                .with_u8_data(&[0, 1, 0, 0]);
            builder
                .create_dataset("timeouts")
                .with_i32_data(&[1, 0, 0, 0]);
        })
        .unwrap();
        assert_eq!(data.episodes, [0..1, 1..4]);
        let error = of_other_types(&path, |builder| {
            builder
                .create_dataset("terminals")
                .with_u8_data(&[0, 1, 0, 0]);
            builder.create_dataset("timeouts").with_i32_data(&[1, 0, 0]);
        })
        .unwrap_err();
        assert!(
            matches!(
                error,
                DatasetError::Shape {
                    key: "timeouts",
                    ..
                }
            ),
            "{error}"
        );
    }

    #[test]
    fn cut_and_flipped_files_are_errors_or_sound_never_a_panic() {
        let folder = tempfile::tempdir().unwrap();
        let path = written(folder.path(), |_| {});
        let bytes = fs::read(&path).unwrap();
        let damaged = folder.path().join("damaged.hdf5");
        for length in (0..bytes.len()).step_by(13) {
            fs::write(&damaged, &bytes[..length]).unwrap();
            assert!(read(&damaged).is_err(), "cut at {length}");
        }
        let mut errors = 0;
        for at in 0..bytes.len() {
            for mask in [0x01, 0x5a, 0xff] {
                let mut flipped = bytes.clone();
                flipped[at] ^= mask;
                fs::write(&damaged, &flipped).unwrap();
                match read(&damaged) {
                    Ok(data) => {
                        assert_eq!(data.observations.len(), ROWS * OBSERVATION);
                        assert_eq!(data.actions.len(), ROWS * ACTION);
                        assert_eq!(data.episodes.last().map(|e| e.end), Some(ROWS));
                    }
                    Err(_) => errors += 1,
                }
            }
        }
        // Metadata and deflated chunks carry checksums.
        assert!(
            errors > bytes.len(),
            "{errors} errors in {} bytes",
            bytes.len()
        );
    }
}
