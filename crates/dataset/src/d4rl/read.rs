//! Reads files of D4RL and of [`write`](super::write()).

use std::fs;
use std::path::Path;

use super::next;
use crate::error::io_error;
use crate::fault::Faults;
use crate::hdf5::{Key, OtherFiles, Reader, Width};
use crate::{ACTION, Dataset, DatasetError, Dropped, OBSERVATION, OnFault, episodes};

/// What is said where a key is missing.
const LAYOUT: &str = "D4RL's layout wants observations, actions, rewards and terminals, Minari's \
                      the groups episode_0, episode_1 and so on, OGBench's an npz file";

/// Jump of the torso between two rows that only a reset can make (m).
const JUMP: f32 = 5.0;

/// Reads a file in D4RL's layout: `observations`, `actions`, `rewards`, `terminals`, and where
/// they are there `timeouts` and `infos/goal`. Numbers and bools of any type are taken.
///
/// An episode ends with its row of `timeouts`, and where the torso jumps by more than 5 m: files of
/// v0 lack `timeouts` or have them out of step with the resets. So it does where
/// `next_observations`, which D4RL's `qlearning_dataset` adds, is not the row after. `terminals` end
/// none.
///
/// # Errors
/// Anything that is wrong with the file, by key and row.
pub fn read(path: &Path) -> Result<Dataset, DatasetError> {
    let bytes = fs::read(path).map_err(|error| io_error(path, error))?;
    let reader = Reader::open(path, bytes, OtherFiles::Follow)?;
    from_reader(&reader, OnFault::Refuse).map(|(data, _)| data)
}

/// [`read`] of a file's bytes; `path` is what errors name, and links to other files are refused.
///
/// # Errors
/// Anything that is wrong with them, by key and row.
pub fn read_bytes(path: &Path, bytes: Vec<u8>) -> Result<Dataset, DatasetError> {
    let reader = Reader::open(path, bytes, OtherFiles::Refuse)?;
    from_reader(&reader, OnFault::Refuse).map(|(data, _)| data)
}

/// [`read`] of an open file.
pub(crate) fn from_reader(
    reader: &Reader<'_>,
    on_fault: OnFault,
) -> Result<(Dataset, Dropped), DatasetError> {
    let root = reader.root()?;
    let key = |name, rows, width| reader.key(&root, name, rows, Width::Exactly(width), LAYOUT);
    let optional = |name, rows, width| reader.optional(&root, name, rows, Width::Exactly(width));
    // All shapes before any value: a length that is wrong then disagrees before it is allocated.
    let observations = key("observations", None, OBSERVATION)?;
    let n = Some(observations.rows);
    let actions = key("actions", n, ACTION)?;
    let rewards = key("rewards", n, 1)?;
    let terminals = key("terminals", n, 1)?;
    let timeouts = optional("timeouts", n, 1)?;
    let goals = optional("infos/goal", n, 2)?;
    if n == Some(0) {
        return Err(reader.refuse("no episode: its arrays have no row"));
    }
    let faults = Faults::new(on_fault);
    let one = |key: Option<Key>, faults: &Faults| {
        let values = key.map(|key| reader.values([&key], faults));
        values
            .transpose()
            .map(|values| values.map(|[values]| values))
    };
    let [observations, actions, rewards, terminals] =
        reader.values([&observations, &actions, &rewards, &terminals], &faults)?;
    let mut last = jumps(&observations);
    let next = optional("next_observations", n, OBSERVATION).ok().flatten();
    next::mark(reader, next.as_ref(), &observations, &mut last);
    // Without the marks of their ends episodes cannot be told apart.
    let ends = one(timeouts, &Faults::new(OnFault::Refuse))?;
    for (last, timeout) in last.iter_mut().zip(ends.unwrap_or_default()) {
        *last |= timeout > 0.0;
    }
    let data = Dataset {
        observations,
        actions,
        rewards,
        terminals: terminals.iter().map(|value| *value > 0.0).collect(),
        episodes: episodes(&last),
        goals: one(goals, &faults)?
            .unwrap_or_default()
            .as_chunks::<2>()
            .0
            .to_vec(),
    };
    faults.drop_rows(reader.path(), data)
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
                DatasetError::NotFinite { ref key, row: 3, .. } if key == "observations"
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
            matches!(missing, DatasetError::Key { ref key, .. } if key == "actions"),
            "{missing}"
        );
        assert!(missing.to_string().contains("is missing"), "{missing}");
        let missing = with(29, Some(2));
        assert!(
            matches!(missing, DatasetError::Key { ref key, .. } if key == "rewards"),
            "{missing}"
        );
        assert!(matches!(
            with(27, None),
            DatasetError::Shape { ref key, .. } if key == "observations"
        ));
        let unequal = with(29, Some(3));
        assert!(matches!(
            unequal,
            DatasetError::Shape { ref key, .. } if key == "actions"
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
    fn timeouts_and_jumps_both_end_episodes_and_the_rest_is_one() {
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
        assert_eq!(data.episodes, [0..1, 1..2, 2..4]);
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
                DatasetError::Shape { ref key, .. } if key == "timeouts"
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
