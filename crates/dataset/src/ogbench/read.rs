//! Reads npz files of OGBench.

use std::fs;
use std::io::Cursor;
use std::path::Path;

use zip::ZipArchive;

use super::entry::{Array, Entry, Values};
use crate::error::io_error;
use crate::fault::Faults;
use crate::hdf5::Width;
use crate::{Dataset, DatasetError, Dropped, OnFault, Shape, episodes, parallel};

/// What is said where an array is missing.
const LAYOUT: &str = "OGBench's layout wants observations, actions and terminals, D4RL's and \
                      Minari's an HDF5 file";
/// What is said where images have no places.
const PLACES: &str = "images need it, whose first two values are x and y (m) of each row";

/// Reads a file of OGBench, for training or for validation. Observations and actions may have any
/// width; numbers and bools of any type are taken, deflated or not. Observations of bytes with more
/// than two sides are images, whose places are the first two values of `qpos`. Rewards are zero, [`Dataset::terminals`] false, and there are no goals;
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
    let entry = |name, width| Entry {
        path,
        name,
        width,
        layout: LAYOUT,
    };
    let entries = [
        entry("observations", Width::AtLeast(2)),
        entry("actions", Width::AtLeast(1)),
        entry("terminals", Width::Exactly(1)),
    ];
    let mut arrays = [const { None }; 3];
    let jobs = entries.iter().zip(&mut arrays).collect();
    parallel::each(jobs, |(entry, array): (&Entry<'_>, &mut Option<Array>)| {
        // Without the marks of their ends episodes cannot be told apart.
        let strict = Faults::new(OnFault::Refuse);
        let faults = if entry.name == "terminals" {
            &strict
        } else {
            &faults
        };
        *array = Some(entry.array(&mut archive.clone(), faults)?);
        Ok::<(), DatasetError>(())
    })?;
    let [Some(observations), Some(actions), Some(terminals)] = arrays else {
        return Err(refuse("cannot be read".to_owned()));
    };
    let rows = observations.rows;
    for (entry, array) in entries.iter().zip([&observations, &actions, &terminals]) {
        entry.of_rows(array, rows)?;
    }
    if rows == 0 {
        return Err(refuse("no episode: its arrays have no row".to_owned()));
    }
    let ends = terminals.values.into_floats();
    let ends: Vec<bool> = ends.iter().map(|value| *value > 0.0).collect();
    let shape = match &observations.values {
        Values::Floats(_) => Shape::vectors(observations.width, actions.width),
        Values::Bytes(_) => Shape::images(&observations.sides, actions.width),
    };
    let mut data = Dataset::new(shape);
    match observations.values {
        Values::Floats(values) => data.observations = values.into(),
        Values::Bytes(images) => {
            let entry = Entry {
                layout: PLACES,
                ..entry("qpos", Width::AtLeast(2))
            };
            let positions = entry.array(&mut archive.clone(), &faults)?;
            entry.of_rows(&positions, rows)?;
            let states = positions.values.into_floats();
            let states = states.chunks_exact(positions.width);
            data.image_places = states.map(|state| [state[0], state[1]]).collect();
            data.images = images.into();
        }
    }
    data.actions = actions.values.into_floats().into();
    data.rewards = vec![0.0; rows].into();
    data.terminals = vec![false; rows];
    data.episodes = episodes(&ends);
    faults.drop_rows(path, data)
}

#[cfg(test)]
mod tests {
    use std::io::Write;

    use zip::write::SimpleFileOptions;
    use zip::{CompressionMethod, ZipWriter};

    use super::super::npy;
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
                observations("<f4", &[2, 1], f4(2)),
                "shape [2, 1], expected [n, 2 or more]",
            ),
            (
                observations("<f4", &[58], f4(58)),
                "shape [58], expected [n, 2 or more]",
            ),
            (
                observations("<f4", &[], f4(1)),
                "shape [], expected [n, 2 or more]",
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
            (
                observations("|u1", &[2, 6, 6, 3], vec![7; 216]),
                "'qpos': is missing",
            ),
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
    fn rows_of_any_shape_come_back() {
        let folder = tempfile::tempdir().unwrap();
        for (name, shape) in [
            ("point.npz", Shape::vectors(4, 2)),
            ("other.npz", Shape::vectors(2, 1)),
            ("images.npz", Shape::images(&[64, 64, 3], 8)),
        ] {
            let path = folder.path().join(name);
            let data = made::of(&shape, &[3, 1, 40]);
            ogbench::write(&path, &data).unwrap();
            let found = read(&path).unwrap();
            made::sound(&found);
            assert_eq!(found.shape(), &shape, "{name}");
            assert_eq!(found.observations, data.observations);
            assert_eq!(found.images, data.images);
            assert_eq!(found.image_places, data.image_places);
            assert_eq!(found.actions, data.actions);
            assert_eq!(found.episodes, data.episodes);
        }
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
