//! The formats, and which of them a path holds.

use std::fmt;
use std::fs::{self, File};
use std::io::Read;
use std::path::Path;

use durable::{Existing, Output, Staged};

use crate::error::io_error;
use crate::hdf5::{OtherFiles, Reader};
use crate::{Dataset, DatasetError, Dropped, OnFault, d4rl, minari, ogbench};

/// What every zip archive begins with: an entry, or its end when there is none.
const ZIP: [&[u8; 4]; 2] = [b"PK\x03\x04", b"PK\x05\x06"];

/// How a data set lies on disk.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Format {
    /// One HDF5 file of flat arrays: [`d4rl`].
    D4rl,
    /// An HDF5 file with a group for each episode, in a folder with metadata: [`minari`].
    Minari,
    /// Flat arrays in a zip archive: [`ogbench`].
    Ogbench,
}

impl fmt::Display for Format {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::D4rl => "D4RL HDF5",
            Self::Minari => "Minari",
            Self::Ogbench => "OGBench npz",
        })
    }
}

impl Format {
    /// Where a data set of this format goes: a file, or for Minari a folder. `inputs` are files and
    /// folders that the command reads, which no output replaces.
    ///
    /// # Errors
    /// Something is there and is not to be replaced, or cannot be.
    pub fn output(
        self,
        path: &Path,
        existing: Existing,
        inputs: &[&Path],
    ) -> Result<Output, DatasetError> {
        Ok(match self {
            Self::Minari => Output::folder(path, existing, inputs, minari::HOLDS)?,
            Self::D4rl | Self::Ogbench => Output::file(path, existing, inputs)?,
        })
    }

    /// Writes a data set beside its place. For what each format cannot hold see [`d4rl::write`],
    /// [`minari::write`] and [`ogbench::write`].
    ///
    /// # Errors
    /// What the system or the format refuses.
    pub fn stage(self, output: &Output, data: &Dataset) -> Result<Staged, DatasetError> {
        match self {
            Self::D4rl => d4rl::stage(output, data),
            Self::Minari => minari::stage(output, data),
            Self::Ogbench => ogbench::stage(output, data),
        }
    }

    /// Writes a data set to a path where nothing is: it is whole, or nothing.
    ///
    /// # Errors
    /// Something at `path`, and what the system or the format refuses.
    pub fn write(self, path: &Path, data: &Dataset) -> Result<(), DatasetError> {
        let output = self.output(path, Existing::Refuse, &[])?;
        Ok(self.stage(&output, data)?.place()?)
    }
}

/// A data set that was read.
#[derive(Debug)]
pub struct Opened {
    /// How it lies on disk.
    pub format: Format,
    /// Its episodes.
    pub data: Dataset,
    /// Those that were left out.
    pub dropped: Dropped,
}

/// Reads a data set of any format and says which it is. The content tells, not the name: a folder
/// is Minari's, a zip archive OGBench's, an HDF5 file Minari's if it has groups `episode_0` and so
/// on, else D4RL's.
///
/// # Errors
/// A path of no known format, and anything that is wrong with it, by key and row.
pub fn open(path: &Path) -> Result<(Format, Dataset), DatasetError> {
    open_with(path, OnFault::Refuse).map(|opened| (opened.format, opened.data))
}

/// [`open`], and what becomes of faulty episodes.
///
/// # Errors
/// A path of no known format, anything that is wrong with it and lies in no episode, more than half
/// of all episodes faulty, and where they are refused the first of them, by key and row.
pub fn open_with(path: &Path, on_fault: OnFault) -> Result<Opened, DatasetError> {
    let read = |format, read: Result<(Dataset, Dropped), DatasetError>| {
        let (data, dropped) = read.map_err(DatasetError::with_remedy)?;
        Ok(Opened {
            format,
            data,
            dropped,
        })
    };
    if path.is_dir() {
        return read(Format::Minari, minari::read_with(path, on_fault));
    }
    let io = |error| io_error(path, error);
    let file = File::open(path).map_err(io)?;
    // A pipe gives its bytes once.
    let regular = file.metadata().map_err(io)?.is_file();
    let mut bytes = vec![];
    let count = if regular {
        ZIP[0].len() as u64
    } else {
        u64::MAX
    };
    file.take(count).read_to_end(&mut bytes).map_err(io)?;
    if ZIP.iter().any(|zip| bytes.starts_with(*zip)) {
        if regular {
            bytes = fs::read(path).map_err(io)?;
        }
        let data = ogbench::read_with(path, &bytes, on_fault);
        return read(Format::Ogbench, data);
    }
    let known = match regular {
        true => hdf5_pure::is_hdf5(path).map_err(io)?,
        false => hdf5_pure::is_hdf5_bytes(&bytes),
    };
    if !known {
        return Err(DatasetError::Format {
            path: path.to_path_buf(),
            reason: "neither HDF5 (D4RL, Minari) nor npz (OGBench)".to_owned(),
        });
    }
    let reader = match regular {
        true => Reader::of_file(path)?,
        false => Reader::of_bytes(path, bytes, OtherFiles::Follow)?,
    };
    if reader.numbered("episode_")?.is_empty() {
        read(Format::D4rl, d4rl::from_reader(&reader, on_fault))
    } else {
        read(Format::Minari, minari::from_reader(&reader, None, on_fault))
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::{Array, Shape, made};

    const ALL: [(Format, &str); 3] = [
        (Format::D4rl, "d.hdf5"),
        (Format::Minari, "m"),
        (Format::Ogbench, "o.npz"),
    ];

    #[test]
    fn content_tells_the_format_whatever_the_name() {
        let folder = tempfile::tempdir().unwrap();
        for (format, name) in ALL {
            let path = folder.path().join(name);
            format.write(&path, &made::varied(&[2, 3])).unwrap();
            let file = if format == Format::Minari {
                path.join("data/main_data.hdf5")
            } else {
                path.clone()
            };
            let other = folder.path().join("name.txt");
            fs::copy(file, &other).unwrap();
            for path in [&path, &other] {
                assert_eq!(open(path).unwrap().0, format, "{}", path.display());
            }
        }
        let other = folder.path().join("name.txt");
        for bytes in [&b""[..], b"PK", b"\x89HDF", b"some text"] {
            fs::write(&other, bytes).unwrap();
            let error = open(&other).unwrap_err().to_string();
            assert!(error.contains("name.txt: neither HDF5"), "{error}");
        }
        let error = open(&folder.path().join("none")).unwrap_err();
        assert!(matches!(error, DatasetError::Io { .. }));
    }

    #[test]
    fn bad_deflate_names_key_and_rows() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("long.hdf5");
        d4rl::write(&path, &made::varied(&[20_000])).unwrap();
        let sound = fs::read(&path).unwrap();
        let mut rows = 0;
        for at in (0..sound.len() - 64).step_by(sound.len() / 20) {
            let mut bytes = sound.clone();
            bytes[at..at + 64].fill(0xff);
            if let Err(error) = d4rl::read_bytes(&path, bytes) {
                rows += usize::from(error.to_string().contains("': rows "));
            }
        }
        assert!(rows > 5, "{rows} of 20 damages named by rows");
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]
        /// What a format holds comes back from it, also by way of the others.
        #[test]
        fn formats_keep_what_they_hold(
            lengths in prop::collection::vec(1_usize..9, 1..12),
            goals in any::<bool>(),
            shape in prop::sample::select(vec![
                Shape::ant(),
                Shape::vectors(4, 2),
                Shape::vectors(2, 1),
                Shape::images(&[4, 6, 3], 8),
            ]),
            way in Just(ALL.to_vec()).prop_shuffle(),
        ) {
            let mut data = made::of(&shape, &lengths);
            if !goals {
                data.goals = Array::default();
            }
            let folder = tempfile::tempdir().unwrap();
            let wanted = data.clone();
            let (mut minari, mut ogbench) = (false, false);
            for (format, name) in way {
                let path = folder.path().join(name);
                format.write(&path, &data).unwrap();
                let (found, read) = open(&path).unwrap();
                prop_assert_eq!(found, format);
                made::sound(&read);
                minari |= format == Format::Minari;
                ogbench |= format == Format::Ogbench;
                prop_assert_eq!(read.shape(), &shape);
                prop_assert_eq!(&read.observations, &wanted.observations);
                prop_assert_eq!(&read.images, &wanted.images);
                prop_assert_eq!(&read.image_places, &wanted.image_places);
                prop_assert_eq!(&read.episodes, &wanted.episodes);
                for row in 0..read.len() {
                    // Minari has no action, reward and terminal in an episode's last row.
                    let kept = !minari || wanted.steps_left(row) > 0;
                    let none = vec![0.0; shape.action()];
                    let action = if kept { wanted.action(row) } else { &none };
                    prop_assert_eq!(read.action(row), action);
                    let (reward, terminal) = (wanted.rewards[row], wanted.terminals[row]);
                    let told = (read.rewards[row], read.terminals[row]);
                    let kept = kept && !ogbench;
                    prop_assert_eq!(told, if kept { (reward, terminal) } else { (0.0, false) });
                }
                match &read.goals[..] {
                    [] => prop_assert!(!goals || ogbench),
                    found if goals && !ogbench => prop_assert_eq!(found, &wanted.goals[..]),
                    found => prop_assert!(minari && found.iter().all(|goal| *goal == [0.0; 2])),
                }
                data = read;
            }
        }
    }
}
