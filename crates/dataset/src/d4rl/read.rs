//! Reads files of D4RL and of [`write`](super::write()).

use std::path::Path;

use super::{XY, next};
use crate::fault::Faults;
use crate::hdf5::{Key, OtherFiles, Reader, Width};
use crate::{Array, Dataset, DatasetError, Dropped, OnFault, Shape, episodes};

/// What is said where a key is missing.
const LAYOUT: &str = "D4RL's layout wants observations, actions, rewards and terminals, Minari's \
                      the groups episode_0, episode_1 and so on, OGBench's an npz file";

/// What is said where images have no places.
const PLACES: &str = "images need x and y (m) of each row, before the action, there";

/// Jump of the body between two rows that only a reset can make (m).
const JUMP: f32 = 5.0;

/// Reads a file in D4RL's layout: `observations`, `actions`, `rewards`, `terminals`, and where
/// they are there `timeouts` and `infos/goal`. Observations and actions may have any width; numbers
/// and bools of any type are taken.
///
/// An episode ends with its row of `timeouts`, and where the body jumps by more than 5 m: files of
/// v0 lack `timeouts` or have them out of step with the resets. So it does where
/// `next_observations`, which D4RL's `qlearning_dataset` adds, is not the row after. `terminals` end
/// none.
///
/// # Errors
/// Anything that is wrong with the file, by key and row.
pub fn read(path: &Path) -> Result<Dataset, DatasetError> {
    let reader = Reader::of_file(path)?;
    from_reader(&reader, OnFault::Refuse).map(|(data, _)| data)
}

/// [`read`] of a file's bytes; `path` is what errors name, and links to other files are refused.
///
/// # Errors
/// Anything that is wrong with them, by key and row.
pub fn read_bytes(path: &Path, bytes: Vec<u8>) -> Result<Dataset, DatasetError> {
    let reader = Reader::of_bytes(path, bytes, OtherFiles::Refuse)?;
    from_reader(&reader, OnFault::Refuse).map(|(data, _)| data)
}

/// [`read`] of an open file.
pub(crate) fn from_reader(
    reader: &Reader<'_>,
    on_fault: OnFault,
) -> Result<(Dataset, Dropped), DatasetError> {
    let root = reader.root()?;
    let key = |name, rows, width| reader.key(&root, name, rows, width, LAYOUT);
    let optional = |name, rows, width| reader.optional(&root, name, rows, Width::Exactly(width));
    // All shapes before any value: a length that is wrong then disagrees before it is allocated.
    let observations = key("observations", None, Width::AtLeast(2))?;
    let n = Some(observations.rows);
    let actions = key("actions", n, Width::AtLeast(1))?;
    let rewards = key("rewards", n, Width::Exactly(1))?;
    let terminals = key("terminals", n, Width::Exactly(1))?;
    let timeouts = optional("timeouts", n, 1)?;
    let goals = optional("infos/goal", n, 2)?;
    let image = observations.image();
    let places = match &image {
        Some(_) => Some(reader.key(&root, XY, n, Width::Exactly(2), PLACES)?),
        None => None,
    };
    if n == Some(0) {
        return Err(reader.refuse("no episode: its arrays have no row"));
    }
    let faults = Faults::new(on_fault);
    let one = |key: Option<Key>, faults: &Faults| -> Result<Vec<f32>, DatasetError> {
        key.map_or(Ok(vec![]), |key| {
            reader.values([&key], faults).map(|[values]| values)
        })
    };
    let shape = match &image {
        Some(sides) => Shape::images(sides, actions.width),
        None => Shape::vectors(observations.width, actions.width),
    };
    let mut data = Dataset::new(shape);
    if image.is_some() {
        let [bytes] = reader.values([&observations], &faults)?;
        data.images = bytes.into();
        data.image_places = pairs(&one(places, &faults)?);
    } else {
        let [values] = reader.values([&observations], &faults)?;
        data.observations = values.into();
    }
    let [values, gains, marks] = reader.values([&actions, &rewards, &terminals], &faults)?;
    data.actions = values.into();
    data.rewards = gains.into();
    data.terminals = marks.iter().map(|value: &f32| *value > 0.0).collect();
    let mut last = jumps(&data);
    if image.is_none() {
        let next = optional("next_observations", n, observations.width);
        let next = next.ok().flatten();
        next::mark(reader, next.as_ref(), &data.observations, &mut last);
    }
    // Without the marks of their ends episodes cannot be told apart.
    let ends = one(timeouts, &Faults::new(OnFault::Refuse))?;
    for (last, timeout) in last.iter_mut().zip(ends) {
        *last |= timeout > 0.0;
    }
    data.episodes = episodes(&last);
    data.goals = pairs(&one(goals, &faults)?);
    faults.drop_rows(reader.path(), data)
}

fn pairs(values: &[f32]) -> Array<[f32; 2]> {
    values.as_chunks::<2>().0.to_vec().into()
}

/// Whether the body is elsewhere in the next row.
fn jumps(data: &Dataset) -> Vec<bool> {
    let jump = |row: usize| {
        let ([x, y], [u, v]) = (data.place(row), data.place(row + 1));
        (x - u).hypot(y - v) > JUMP
    };
    let last = data.len().saturating_sub(1);
    (0..data.len())
        .map(|row| row == last || jump(row))
        .collect()
}

#[cfg(test)]
mod tests {
    use std::fs;

    use hdf5_pure::FileBuilder;

    use super::*;
    use crate::d4rl::write::made::{ROWS, written};
    use crate::{d4rl, made};
    use maze::{ACTION, OBSERVATION};

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
            with(1, None),
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
    fn rows_of_any_shape_come_back() {
        let folder = tempfile::tempdir().unwrap();
        for (name, shape) in [
            ("point.hdf5", Shape::vectors(4, 2)),
            ("other.hdf5", Shape::vectors(7, 1)),
            ("images.hdf5", Shape::images(&[64, 64, 3], 8)),
        ] {
            let path = folder.path().join(name);
            let data = made::of(&shape, &[3, 1, 40]);
            d4rl::write(&path, &data).unwrap();
            assert_eq!(read(&path).unwrap(), data, "{name}");
        }
    }

    #[test]
    fn images_need_their_places_and_other_bytes_are_vectors() {
        let read = |sides: &[u64]| {
            let mut builder = FileBuilder::new();
            let count = sides.iter().product::<u64>() as usize;
            builder
                .create_dataset("observations")
                .with_u8_data(&vec![7; count])
                .with_shape(sides);
            for (name, shape) in [
                ("actions", &[2, 2][..]),
                ("rewards", &[2]),
                ("terminals", &[2]),
            ] {
                builder
                    .create_dataset(name)
                    .with_f32_data(&vec![0.0; shape.iter().product::<u64>() as usize])
                    .with_shape(shape);
            }
            read_bytes(Path::new("x.hdf5"), builder.finish().unwrap())
        };
        let error = read(&[2, 6, 6, 3]).unwrap_err().to_string();
        assert!(error.contains("'infos/xy': is missing"), "{error}");
        assert!(error.contains("images need x and y"), "{error}");
        assert_eq!(read(&[2, 6]).unwrap().observation(1), [7.0; 6]);
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
