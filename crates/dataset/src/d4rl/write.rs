//! Writes whole data sets in D4RL's layout.

use std::path::Path;

use durable::{Existing, Output, Staged};
use hdf5_pure::{DatasetBuilder, Datatype, EnumTypeBuilder, Error, FileBuilder};

use crate::{Dataset, DatasetError, Element, Made};

/// Rows to write; all arrays flat. Widths are the arrays' lengths by the number of rewards.
#[derive(Debug, Clone, Copy)]
pub struct Rows<'a> {
    /// `[n, observation]`, before the action.
    pub observations: &'a [f32],
    /// `[n, action]`.
    pub actions: &'a [f32],
    /// `[n]`.
    pub rewards: &'a [f32],
    /// `[n]`, 1 in the rows that D4RL marks as success.
    pub terminals: &'a [u8],
    /// `[n]`, 1 in each episode's last row.
    pub timeouts: &'a [u8],
    /// `[n, 2]`, or empty where there is none.
    pub goals: &'a [f32],
    /// Positions, after the action, as D4RL's script has them; or empty.
    pub qpos: &'a [f32],
    /// Velocities, after the action; or empty.
    pub qvel: &'a [f32],
}

impl Rows<'_> {
    /// All arrays have as many rows as there are rewards.
    fn check(&self, path: &Path) -> Result<(), DatasetError> {
        let n = self.rewards.len();
        let exactly = [
            ("terminals", self.terminals.len(), 1),
            ("timeouts", self.timeouts.len(), 1),
            ("infos/goal", self.goals.len(), 2),
        ];
        let of_any_width = [
            ("observations", self.observations.len()),
            ("actions", self.actions.len()),
            ("infos/qpos", self.qpos.len()),
            ("infos/qvel", self.qvel.len()),
        ];
        let wrong = exactly
            .into_iter()
            .find(|(key, length, width)| {
                *length != n * width && (*key != "infos/goal" || *length != 0)
            })
            .map(|(key, length, width)| (key, length, width.to_string()))
            .or_else(|| {
                let mut lengths = of_any_width.into_iter();
                let (key, length) = lengths.find(|(_, length)| length % n.max(1) != 0)?;
                Some((key, length, "any width".to_owned()))
            });
        match wrong {
            Some((key, length, width)) => Err(DatasetError::Shape {
                path: path.to_path_buf(),
                key: key.to_owned(),
                got: vec![length as u64],
                expected: format!("[{n}, {width}] flat, as many rows as 'rewards' has"),
            }),
            None => Ok(()),
        }
    }
}

/// Rows of a chunk: whole rows together, unlike h5py's own guess, so that ranges read fast.
const CHUNK: u64 = 8192;
/// Values of a chunk at most: of images fewer rows fit.
const CHUNK_VALUES: u64 = 1 << 20;

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
    let builder = layout(rows).map_err(|error| failed(path, error))?;
    stage_layout(output, builder, made)
}

fn stage_layout(
    output: &Output,
    mut builder: FileBuilder,
    made: Option<&Made>,
) -> Result<Staged, DatasetError> {
    let path = output.path();
    if let Some(made) = made {
        made.write(&mut builder);
    }
    output.stage(|file| builder.finish_to(file).map_err(|error| failed(path, error)))
}

/// Writes a data set in D4RL's layout, as [`write_rows`] does. `infos/qpos` and `infos/qvel` are of
/// the state after the action, which for an episode's last row is not known: its own stands there.
/// They are left out where an observation is not known to be positions and velocities.
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
    let positions = data.shape().positions();
    for episode in &data.episodes {
        timeouts[episode.end - 1] = 1;
        let Some(positions) = positions else { continue };
        for row in episode.clone() {
            let after = data.observation((row + 1).min(episode.end - 1));
            let (position, velocity) = after.split_at(positions);
            qpos.extend_from_slice(position);
            qvel.extend_from_slice(velocity);
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
    if data.shape().element() == Element::F32 {
        return stage_rows(output, &rows, None);
    }
    let path = output.path();
    let builder = images(data, &rows).map_err(|error| failed(path, error))?;
    stage_layout(output, builder, None)
}

/// [`layout`] of images.
fn images(data: &Dataset, rows: &Rows<'_>) -> Result<FileBuilder, Error> {
    let n = data.len() as u64;
    let mut builder = FileBuilder::new();
    let sides = data.shape().sides().iter().map(|side| *side as u64);
    let shape: Vec<u64> = std::iter::once(n).chain(sides).collect();
    let array = builder.create_dataset("observations");
    compress(array.with_u8_data(&data.images), &shape);
    let places = [("xy", data.image_places.as_flattened(), 2)];
    rest(&mut builder, rows, &places)?;
    Ok(builder)
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
    let n = rows.rewards.len();
    let mut builder = FileBuilder::new();
    let width = |values: &[f32]| values.len() / n.max(1);
    let array = builder.create_dataset("observations");
    compress(
        array.with_f32_data(rows.observations),
        &[n as u64, width(rows.observations) as u64],
    );
    let states = [
        ("qpos", rows.qpos, width(rows.qpos)),
        ("qvel", rows.qvel, width(rows.qvel)),
    ];
    rest(&mut builder, rows, &states)?;
    Ok(builder)
}

/// All keys but `observations`, with some more in `infos`.
fn rest(
    builder: &mut FileBuilder,
    rows: &Rows<'_>,
    more: &[(&str, &[f32], usize)],
) -> Result<(), Error> {
    let n = rows.rewards.len() as u64;
    let width = rows.actions.len() as u64 / n.max(1);
    let array = builder.create_dataset("actions");
    compress(array.with_f32_data(rows.actions), &[n, width]);
    let array = builder.create_dataset("rewards");
    compress(array.with_f32_data(rows.rewards), &[n]);
    for (name, values) in [("terminals", rows.terminals), ("timeouts", rows.timeouts)] {
        let array = builder.create_dataset(name);
        compress(array.with_enum_u8_data(bools()?, values), &[n]);
    }
    let mut infos = builder.create_group("infos");
    let goal = ("goal", rows.goals, 2);
    for (name, values, width) in std::iter::once(&goal).chain(more) {
        if values.is_empty() {
            continue;
        }
        let array = infos.create_dataset(name);
        compress(array.with_f32_data(values), &[n, *width as u64]);
    }
    builder.add_group(infos.finish());
    Ok(())
}

/// What h5py takes for a bool.
pub(crate) fn bools() -> Result<Datatype, Error> {
    let bools = EnumTypeBuilder::u8_based();
    Ok(bools.u8_value("FALSE", 0).u8_value("TRUE", 1).build()?)
}

/// Stores an array of this shape in deflated chunks of whole rows.
pub(crate) fn compress(array: &mut DatasetBuilder, shape: &[u64]) {
    let mut chunk = shape.to_vec();
    if let Some((rows, sides)) = chunk.split_first_mut() {
        let most = CHUNK_VALUES / sides.iter().product::<u64>().max(1);
        *rows = CHUNK.min(most).min(*rows).max(1);
        // A side of a chunk is never 0.
        sides.iter_mut().for_each(|side| *side = (*side).max(1));
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

    use maze::{ACTION, OBSERVATION};

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
            qpos: &[1.0; ROWS * 15],
            qvel: &[2.0; ROWS * 14],
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
        assert_eq!(qpos.read_f32().unwrap(), [1.0; ROWS * 15]);
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
            observations: &count(29),
            actions: &count(8),
            rewards: &count(1),
            terminals: &vec![0; n],
            timeouts: &vec![0; n],
            goals: &count(2),
            qpos: &count(15),
            qvel: &count(14),
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
            observations: &[0.0; 2 * 29],
            actions: &[0.0; 2 * 8],
            rewards: &[0.0; 2],
            terminals: &[0; 2],
            timeouts: &[0; 2],
            goals: &[0.0; 4],
            qpos: &[0.0; 2 * 15],
            qvel: &[0.0; 2 * 14 + 1],
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
