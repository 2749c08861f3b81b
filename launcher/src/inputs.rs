//! The files that a run reads, told apart by their content: a run that is resumed may find them
//! moved, but not changed.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use anyhow::Context;
use config::{Config, Kind};
use serde::{Deserialize, Serialize};

/// Files up to this length are read whole, longer ones in so many blocks of their length (bytes).
const WHOLE: u64 = 64 << 20;
const BLOCKS: u64 = 64;
const BLOCK: u64 = 1 << 20;
/// Files of a folder, and folders in it, that are looked at.
const MOST: usize = 10_000;

/// What a file or folder of files holds.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
struct Print {
    bytes: u64,
    crc32c: u32,
}

/// What a run read when it began.
#[derive(Debug, Default, Serialize, Deserialize)]
pub(crate) struct Inputs {
    /// The run's folder, from the root.
    folder: PathBuf,
    /// By `table.key` of the path.
    prints: BTreeMap<String, Print>,
}

/// Paths of a config that a run reads, by `table.key`.
pub(crate) fn paths(config: &Config) -> Vec<(&'static str, &Path)> {
    let mut paths = vec![];
    if config.run.kind == Kind::Walker {
        paths.push(("walker.start", config.walker.start.as_str()));
    } else {
        paths.push(("dataset.path", config.dataset.path.as_str()));
        let stages = [
            ("encoder.from", &config.encoder.from),
            ("low.from", &config.low.from),
        ];
        let given = stages
            .iter()
            .filter_map(|(key, path)| Some((*key, path.as_deref()?)));
        paths.extend(given);
    }
    paths.retain(|(_, path)| !path.is_empty());
    paths
        .into_iter()
        .map(|(key, path)| (key, Path::new(path)))
        .collect()
}

fn file(folder: &Path) -> PathBuf {
    folder.join("checkpoints").join("inputs.json")
}

impl Inputs {
    /// Reads all inputs of a run that begins, and notes them in its folder.
    pub(crate) fn note(config: &Config, folder: &Path) -> anyhow::Result<()> {
        let mut prints = BTreeMap::new();
        for (key, path) in paths(config) {
            prints.insert(key.to_owned(), print(path)?);
        }
        let told = || format!("reading {}", folder.display());
        let noted = Self {
            folder: fs::canonicalize(folder).with_context(told)?,
            prints,
        };
        crate::folder::write(&file(folder), &serde_json::to_vec(&noted)?)
    }

    /// Notes where the run's folder is now; all inputs where none were noted.
    pub(crate) fn renew(self, config: &Config, folder: &Path) -> anyhow::Result<()> {
        let now = fs::canonicalize(folder).unwrap_or_default();
        match self.folder == now {
            true => Ok(()),
            false => Self::note(config, folder),
        }
    }

    /// What was noted; nothing of a run that noted nothing.
    pub(crate) fn read(folder: &Path) -> Self {
        let bytes = fs::read(file(folder)).unwrap_or_default();
        serde_json::from_slice(&bytes).unwrap_or_default()
    }

    /// Whether a file is the one that was read; a sentence where it is not.
    pub(crate) fn compare(&self, key: &str, path: &Path) -> Result<(), String> {
        let Some(before) = self.prints.get(key) else {
            return Ok(());
        };
        match print(path) {
            Ok(now) if now == *before => Ok(()),
            Ok(_) => Err(format!(
                "'{}' holds other data than the run began with; a new run takes it",
                path.display()
            )),
            Err(error) => Err(format!("{error:#}")),
        }
    }

    /// Where an input is after the run's folder was moved together with it.
    pub(crate) fn moved(&self, key: &str, path: &Path, folder: &Path) -> Option<PathBuf> {
        let now = fs::canonicalize(folder).ok()?;
        let (mut old, mut new) = (self.folder.as_path(), now.as_path());
        loop {
            if let Ok(rest) = path.strip_prefix(old) {
                let there = new.join(rest);
                if old != new && there.exists() && self.compare(key, &there).is_ok() {
                    return Some(there);
                }
            }
            // What both have in common at their ends did not move by itself.
            if old.file_name()? != new.file_name()? {
                return None;
            }
            (old, new) = (old.parent()?, new.parent()?);
        }
    }
}

/// What a file holds, or all files of a folder.
fn print(path: &Path) -> anyhow::Result<Print> {
    let told = || format!("reading {}", path.display());
    let mut print = Print {
        bytes: 0,
        crc32c: 0,
    };
    let mut files = vec![];
    if fs::metadata(path).with_context(told)?.is_dir() {
        gather(path, &mut files).with_context(told)?;
    } else {
        files.push(path.to_owned());
    }
    for file in files {
        let name = file.strip_prefix(path).unwrap_or(&file);
        if name != path {
            print.crc32c = crc32c::crc32c_append(print.crc32c, name.as_os_str().as_encoded_bytes());
        }
        add(&mut print, &file).with_context(|| format!("reading {}", file.display()))?;
    }
    Ok(print)
}

/// Regular files below a folder, by name.
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

/// Adds a file's content: all of it, or blocks from its beginning to its end.
fn add(print: &mut Print, path: &Path) -> std::io::Result<()> {
    let mut file = File::open(path)?;
    let length = file.metadata()?.len();
    print.bytes += length;
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
        print.crc32c = crc32c::crc32c_append(print.crc32c, &bytes);
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_input_is_known_by_its_content_wherever_it_is() {
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
        let print = |name: &str| print(&at(name)).unwrap();
        assert_eq!(print("a"), print("b"));
        assert_ne!(print("a"), print("c"));
        let before = print("set");
        fs::rename(at("set"), at("moved")).unwrap();
        assert_eq!(print("moved"), before);
        fs::rename(at("moved/data/x"), at("moved/data/y")).unwrap();
        assert_ne!(print("moved"), before);
    }

    #[test]
    fn a_long_file_is_looked_at_from_its_beginning_to_its_end() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("long");
        let file = File::create(&path).unwrap();
        file.set_len(WHOLE + 12_345).unwrap();
        let before = print(&path).unwrap();
        use std::os::unix::fs::FileExt;
        file.write_all_at(b"x", WHOLE + 12_344).unwrap();
        assert_ne!(print(&path).unwrap(), before);
    }

    #[test]
    fn inputs_that_moved_with_the_run_are_found() {
        let folder = tempfile::tempdir().unwrap();
        let root = fs::canonicalize(folder.path()).unwrap();
        fs::create_dir_all(root.join("new/runs/small")).unwrap();
        fs::write(root.join("new/data"), "one").unwrap();
        let prints = [(
            "dataset.path".to_owned(),
            print(&root.join("new/data")).unwrap(),
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
