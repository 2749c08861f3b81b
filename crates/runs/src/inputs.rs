//! Fingerprints of the files that a run reads. When a run is resumed, these files may have moved, but may
//! not have changed.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use anyhow::Context;
use config::Config;
use serde::{Deserialize, Serialize};

use crate::file;

/// Files up to this length are read completely, longer ones in so many blocks of so many bytes.
const WHOLE: u64 = 64 << 20;
const BLOCKS: u64 = 64;
const BLOCK: u64 = 1 << 20;
/// Maximum number of files of a folder that are read.
const MOST: usize = 10_000;

/// Fingerprint of a file, or of all files of a folder.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
struct Fingerprint {
    bytes: u64,
    crc32c: u32,
}

/// The files that a run read when it started.
#[derive(Debug, Default, Serialize, Deserialize)]
pub struct Inputs {
    /// The run's folder, as an absolute path.
    folder: PathBuf,
    /// By the `table.key` that has the path.
    prints: BTreeMap<String, Fingerprint>,
}

fn record_path(folder: &Path) -> PathBuf {
    folder.join("checkpoints").join("inputs.json")
}

impl Inputs {
    /// Records the inputs of a new run in its folder.
    ///
    /// # Errors
    /// Cannot read an input, or write the record.
    pub fn record(config: &Config, folder: &Path) -> anyhow::Result<()> {
        let mut prints = BTreeMap::new();
        for (key, path) in config.inputs() {
            prints.insert(key, fingerprint(&path)?);
        }
        let context = || format!("reading {}", folder.display());
        let inputs = Self {
            folder: fs::canonicalize(folder).with_context(context)?,
            prints,
        };
        file::write(&record_path(folder), &serde_json::to_vec(&inputs)?)
    }

    /// Records the inputs again if the run's folder has moved, or if none were recorded.
    ///
    /// # Errors
    /// Cannot read an input, or write the record.
    pub fn renew(self, config: &Config, folder: &Path) -> anyhow::Result<()> {
        let now = fs::canonicalize(folder).unwrap_or_default();
        match self.folder == now {
            true => Ok(()),
            false => Self::record(config, folder),
        }
    }

    /// What was recorded; empty if nothing was.
    pub fn read(folder: &Path) -> Self {
        let bytes = fs::read(record_path(folder)).unwrap_or_default();
        serde_json::from_slice(&bytes).unwrap_or_default()
    }

    /// Checks that a file has the recorded content.
    ///
    /// # Errors
    /// A message, if it has not.
    pub fn compare(&self, key: &str, path: &Path) -> Result<(), String> {
        let Some(before) = self.prints.get(key) else {
            return Ok(());
        };
        match fingerprint(path) {
            Ok(now) if now == *before => Ok(()),
            Ok(_) => Err(format!(
                "'{}' holds other data than the run began with; a new run takes it",
                path.display()
            )),
            Err(error) => Err(format!("{error:#}")),
        }
    }

    /// New path of an input that was moved together with the run's folder.
    pub fn moved(&self, key: &str, path: &Path, folder: &Path) -> Option<PathBuf> {
        let now = fs::canonicalize(folder).ok()?;
        let (mut old, mut new) = (self.folder.as_path(), now.as_path());
        loop {
            if let Ok(rest) = path.strip_prefix(old) {
                let there = new.join(rest);
                if old != new && there.exists() && self.compare(key, &there).is_ok() {
                    return Some(there);
                }
            }
            // The common end of both paths did not move by itself.
            if old.file_name()? != new.file_name()? {
                return None;
            }
            (old, new) = (old.parent()?, new.parent()?);
        }
    }
}

/// Fingerprint of a file, or of all files of a folder.
fn fingerprint(path: &Path) -> anyhow::Result<Fingerprint> {
    let context = || format!("reading {}", path.display());
    let mut fingerprint = Fingerprint {
        bytes: 0,
        crc32c: 0,
    };
    let mut files = vec![];
    if fs::metadata(path).with_context(context)?.is_dir() {
        gather(path, &mut files).with_context(context)?;
    } else {
        files.push(path.to_owned());
    }
    for file in files {
        let name = file.strip_prefix(path).unwrap_or(&file);
        if name != path {
            fingerprint.crc32c =
                crc32c::crc32c_append(fingerprint.crc32c, name.as_os_str().as_encoded_bytes());
        }
        add(&mut fingerprint, &file).with_context(|| format!("reading {}", file.display()))?;
    }
    Ok(fingerprint)
}

/// Collects the regular files below a folder, sorted by name.
fn gather(folder: &Path, files: &mut Vec<PathBuf>) -> std::io::Result<()> {
    let mut entries: Vec<PathBuf> = fs::read_dir(folder)?
        .map(|entry| Ok(entry?.path()))
        .collect::<std::io::Result<_>>()?;
    entries.sort();
    for entry in entries {
        if files.len() >= MOST {
            return Ok(());
        }
        let about = fs::symlink_metadata(&entry)?;
        if about.is_dir() {
            gather(&entry, files)?;
        } else if entry.is_file() {
            files.push(entry);
        }
    }
    Ok(())
}

/// Adds a file's content: all of it, or blocks spread from its start to its end.
fn add(fingerprint: &mut Fingerprint, path: &Path) -> std::io::Result<()> {
    let mut file = File::open(path)?;
    let length = file.metadata()?.len();
    fingerprint.bytes += length;
    let (blocks, block) = match length <= WHOLE {
        true => (length.div_ceil(BLOCK), BLOCK),
        false => (BLOCKS, BLOCK),
    };
    let last = length.saturating_sub(block);
    for i in 0..blocks {
        let at = match length <= WHOLE {
            true => i * block,
            false => last * i / (blocks - 1),
        };
        file.seek(SeekFrom::Start(at))?;
        let mut bytes = vec![];
        Read::by_ref(&mut file)
            .take(block)
            .read_to_end(&mut bytes)?;
        fingerprint.crc32c = crc32c::crc32c_append(fingerprint.crc32c, &bytes);
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fingerprint_does_not_depend_on_the_path() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        fs::create_dir_all(at("set/data")).unwrap();
        for (name, text) in [
            ("a", "one"),
            ("b", "one"),
            ("c", "two"),
            ("set/data/x", "one"),
        ] {
            fs::write(at(name), text).unwrap();
        }
        let print = |name: &str| fingerprint(&at(name)).unwrap();
        assert_eq!(print("a"), print("b"));
        assert_ne!(print("a"), print("c"));
        let before = print("set");
        fs::rename(at("set"), at("moved")).unwrap();
        assert_eq!(print("moved"), before);
        fs::rename(at("moved/data/x"), at("moved/data/y")).unwrap();
        assert_ne!(print("moved"), before);
    }

    #[test]
    fn a_long_file_is_read_in_blocks_up_to_its_end() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("long");
        let file = File::create(&path).unwrap();
        file.set_len(WHOLE + 12_345).unwrap();
        let before = fingerprint(&path).unwrap();
        use std::os::unix::fs::FileExt;
        file.write_all_at(b"x", WHOLE + 12_344).unwrap();
        assert_ne!(fingerprint(&path).unwrap(), before);
    }

    #[test]
    fn inputs_that_moved_with_the_run_are_found() {
        let folder = tempfile::tempdir().unwrap();
        let root = fs::canonicalize(folder.path()).unwrap();
        fs::create_dir_all(root.join("new/runs/small")).unwrap();
        fs::write(root.join("new/data"), "one").unwrap();
        let prints = [(
            "dataset.path".to_owned(),
            fingerprint(&root.join("new/data")).unwrap(),
        )];
        let inputs = Inputs {
            folder: root.join("old/runs/small"),
            prints: prints.into(),
        };
        let run = root.join("new/runs/small");
        let moved = |path: &str| inputs.moved("dataset.path", &root.join(path), &run);
        assert_eq!(moved("old/data"), Some(root.join("new/data")));
        assert_eq!(moved("old/none"), None);
        fs::write(root.join("new/data"), "two").unwrap();
        assert_eq!(moved("old/data"), None);
    }
}
