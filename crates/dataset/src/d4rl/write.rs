//! Writes whole data sets in D4RL's layout.

use std::path::Path;

use durable::{Existing, Output, Staged};
use hdf5_pure::{DatasetBuilder, Datatype, EnumTypeBuilder, Error, FileBuilder};

use super::{QPOS, QVEL};
use crate::{ACTION, Dataset, DatasetError, Made, OBSERVATION};

/// Rows to write; all arrays flat.
#[derive(Debug, Clone, Copy)]
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
    /// `[n, 2]`, or empty where there is none.
    pub goals: &'a [f32],
    /// `[n, 15]`, after the action, as D4RL's script has it.
    pub qpos: &'a [f32],
    /// `[n, 14]`, after the action.
    pub qvel: &'a [f32],
}

impl Rows<'_> {
    /// All arrays have as many rows as there are rewards.
    fn check(&self, path: &Path) -> Result<(), DatasetError> {
        let n = self.rewards.len();
        let lengths = [
            ("observations", self.observations.len(), OBSERVATION),
            ("actions", self.actions.len(), ACTION),
            ("terminals", self.terminals.len(), 1),
            ("timeouts", self.timeouts.len(), 1),
            ("infos/goal", self.goals.len(), 2),
            ("infos/qpos", self.qpos.len(), QPOS),
            ("infos/qvel", self.qvel.len(), QVEL),
        ];
        match lengths.into_iter().find(|(key, length, width)| {
            *length != n * width && (*key != "infos/goal" || *length != 0)
        }) {
            Some((key, length, width)) => Err(DatasetError::Shape {
                path: path.to_path_buf(),
                key: key.to_owned(),
                got: vec![length as u64],
                expected: format!(
                    "[{n}, {width}] flat, {} values, as 'rewards' has",
                    n * width
                ),
            }),
            None => Ok(()),
        }
    }
}

/// Rows of a chunk: whole rows together, unlike h5py's own guess, so that ranges read fast.
const CHUNK: u64 = 8192;

/// Deflate level: higher ones take minutes for a million rows and save little.
const LEVEL: u32 = 1;

/// Writes rows in D4RL's layout to a path where nothing is: it is whole, or nothing.
/// `infos/goal` is left out where there is no goal.
///
/// # Errors
/// Arrays of unequal length, something at `path`, and what the system or the format refuses.
pub fn write_rows(path: &Path, rows: &Rows<'_>) -> Result<(), DatasetError> {
    rows.check(path)?;
    let output = Output::file(path, Existing::Refuse, &[])?;
    Ok(stage_rows(&output, rows, None)?.place()?)
}

/// [`write_rows`], with how they were `made` as attributes of the file's root, up to the point where
/// the file is put in its place.
///
/// # Errors
/// Arrays of unequal length, and what the system or the format refuses.
pub fn stage_rows(
    output: &Output,
    rows: &Rows<'_>,
    made: Option<&Made>,
) -> Result<Staged, DatasetError> {
    let path = output.path();
    rows.check(path)?;
    let mut builder = layout(rows).map_err(|error| failed(path, error))?;
    if let Some(made) = made {
        made.write(&mut builder);
    }
    output.stage(|file| builder.finish_to(file).map_err(|error| failed(path, error)))
}

/// Writes a data set in D4RL's layout, as [`write_rows`] does. `infos/qpos` and `infos/qvel` are of
/// the state after the action, which for an episode's last row is not known: its own stands there.
///
/// # Errors
/// Something at `path`, and what the system or the format refuses.
pub fn write(path: &Path, data: &Dataset) -> Result<(), DatasetError> {
    let output = Output::file(path, Existing::Refuse, &[])?;
    Ok(stage(&output, data)?.place()?)
}

/// [`write()`], up to the point where the file is put in its place.
pub(crate) fn stage(output: &Output, data: &Dataset) -> Result<Staged, DatasetError> {
    let mut timeouts = vec![0; data.len()];
    let (mut qpos, mut qvel) = (vec![], vec![]);
    for episode in &data.episodes {
        timeouts[episode.end - 1] = 1;
        for row in episode.clone() {
            let after = data.observation((row + 1).min(episode.end - 1));
            qpos.extend_from_slice(&after[..QPOS]);
            qvel.extend_from_slice(&after[QPOS..]);
        }
    }
    let terminals: Vec<u8> = data.terminals.iter().map(|flag| u8::from(*flag)).collect();
    let rows = Rows {
        observations: &data.observations,
        actions: &data.actions,
        rewards: &data.rewards,
        terminals: &terminals,
        timeouts: &timeouts,
        goals: data.goals.as_flattened(),
        qpos: &qpos,
        qvel: &qvel,
    };
    stage_rows(output, &rows, None)
}

/// What hdf5-pure refused.
pub(crate) fn failed(path: &Path, error: Error) -> DatasetError {
    let path = path.to_path_buf();
    match error {
        Error::Io(source) => DatasetError::Io { path, source },
        error => DatasetError::Format {
            path,
            reason: format!("cannot be written: {error}"),
        },
    }
}

fn layout(rows: &Rows<'_>) -> Result<FileBuilder, Error> {
    let n = rows.rewards.len() as u64;
    let mut builder = FileBuilder::new();
    let array = builder.create_dataset("observations");
    compress(
        array.with_f32_data(rows.observations),
        &[n, OBSERVATION as u64],
    );
    let array = builder.create_dataset("actions");
    compress(array.with_f32_data(rows.actions), &[n, ACTION as u64]);
    let array = builder.create_dataset("rewards");
    compress(array.with_f32_data(rows.rewards), &[n]);
    for (name, values) in [("terminals", rows.terminals), ("timeouts", rows.timeouts)] {
        let array = builder.create_dataset(name);
        compress(array.with_enum_u8_data(bools()?, values), &[n]);
    }
    let mut infos = builder.create_group("infos");
    for (name, values, width) in [
        ("goal", rows.goals, 2),
        ("qpos", rows.qpos, QPOS),
        ("qvel", rows.qvel, QVEL),
    ] {
        if values.is_empty() && n > 0 {
            continue;
        }
        let array = infos.create_dataset(name);
        compress(array.with_f32_data(values), &[n, width as u64]);
    }
    builder.add_group(infos.finish());
    Ok(builder)
}

/// What h5py takes for a bool.
pub(crate) fn bools() -> Result<Datatype, Error> {
    let bools = EnumTypeBuilder::u8_based();
    Ok(bools.u8_value("FALSE", 0).u8_value("TRUE", 1).build()?)
}

/// Stores an array of this shape in deflated chunks of whole rows.
pub(crate) fn compress(array: &mut DatasetBuilder, shape: &[u64]) {
    let mut chunk = shape.to_vec();
    if let Some(rows) = chunk.first_mut() {
        *rows = CHUNK.min((*rows).max(1));
    }
    array
        .with_shape(shape)
        .with_chunks(&chunk)
        .with_deflate(LEVEL);
}

/// Files made up for tests.
#[cfg(test)]
pub(crate) mod made {
    use std::path::PathBuf;

    use super::*;

    /// Three episodes of four rows.
    pub(crate) const ROWS: usize = 12;

    /// Such a file; `damage` changes its observations.
    pub(crate) fn written(folder: &Path, damage: impl FnOnce(&mut Vec<f32>)) -> PathBuf {
        let mut observations: Vec<f32> = (0..ROWS * OBSERVATION)
            .map(|i| (i % 97) as f32 * 0.01)
            .collect();
        damage(&mut observations);
        let timeouts: Vec<u8> = (0..ROWS).map(|row| u8::from(row % 4 == 3)).collect();
        let terminals: Vec<u8> = (0..ROWS).map(|row| u8::from(row % 5 == 1)).collect();
        let path = folder.join("small.hdf5");
        let rows = Rows {
            observations: &observations,
            actions: &[0.5; ROWS * ACTION],
            rewards: &[0.25; ROWS],
            terminals: &terminals,
            timeouts: &timeouts,
            goals: &[3.0; ROWS * 2],
            qpos: &[1.0; ROWS * QPOS],
            qvel: &[2.0; ROWS * QVEL],
        };
        write_rows(&path, &rows).unwrap();
        path
    }
}

#[cfg(test)]
mod tests {
    use std::fs;

    use hdf5_pure::File;

    use super::made::{ROWS, written};
    use super::*;
    use crate::d4rl::read;

    #[test]
    fn what_is_written_is_read() {
        let folder = tempfile::tempdir().unwrap();
        let path = written(folder.path(), |_| {});
        let data = read(&path).unwrap();
        assert_eq!(
            (data.len(), data.episodes.as_slice()),
            (12, &[0..4, 4..8, 8..12][..])
        );
        assert_eq!(data.goals[5], [3.0, 3.0]);
        assert_eq!(data.observation(1)[0], 0.29);
        assert_eq!(data.action(3), [0.5; 8]);
        assert_eq!(data.rewards, [0.25; ROWS]);
        let marked: Vec<usize> = (0..ROWS).filter(|row| data.terminals[*row]).collect();
        assert_eq!(marked, [1, 6, 11]);
        let file = File::open(&path).unwrap();
        let qpos = file.dataset("infos/qpos").unwrap();
        assert_eq!(qpos.shape().unwrap(), [12, 15]);
        assert_eq!(qpos.read_f32().unwrap(), [1.0; ROWS * QPOS]);
        let names: Vec<_> = fs::read_dir(folder.path())
            .unwrap()
            .map(|e| e.unwrap().file_name())
            .collect();
        assert_eq!(names, ["small.hdf5"]);
    }

    #[test]
    fn several_chunks_and_a_short_last_one_are_read_as_written() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("new/chunks.hdf5");
        let n = 2 * CHUNK as usize + 5;
        let count = |width: usize| {
            (0..n * width)
                .map(|i| (i % 2039) as f32 * 1e-3)
                .collect::<Vec<f32>>()
        };
        let rows = Rows {
            observations: &count(OBSERVATION),
            actions: &count(ACTION),
            rewards: &count(1),
            terminals: &vec![0; n],
            timeouts: &vec![0; n],
            goals: &count(2),
            qpos: &count(QPOS),
            qvel: &count(QVEL),
        };
        write_rows(&path, &rows).unwrap();
        let data = read(&path).unwrap();
        assert_eq!(data.observations, rows.observations);
        assert_eq!(data.actions, rows.actions);
        assert_eq!(data.rewards, rows.rewards);
        assert_eq!(data.goals.as_flattened(), rows.goals);
        assert_eq!(data.episodes.as_slice(), std::slice::from_ref(&(0..n)));
    }

    #[test]
    fn arrays_of_unequal_length_are_refused_and_leave_the_old_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = written(folder.path(), |_| {});
        let before = fs::read(&path).unwrap();
        let rows = Rows {
            observations: &[0.0; 2 * OBSERVATION],
            actions: &[0.0; 2 * ACTION],
            rewards: &[0.0; 2],
            terminals: &[0; 2],
            timeouts: &[0; 2],
            goals: &[0.0; 4],
            qpos: &[0.0; 2 * QPOS],
            qvel: &[0.0; 2 * QVEL + 1],
        };
        let error = write_rows(&path, &rows).unwrap_err();
        assert!(
            matches!(
                error,
                DatasetError::Shape { ref key, .. } if key == "infos/qvel"
            ),
            "{error}"
        );
        assert_eq!(fs::read(&path).unwrap(), before);
    }

    #[test]
    fn a_file_without_rows_is_no_data_set() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("empty.hdf5");
        let rows = Rows {
            observations: &[],
            actions: &[],
            rewards: &[],
            terminals: &[],
            timeouts: &[],
            goals: &[],
            qpos: &[],
            qvel: &[],
        };
        write_rows(&path, &rows).unwrap();
        let error = read(&path).unwrap_err();
        assert!(error.to_string().contains("no episode"), "{error}");
    }
}
