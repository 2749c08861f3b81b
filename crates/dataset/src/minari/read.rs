//! Reads Minari's folders and files.

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

use serde_json::Value;

use super::episode::{Found, LAYOUT, Layout, episode, room};
use super::{MAIN, METADATA};
use crate::error::io_error;
use crate::fault::Faults;
use crate::hdf5::{OtherFiles, Reader, Width};
use crate::{Dataset, DatasetError, Dropped, OnFault, parallel};

/// What groups of episodes are named, before their number.
const EPISODE: &str = "episode_";
/// What some editors put before a text.
const BYTE_ORDER_MARK: &[u8] = b"\xef\xbb\xbf";

/// Reads a folder that holds `main_data.hdf5`, itself or in `data/`, or such a file. The number of
/// episodes must be that of `metadata.json`, if that is beside it in a folder.
///
/// `terminations` become [`Dataset::terminals`]; `truncations` and `infos` are not kept.
///
/// # Errors
/// Anything that is wrong with the files, by key and row.
pub fn read(path: &Path) -> Result<Dataset, DatasetError> {
    read_with(path, OnFault::Refuse).map(|(data, _)| data)
}

/// [`read`], and what becomes of faulty episodes.
pub(crate) fn read_with(
    path: &Path,
    on_fault: OnFault,
) -> Result<(Dataset, Dropped), DatasetError> {
    if !path.is_dir() {
        let reader = Reader::of_file(path)?;
        return from_reader(&reader, None, on_fault);
    }
    let folders = [path.to_path_buf(), path.join("data")];
    let Some(folder) = folders.iter().find(|folder| folder.join(MAIN).is_file()) else {
        return Err(DatasetError::Format {
            path: path.to_path_buf(),
            reason: format!(
                "no {MAIN} in this folder or in its data/; Minari's arrow format is not read"
            ),
        });
    };
    let (main, metadata) = (folder.join(MAIN), folder.join(METADATA));
    let told = match fs::read(&metadata) {
        Ok(bytes) => Some(told_episodes(&metadata, &bytes)?),
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => None,
        Err(error) => return Err(io_error(&metadata, error)),
    };
    let reader = Reader::of_file(&main)?;
    from_reader(&reader, told, on_fault)
}

/// [`read`] of a main file's bytes; `path` is what errors name, and links to other files are
/// refused.
///
/// # Errors
/// Anything that is wrong with them, by key and row.
pub fn read_bytes(path: &Path, bytes: Vec<u8>) -> Result<Dataset, DatasetError> {
    let reader = Reader::of_bytes(path, bytes, OtherFiles::Refuse)?;
    from_reader(&reader, None, OnFault::Refuse).map(|(data, _)| data)
}

/// Episodes that the metadata tell of.
fn told_episodes(path: &Path, bytes: &[u8]) -> Result<usize, DatasetError> {
    let metadata: Value = serde_json::from_slice(
        bytes.strip_prefix(BYTE_ORDER_MARK).unwrap_or(bytes),
    )
    .map_err(|error| DatasetError::Format {
        path: path.to_path_buf(),
        reason: format!("not JSON: {error}"),
    })?;
    // Some tools write whole numbers as 6.0.
    let whole = |value: &Value| {
        let real = value
            .as_f64()
            .filter(|real| real.fract() == 0.0 && *real >= 0.0);
        value.as_u64().or(real.map(|real| real as u64))
    };
    let count = metadata.get("total_episodes").and_then(whole);
    count
        .and_then(|count| usize::try_from(count).ok())
        .ok_or_else(|| DatasetError::Key {
            path: path.to_path_buf(),
            key: "total_episodes".to_owned(),
            reason: "is missing or no whole number".to_owned(),
        })
}

/// [`read`] of an open file; `told` is the number of episodes that its metadata tell of.
pub(crate) fn from_reader(
    reader: &Reader<'_>,
    told: Option<usize>,
    on_fault: OnFault,
) -> Result<(Dataset, Dropped), DatasetError> {
    let faults = Faults::new(on_fault);
    let (found, of) = lengths(reader, told, &faults)?;
    let layout = layout(reader, &found)?;
    let action = actions_width(&found).or(found.first().map(|found| found.actions.width));
    let shape = layout.shape(action.unwrap_or(1).max(1));
    let (mut episodes, mut rows) = (vec![], 0_usize);
    for Found { actions, .. } in &found {
        let end = rows.saturating_add(actions.rows).saturating_add(1);
        episodes.push(rows..end);
        rows = end;
    }
    // Groups can share an array, so that each is sound and all together are not.
    let widest = shape.observation().max(shape.action());
    if rows as u64 > reader.most() / widest as u64 {
        return Err(reader.refuse(format!("{rows} rows are more than the file can hold")));
    }
    let mut data = Dataset::new(shape);
    let room = room(&mut data, rows);
    let mut flat = room.map_err(|error| reader.refuse(error))?;
    let numbers: Vec<usize> = found.iter().map(|found| found.number).collect();
    let jobs = found.into_iter().map(|found| {
        let into = flat.take(found.actions.rows + 1);
        (found, into)
    });
    parallel::each(jobs.collect(), |(found, mut into)| {
        let places = found.number..found.number + 1;
        episode(reader, &layout, &found, &mut into).or_else(|error| faults.note(places, error))
    })?;
    data.episodes = episodes;
    faults.drop_numbers(reader.path(), data, &numbers, of)
}

/// Values of an action, as the first one has them.
fn actions_width(found: &[Found]) -> Option<usize> {
    let acted = found.iter().find(|found| found.actions.rows > 0);
    acted.map(|found| found.actions.width)
}

/// That of the first episode that can be read.
fn layout(reader: &Reader<'_>, found: &[Found]) -> Result<Layout, DatasetError> {
    let mut first = None;
    for found in found {
        match Layout::of(reader, found) {
            Ok(layout) => return Ok(layout),
            Err(error) => first = first.or(Some(error)),
        }
    }
    Err(first.unwrap_or_else(|| reader.refuse("no episode can be read")))
}

/// Number, folder and actions of each episode whose length can be told, and how many episodes there
/// are in all. All lengths come before any value, as the arrays' allocation needs them.
fn lengths(
    reader: &Reader<'_>,
    told: Option<usize>,
    faults: &Faults,
) -> Result<(Vec<Found>, usize), DatasetError> {
    let present: BTreeSet<usize> = reader.numbered(EPISODE)?.into_iter().collect();
    let count = present.len();
    let of = present.last().map_or(0, |last| last.saturating_add(1));
    let of = of.max(told.unwrap_or(0));
    if count == 0 {
        return Err(reader.refuse("no episode: there is no group 'episode_0'"));
    }
    if let Some(told) = told.filter(|told| *told != count) {
        let error = reader.refuse(format!(
            "holds {count} episodes, its {METADATA} tells of {told}"
        ));
        if told < count {
            return Err(error);
        }
        faults.note(count..count + 1, error)?;
    }
    // Names are an outsider's: nobody counts to the greatest number there is.
    if of > 2 * count + 1 {
        let missing = (0..of)
            .find(|number| !present.contains(number))
            .unwrap_or(0);
        let error = missing_episode(reader, missing, count);
        return Err(faults.too_many(reader.path(), of - count, of, error));
    }
    let root = reader.root()?;
    let mut found: Vec<Found> = Vec::with_capacity(count);
    for number in 0..of {
        let name = format!("{EPISODE}{number}");
        let opened = if present.contains(&number) {
            reader.folder(&root, &name).and_then(|folder| {
                let width = actions_width(&found).map_or(Width::AtLeast(1), Width::Exactly);
                let actions = reader.key(&folder, "actions", None, width, LAYOUT)?;
                Ok(Found {
                    number,
                    folder,
                    actions,
                })
            })
        } else {
            Err(missing_episode(reader, number, count))
        };
        match opened {
            Ok(episode) => found.push(episode),
            Err(error) => faults.note(number..number + 1, error)?,
        }
    }
    Ok((found, of))
}

fn missing_episode(reader: &Reader<'_>, number: usize, count: usize) -> DatasetError {
    let reason = format!("is missing; episodes are numbered 0 to {}", count - 1);
    reader.error(&format!("{EPISODE}{number}"), reason)
}

#[cfg(test)]
mod tests {
    use std::path::PathBuf;

    use hdf5_pure::FileBuilder;
    use maze::ACTION;

    use super::*;
    use crate::{Shape, made, minari};

    /// The folder of two episodes, of three rows and of two, and its main file's bytes.
    fn written(within: &Path) -> (PathBuf, Vec<u8>) {
        let path = within.join("small-v2");
        minari::write(&path, &made::varied(&[3, 2])).unwrap();
        let bytes = fs::read(path.join("data").join(MAIN)).unwrap();
        (path, bytes)
    }

    #[test]
    fn an_episode_has_a_row_more_than_actions_and_its_last_action_is_zero() {
        let folder = tempfile::tempdir().unwrap();
        let (path, _) = written(folder.path());
        let (data, wanted) = (read(&path).unwrap(), made::varied(&[3, 2]));
        assert_eq!(data.episodes, [0..3, 3..5]);
        assert_eq!(data.observations, wanted.observations);
        assert_eq!(data.goals, wanted.goals);
        for row in [0, 1, 3] {
            assert_eq!(data.action(row), wanted.action(row));
            assert_eq!(data.rewards[row], wanted.rewards[row]);
            assert_eq!(data.terminals[row], wanted.terminals[row]);
        }
        for row in [2, 4] {
            assert_eq!(data.action(row), [0.0; ACTION]);
            assert_eq!((data.rewards[row], data.terminals[row]), (0.0, false));
        }
        assert_eq!(read(&path.join("data")).unwrap(), data);
        assert_eq!(read(&path.join("data").join(MAIN)).unwrap(), data);
    }

    /// A file of one episode of two steps; `width` is that of `observation`, `skip` a key that is
    /// left out, `nan` one whose second row holds a value that is not finite.
    fn made_up(width: usize, skip: &str, nan: &str) -> Result<Dataset, DatasetError> {
        let mut builder = FileBuilder::new();
        let mut group = builder.create_group("episode_0");
        let mut observations = group.create_group("observations");
        for (name, rows, width) in [
            ("actions", 2, ACTION),
            ("rewards", 2, 1),
            ("terminations", 2, 1),
            ("truncations", 2, 1),
            ("observation", 3, width),
            ("achieved_goal", 3, 2),
            ("desired_goal", 3, 2),
        ] {
            if name == skip {
                continue;
            }
            let mut values: Vec<f64> = (0..rows * width).map(|at| at as f64).collect();
            if name == nan {
                values[width] = f64::INFINITY;
            }
            let group = if rows == 3 {
                &mut observations
            } else {
                &mut group
            };
            let array = group.create_dataset(name).with_f64_data(&values);
            if width > 1 {
                array.with_shape(&[rows as u64, width as u64]);
            }
        }
        group.add_group(observations.finish());
        builder.add_group(group.finish());
        read_bytes(Path::new("made.hdf5"), builder.finish().unwrap())
    }

    #[test]
    fn a_row_is_the_place_and_the_first_27_values() {
        for width in [27, 105] {
            let data = made_up(width, "", "").unwrap();
            assert_eq!(data.observation(1)[..3], [2.0, 3.0, width as f32]);
            assert_eq!(data.observation(2)[28], 2.0 * width as f32 + 26.0);
        }
        // Of another body all of it.
        assert_eq!(made_up(26, "", "").unwrap().shape().observation(), 28);
    }

    #[test]
    fn rows_of_any_shape_come_back() {
        let folder = tempfile::tempdir().unwrap();
        for (name, shape) in [
            ("point-v0", Shape::vectors(4, 2)),
            ("other-v0", Shape::vectors(27, 1)),
            ("images-v0", Shape::images(&[64, 64, 3], 8)),
        ] {
            let path = folder.path().join(name);
            let data = made::of(&shape, &[3, 1, 40]);
            minari::write(&path, &data).unwrap();
            let found = read(&path).unwrap();
            made::sound(&found);
            assert_eq!(found.shape(), &shape, "{name}");
            assert_eq!(found.observations, data.observations);
            assert_eq!(found.images, data.images);
            assert_eq!(found.image_places, data.image_places);
            assert_eq!(
                (&found.episodes, &found.goals),
                (&data.episodes, &data.goals)
            );
            assert_eq!(found.action(41), data.action(41));
        }
    }

    /// Minari's own way with images (`minari/dataset/_storages/hdf5_storage.py`).
    #[test]
    fn images_in_jpeg_are_refused_with_the_remedy() {
        let mut builder = FileBuilder::new();
        let mut group = builder.create_group("episode_0");
        let mut states = group.create_group("observations");
        let bytes = [255, 216, 255, 224, 0, 16].repeat(2);
        let array = states.create_dataset("observation");
        array.with_u8_data(&bytes).with_shape(&[2, 6]);
        let array = states.create_dataset("achieved_goal");
        array.with_f32_data(&[0.0; 4]).with_shape(&[2, 2]);
        group.add_group(states.finish());
        let array = group.create_dataset("actions");
        array.with_f32_data(&[0.0; 8]).with_shape(&[1, 8]);
        builder.add_group(group.finish());
        let error = read_bytes(Path::new("m"), builder.finish().unwrap()).unwrap_err();
        let error = error.to_string();
        let wanted = "'episode_0/observations/observation': holds JPEG files, which are not read";
        assert!(error.contains(wanted), "{error}");
    }

    #[test]
    fn episodes_of_another_width_are_faults() {
        let folder = tempfile::tempdir().unwrap();
        let (path, _) = written(folder.path());
        let mut other = FileBuilder::new();
        for (number, width) in [(0, 2), (1, 3)] {
            let mut group = other.create_group(&format!("episode_{number}"));
            let mut states = group.create_group("observations");
            for (name, width) in [
                ("observation", 4),
                ("achieved_goal", 2),
                ("desired_goal", 2),
            ] {
                let array = states.create_dataset(name);
                array.with_f32_data(&vec![0.0; 2 * width]);
                array.with_shape(&[2, width as u64]);
            }
            group.add_group(states.finish());
            for (name, width) in [
                ("actions", width),
                ("rewards", 1),
                ("terminations", 1),
                ("truncations", 1),
            ] {
                let array = group.create_dataset(name);
                array.with_f32_data(&vec![0.0; width]);
                array.with_shape(&[1, width as u64]);
            }
            other.add_group(group.finish());
        }
        let error = read_bytes(&path, other.finish().unwrap()).unwrap_err();
        let error = error.to_string();
        let wanted = "'episode_1/actions' has shape [1, 3], expected [n, 2]";
        assert!(error.contains(wanted), "{error}");
    }

    #[test]
    fn missing_keys_and_values_that_are_not_finite_are_named() {
        for name in ["actions", "rewards", "terminations", "truncations"] {
            let error = made_up(27, name, "").unwrap_err().to_string();
            let wanted = format!("made.hdf5: 'episode_0/{name}': is missing");
            assert!(error.contains(&wanted), "{error}");
        }
        for name in ["observation", "achieved_goal", "desired_goal"] {
            let error = made_up(27, name, "").unwrap_err().to_string();
            let wanted = format!("'episode_0/observations/{name}': is missing");
            assert!(error.contains(&wanted), "{error}");
            let error = made_up(27, "", name).unwrap_err().to_string();
            let wanted =
                format!("'episode_0/observations/{name}' holds a value that is not finite");
            assert!(
                error.contains(&wanted) && error.ends_with("in row 1"),
                "{error}"
            );
        }
    }

    #[test]
    fn no_episode_a_gap_and_another_count_than_the_metadata_are_named() {
        let refused = |builder: FileBuilder| {
            read_bytes(Path::new("made.hdf5"), builder.finish().unwrap())
                .unwrap_err()
                .to_string()
        };
        assert!(refused(FileBuilder::new()).contains("no episode"));
        let mut gap = FileBuilder::new();
        let group = gap.create_group("episode_1").finish();
        gap.add_group(group);
        let error = refused(gap);
        assert!(error.contains("'episode_0': is missing"), "{error}");

        let folder = tempfile::tempdir().unwrap();
        let (path, _) = written(folder.path());
        let metadata = path.join("data").join(METADATA);
        let text = fs::read_to_string(&metadata).unwrap();
        let other = text.replace("\"total_episodes\":2", "\"total_episodes\":3");
        for (text, wanted) in [
            (
                other.as_str(),
                "holds 2 episodes, its metadata.json tells of 3",
            ),
            ("{", "not JSON"),
            ("{}", "'total_episodes': is missing"),
        ] {
            fs::write(&metadata, text).unwrap();
            let error = read(&path).unwrap_err().to_string();
            assert!(error.contains(wanted), "{error}");
        }
        fs::remove_file(metadata).unwrap();
        assert!(read(&path).is_ok());
        fs::remove_file(path.join("data").join(MAIN)).unwrap();
        let error = read(&path).unwrap_err().to_string();
        assert!(error.contains("no main_data.hdf5"), "{error}");
    }

    #[test]
    fn cut_and_flipped_files_are_errors_or_sound_never_a_panic() {
        let folder = tempfile::tempdir().unwrap();
        let (path, bytes) = written(folder.path());
        for length in (0..bytes.len()).step_by(7) {
            let cut = read_bytes(&path, bytes[..length].to_vec());
            assert!(cut.is_err(), "cut at {length}");
        }
        let (mut errors, mut named) = (0, 0);
        for at in 0..bytes.len() {
            for mask in [0x01, 0xff] {
                let mut flipped = bytes.clone();
                flipped[at] ^= mask;
                match read_bytes(&path, flipped) {
                    Ok(data) => {
                        made::sound(&data);
                        assert_eq!(data.len(), 5, "byte {at}");
                    }
                    Err(error) => {
                        errors += 1;
                        named += usize::from(error.to_string().contains("'episode_"));
                    }
                }
            }
        }
        assert!(
            errors > bytes.len() / 2,
            "{errors} errors in {} bytes",
            bytes.len()
        );
        assert!(named > 100, "{named} of {errors} errors name a key");
    }

    #[test]
    fn an_existing_folder_is_kept() {
        let folder = tempfile::tempdir().unwrap();
        let (path, bytes) = written(folder.path());
        let error = minari::write(&path, &made::varied(&[2])).unwrap_err();
        assert!(error.to_string().contains("is there already"), "{error}");
        assert_eq!(fs::read(path.join("data").join(MAIN)).unwrap(), bytes);
        let names: Vec<_> = fs::read_dir(folder.path())
            .unwrap()
            .map(|entry| entry.unwrap().file_name())
            .collect();
        assert_eq!(names, ["small-v2"]);
    }
}
