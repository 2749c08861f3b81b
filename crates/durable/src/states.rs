//! States of a training: numbered files with a checksum, the newest two kept.
//!
//! Layout of a file, little-endian: magic (8 bytes), format (u32), checksum (CRC-32 of all that
//! follows, u32), number (u64), round (u32), then the state as postcard writes it.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use serde::Serialize;
use serde::de::DeserializeOwned;

const MAGIC: &[u8; 8] = b"FORMICAS";
const FORMAT: u32 = 1;
const SUFFIX: &str = ".state";
/// States kept: one, and one before it should the newest be damaged.
const KEPT: usize = 2;

/// Which state a file holds.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct Stamp {
    /// Grows from state to state: updates or versions.
    pub number: u64,
    /// Rounds of a deterministic run that it has learned from.
    pub round: u32,
}

/// Why a state could not be written or read.
#[derive(Debug, thiserror::Error)]
pub enum StateError {
    /// The system refused.
    #[error("{path}: {source}", path = .path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// Cut off, changed, or of another format.
    #[error("{path} is damaged: {what}", path = .path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// What shows it.
        what: &'static str,
    },
}

/// A state that was passed over.
pub type Damaged = StateError;

/// What was found.
#[derive(Debug)]
pub struct Newest<T> {
    /// The newest state that is whole.
    pub state: Option<(Stamp, T)>,
    /// Newer ones that are not.
    pub damaged: Vec<Damaged>,
}

/// The states of one name in a folder.
#[derive(Debug, Clone)]
pub struct States {
    folder: PathBuf,
    name: &'static str,
}

impl States {
    /// States called `name` in `folder`.
    #[must_use]
    pub fn new(folder: &Path, name: &'static str) -> Self {
        Self {
            folder: folder.to_path_buf(),
            name,
        }
    }

    fn path(&self, number: u64) -> PathBuf {
        self.folder
            .join(format!("{}-{number:010}{SUFFIX}", self.name))
    }

    /// Writes a state, whole or not at all, and removes those that are not needed any more.
    ///
    /// # Errors
    /// What the system refuses; the states of before are untouched then.
    pub fn save(&self, stamp: Stamp, state: &impl Serialize) -> Result<(), StateError> {
        let path = self.path(stamp.number);
        let failed = |source: io::Error| StateError::Io {
            path: path.clone(),
            source,
        };
        let mut bytes = Vec::new();
        bytes.extend(MAGIC);
        bytes.extend(FORMAT.to_le_bytes());
        bytes.extend([0; 4]);
        bytes.extend(stamp.number.to_le_bytes());
        bytes.extend(stamp.round.to_le_bytes());
        let mut bytes = postcard::to_extend(state, bytes)
            .map_err(|error| failed(io::Error::other(error.to_string())))?;
        let checksum = crc32fast::hash(&bytes[16..]);
        bytes[12..16].copy_from_slice(&checksum.to_le_bytes());
        crate::write(&path, &bytes).map_err(failed)?;
        for (_, old) in self.numbered().into_iter().skip(KEPT) {
            let _ = fs::remove_file(old);
        }
        Ok(())
    }

    /// The newest state that is whole, of those that have learned from at most `rounds` rounds.
    #[must_use]
    pub fn newest<T: DeserializeOwned>(&self, rounds: u32) -> Newest<T> {
        let mut damaged = vec![];
        for (_, path) in self.numbered() {
            match load(&path) {
                Ok((stamp, state)) if stamp.round <= rounds => {
                    let state = Some((stamp, state));
                    return Newest { state, damaged };
                }
                Ok(_) => {}
                Err(error) => damaged.push(error),
            }
        }
        Newest {
            state: None,
            damaged,
        }
    }

    /// Removes what is newer than a state that is gone on from: it is damaged, or of a way that
    /// is not taken any more.
    pub fn forget_after(&self, number: u64) {
        let newer = |(other, _): &(u64, PathBuf)| *other > number;
        for (_, path) in self.numbered().into_iter().filter(newer) {
            let _ = fs::remove_file(path);
        }
    }

    /// Rounds that each state that is whole has learned from, the newest first.
    #[must_use]
    pub fn rounds(&self) -> Vec<u32> {
        let whole = |(_, path): (u64, PathBuf)| {
            let bytes = fs::read(&path).ok()?;
            open(&path, &bytes).ok().map(|(stamp, _)| stamp.round)
        };
        self.numbered().into_iter().filter_map(whole).collect()
    }

    /// Number and path of each file, the newest first.
    fn numbered(&self) -> Vec<(u64, PathBuf)> {
        let entries = fs::read_dir(&self.folder).into_iter().flatten().flatten();
        let mut found: Vec<(u64, PathBuf)> = entries
            .filter_map(|entry| {
                let name = entry.file_name().into_string().ok()?;
                let rest = name.strip_prefix(self.name)?.strip_prefix('-')?;
                let number = rest.strip_suffix(SUFFIX)?.parse().ok()?;
                Some((number, entry.path()))
            })
            .collect();
        found.sort_by(|a, b| b.cmp(a));
        found
    }
}

fn load<T: DeserializeOwned>(path: &Path) -> Result<(Stamp, T), StateError> {
    let bytes = fs::read(path).map_err(|source| StateError::Io {
        path: path.to_path_buf(),
        source,
    })?;
    let (stamp, rest) = open(path, &bytes)?;
    match postcard::take_from_bytes(rest) {
        Ok((state, [])) => Ok((stamp, state)),
        Ok(_) => Err(damaged(path, "there is more than a state in it")),
        Err(_) => Err(damaged(path, "it holds another kind of state")),
    }
}

/// Stamp and state of a file's bytes, once its checksum holds.
fn open<'b>(path: &Path, bytes: &'b [u8]) -> Result<(Stamp, &'b [u8]), StateError> {
    let (magic, rest) = split::<8>(bytes).ok_or_else(|| damaged(path, "it is cut off"))?;
    let (format, rest) = split(rest).ok_or_else(|| damaged(path, "it is cut off"))?;
    if magic != *MAGIC || u32::from_le_bytes(format) != FORMAT {
        return Err(damaged(path, "it is no state of this version of formica"));
    }
    let (checksum, rest) = split(rest).ok_or_else(|| damaged(path, "it is cut off"))?;
    if crc32fast::hash(rest) != u32::from_le_bytes(checksum) {
        return Err(damaged(path, "its checksum does not hold"));
    }
    let (number, rest) = split(rest).ok_or_else(|| damaged(path, "it is cut off"))?;
    let (round, rest) = split(rest).ok_or_else(|| damaged(path, "it is cut off"))?;
    let stamp = Stamp {
        number: u64::from_le_bytes(number),
        round: u32::from_le_bytes(round),
    };
    Ok((stamp, rest))
}

fn split<const N: usize>(bytes: &[u8]) -> Option<([u8; N], &[u8])> {
    let (head, rest) = bytes.split_first_chunk()?;
    Some((*head, rest))
}

fn damaged(path: &Path, what: &'static str) -> StateError {
    StateError::Damaged {
        path: path.to_path_buf(),
        what,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stamp(number: u64) -> Stamp {
        Stamp {
            number,
            round: number as u32 / 10,
        }
    }

    fn newest(states: &States) -> (Option<u64>, usize) {
        let found = states.newest::<Vec<f32>>(u32::MAX);
        (
            found.state.map(|(stamp, _)| stamp.number),
            found.damaged.len(),
        )
    }

    #[test]
    fn the_newest_two_are_kept_and_the_newest_is_found() {
        let folder = tempfile::tempdir().unwrap();
        let states = States::new(folder.path(), "low");
        let others = States::new(folder.path(), "lower");
        assert_eq!(newest(&states), (None, 0));
        others.save(stamp(99), &vec![0.0_f32]).unwrap();
        for number in [5, 20, 10, 30] {
            states.save(stamp(number), &vec![number as f32; 3]).unwrap();
        }
        assert_eq!(newest(&states), (Some(30), 0));
        assert_eq!(states.rounds(), [3, 2]);
        let found = states.newest::<Vec<f32>>(2);
        assert_eq!(found.state, Some((stamp(20), vec![20.0; 3])));
        states.forget_after(20);
        assert_eq!(newest(&states), (Some(20), 0));
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 2);
    }

    #[test]
    fn every_byte_flipped_and_every_length_is_seen_and_the_one_before_is_taken() {
        let folder = tempfile::tempdir().unwrap();
        let states = States::new(folder.path(), "low");
        states.save(stamp(1), &vec![1.0_f32, -2.5]).unwrap();
        states.save(stamp(2), &vec![3.0_f32, 0.1]).unwrap();
        let path = states.path(2);
        let whole = fs::read(&path).unwrap();
        for at in 0..whole.len() {
            for mask in [0xff, 1, 0x80] {
                let mut flipped = whole.clone();
                flipped[at] ^= mask;
                fs::write(&path, &flipped).unwrap();
                assert_eq!(newest(&states), (Some(1), 1), "byte {at} ^ {mask}");
            }
            fs::write(&path, &whole[..at]).unwrap();
            assert_eq!(newest(&states), (Some(1), 1), "cut at {at}");
        }
        fs::write(&path, &whole).unwrap();
        assert_eq!(newest(&states), (Some(2), 0));
    }

    #[test]
    fn another_kind_of_state_is_damage_not_a_panic() {
        let folder = tempfile::tempdir().unwrap();
        let states = States::new(folder.path(), "low");
        states.save(stamp(1), &"text").unwrap();
        let found = states.newest::<Vec<f32>>(u32::MAX);
        assert!(found.state.is_none());
        let told = found.damaged[0].to_string();
        assert!(told.contains("low-0000000001.state is damaged"), "{told}");
    }
}
