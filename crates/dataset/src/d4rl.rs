//! D4RL's HDF5 layout (Farama-Foundation/d4rl, `scripts/generation/generate_ant_maze_datasets.py`,
//! `d4rl/offline_env.py`): flat arrays, episodes ended by `timeouts`.

use std::fs::{self, File as SystemFile};
use std::path::Path;

use hdf5_pure::{EnumTypeBuilder, File, FileBuilder};

use crate::{ACTION, Dataset, DatasetError, OBSERVATION};

/// Jump of the torso between two rows that only a reset can make (m); ends an episode in files
/// without `timeouts`.
const JUMP: f32 = 5.0;

struct Reader<'p> {
    path: &'p Path,
    file: File,
}

impl Reader<'_> {
    fn key(&self, key: &'static str, reason: impl std::fmt::Display) -> DatasetError {
        DatasetError::Key {
            path: self.path.to_path_buf(),
            key,
            reason: reason.to_string(),
        }
    }

    fn has(&self, key: &str) -> bool {
        self.file.dataset(key).is_ok()
    }

    /// All values of a key, whatever their number type; h5py's bools are 0 and 1.
    fn values(
        &self,
        key: &'static str,
        rows: Option<usize>,
        width: usize,
    ) -> Result<Vec<f32>, DatasetError> {
        let dataset = self
            .file
            .dataset(key)
            .map_err(|error| self.key(key, error))?;
        let shape = dataset.shape().map_err(|error| self.key(key, error))?;
        // Rewards come as (n,) and as (n, 1).
        let columns: u64 = shape.iter().skip(1).product();
        let found = shape.first().copied().unwrap_or(0);
        let fits = columns == width as u64 && rows.is_none_or(|rows| rows as u64 == found);
        if shape.is_empty() || !fits {
            let rows = rows.map_or("n".to_owned(), |rows| rows.to_string());
            let expected = format!("[{rows}, {width}]");
            let path = self.path.to_path_buf();
            return Err(DatasetError::Shape {
                path,
                key,
                got: shape,
                expected,
            });
        }
        let values = dataset.read_f32().map_err(|error| self.key(key, error))?;
        if values.len() as u64 != found * columns {
            return Err(self.key(key, format!("{} values in shape {shape:?}", values.len())));
        }
        match values.iter().position(|value| !value.is_finite()) {
            Some(at) => Err(DatasetError::NotFinite {
                path: self.path.to_path_buf(),
                key,
                row: at / width.max(1),
            }),
            None => Ok(values),
        }
    }
}

/// Reads a file in D4RL's layout.
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
            "cut off: {length} of {whole} bytes are there"
        )));
    }
    let reader = Reader { path, file };
    let observations = reader.values("observations", None, OBSERVATION)?;
    let n = observations.len() / OBSERVATION;
    let actions = reader.values("actions", Some(n), ACTION)?;
    let rewards = reader.values("rewards", Some(n), 1)?;
    reader.values("terminals", Some(n), 1)?;
    let place = |row: usize| {
        [
            observations[row * OBSERVATION],
            observations[row * OBSERVATION + 1],
        ]
    };
    let ends: Vec<usize> = if reader.has("timeouts") {
        let timeouts = reader.values("timeouts", Some(n), 1)?;
        (0..n).filter(|row| timeouts[*row] > 0.0).collect()
    } else {
        let far = |row: &usize| {
            let ([x, y], [u, v]) = (place(*row), place(row + 1));
            (x - u).hypot(y - v) > JUMP
        };
        (0..n.saturating_sub(1)).filter(far).collect()
    };
    let mut episodes = vec![];
    let mut start = 0;
    for end in ends {
        episodes.push(start..end + 1);
        start = end + 1;
    }
    if start < n {
        episodes.push(start..n);
    }
    if episodes.is_empty() {
        return Err(format("no episode: it has no row".to_owned()));
    }
    let goals = if reader.has("infos/goal") {
        let goals = reader.values("infos/goal", Some(n), 2)?;
        goals.as_chunks::<2>().0.to_vec()
    } else {
        vec![]
    };
    Ok(Dataset {
        observations,
        actions,
        rewards,
        episodes,
        goals,
    })
}

/// Rows to write; all arrays flat.
pub struct Rows<'a> {
    /// `[n, 29]`, before the action.
    pub observations: &'a [f32],
    /// `[n, 8]`.
    pub actions: &'a [f32],
    /// `[n]`.
    pub rewards: &'a [f32],
    /// `[n]`, 1 in the rows that D4RL marks as success.
    pub terminals: &'a [u8],
    /// `[n]`, 1 in each episode's last row.
    pub timeouts: &'a [u8],
    /// `[n, 2]`.
    pub goals: &'a [f32],
    /// `[n, 15]`, after the action, as D4RL's script has it.
    pub qpos: &'a [f32],
    /// `[n, 14]`, after the action.
    pub qvel: &'a [f32],
}

/// Rows of a chunk: whole rows together, unlike h5py's own guess, so that ranges read fast.
const CHUNK: u64 = 8192;

/// Writes a file in D4RL's layout beside `path`, syncs and renames.
///
/// # Errors
/// What the system or the format refuses.
pub fn write(path: &Path, rows: &Rows<'_>) -> Result<(), DatasetError> {
    let n = rows.rewards.len() as u64;
    let chunk = CHUNK.min(n.max(1));
    let mut builder = FileBuilder::new();
    let floats = |builder: &mut FileBuilder, name: &str, values: &[f32], width: u64| {
        let dataset = builder.create_dataset(name).with_f32_data(values);
        if width == 0 {
            dataset
                .with_shape(&[n])
                .with_chunks(&[chunk])
                .with_deflate(1);
        } else {
            dataset
                .with_shape(&[n, width])
                .with_chunks(&[chunk, width])
                .with_deflate(1);
        }
    };
    floats(
        &mut builder,
        "observations",
        rows.observations,
        OBSERVATION as u64,
    );
    floats(&mut builder, "actions", rows.actions, ACTION as u64);
    floats(&mut builder, "rewards", rows.rewards, 0);
    for (name, values) in [("terminals", rows.terminals), ("timeouts", rows.timeouts)] {
        // h5py's bool.
        let bools = EnumTypeBuilder::u8_based()
            .u8_value("FALSE", 0)
            .u8_value("TRUE", 1)
            .build()
            .map_err(|error| DatasetError::Format {
                path: path.to_path_buf(),
                reason: format!("cannot be written: {error}"),
            })?;
        let dataset = builder
            .create_dataset(name)
            .with_enum_u8_data(bools, values);
        dataset
            .with_shape(&[n])
            .with_chunks(&[chunk])
            .with_deflate(1);
    }
    let mut infos = builder.create_group("infos");
    for (name, values, width) in [
        ("goal", rows.goals, 2),
        ("qpos", rows.qpos, 15),
        ("qvel", rows.qvel, 14),
    ] {
        let dataset = infos.create_dataset(name).with_f32_data(values);
        dataset
            .with_shape(&[n, width])
            .with_chunks(&[chunk, width])
            .with_deflate(1);
    }
    builder.add_group(infos.finish());
    let io = |source| DatasetError::Io {
        path: path.to_path_buf(),
        source,
    };
    if let Some(folder) = path.parent() {
        fs::create_dir_all(folder).map_err(io)?;
    }
    let part = path.with_extension("part");
    builder.write(&part).map_err(|error| DatasetError::Format {
        path: path.to_path_buf(),
        reason: format!("cannot be written: {error}"),
    })?;
    SystemFile::open(&part)
        .and_then(|file| file.sync_all())
        .map_err(io)?;
    fs::rename(&part, path).map_err(io)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Three episodes of four rows.
    fn written(folder: &Path, damage: impl FnOnce(&mut Vec<f32>)) -> std::path::PathBuf {
        let n = 12;
        let mut observations: Vec<f32> = (0..n * OBSERVATION)
            .map(|i| (i % 97) as f32 * 0.01)
            .collect();
        damage(&mut observations);
        let timeouts: Vec<u8> = (0..n).map(|row| u8::from(row % 4 == 3)).collect();
        let path = folder.join("small.hdf5");
        let rows = Rows {
            observations: &observations,
            actions: &vec![0.5; n * ACTION],
            rewards: &vec![0.0; n],
            terminals: &vec![0; n],
            timeouts: &timeouts,
            goals: &vec![3.0; n * 2],
            qpos: &vec![1.0; n * 15],
            qvel: &vec![2.0; n * 14],
        };
        write(&path, &rows).unwrap();
        path
    }

    #[test]
    fn what_is_written_is_read() {
        let folder = tempfile::tempdir().unwrap();
        let data = read(&written(folder.path(), |_| {})).unwrap();
        assert_eq!(
            (data.len(), data.episodes.as_slice()),
            (12, &[0..4, 4..8, 8..12][..])
        );
        assert_eq!(data.goals[5], [3.0, 3.0]);
        assert_eq!(data.observation(1)[0], 0.29);
        assert_eq!(data.action(3), [0.5; 8]);
    }

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
    }

    #[test]
    fn missing_keys_wrong_shapes_and_no_rows_are_named() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("x.hdf5");
        let with = |width: u64, actions: bool| {
            let mut builder = FileBuilder::new();
            let zeros = vec![0.0_f32; 2 * width as usize];
            builder
                .create_dataset("observations")
                .with_f32_data(&zeros)
                .with_shape(&[2, width]);
            if actions {
                builder
                    .create_dataset("actions")
                    .with_f32_data(&[0.0; 24])
                    .with_shape(&[3, 8]);
            }
            builder.write(&path).unwrap();
            read(&path).unwrap_err()
        };
        assert!(matches!(
            with(29, false),
            DatasetError::Key { key: "actions", .. }
        ));
        assert!(matches!(
            with(27, false),
            DatasetError::Shape {
                key: "observations",
                ..
            }
        ));
        assert!(matches!(
            with(29, true),
            DatasetError::Shape { key: "actions", .. }
        ));
        let none = read(&folder.path().join("none.hdf5")).unwrap_err();
        assert!(matches!(none, DatasetError::Io { .. }));
    }

    #[test]
    fn cut_and_flipped_files_are_errors_or_sound_never_a_panic() {
        let folder = tempfile::tempdir().unwrap();
        let path = written(folder.path(), |_| {});
        let bytes = fs::read(&path).unwrap();
        let damaged = folder.path().join("damaged.hdf5");
        for length in (0..bytes.len()).step_by(61) {
            fs::write(&damaged, &bytes[..length]).unwrap();
            assert!(read(&damaged).is_err(), "cut at {length}");
        }
        for at in (0..bytes.len()).step_by(7) {
            let mut flipped = bytes.clone();
            flipped[at] ^= 0x5a;
            fs::write(&damaged, &flipped).unwrap();
            if let Ok(data) = read(&damaged) {
                assert_eq!(data.observations.len(), data.len() * OBSERVATION);
            }
        }
    }
}
