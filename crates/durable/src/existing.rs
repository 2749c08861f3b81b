//! What stands where an output goes.

use std::fs::{self, Metadata};
use std::io;
use std::os::unix::fs::{FileTypeExt, MetadataExt};
use std::path::{Path, PathBuf};

/// Folders of an input that are looked into, one in the other, at most.
const DEEP: usize = 3;

/// In a word.
pub(crate) fn kind(there: &Metadata) -> &'static str {
    let kind = there.file_type();
    if kind.is_dir() {
        "a folder"
    } else if kind.is_fifo() {
        "a pipe"
    } else if kind.is_socket() {
        "a socket"
    } else if kind.is_char_device() || kind.is_block_device() {
        "a device"
    } else if kind.is_symlink() {
        "a link"
    } else {
        "a file"
    }
}

/// Whether a folder holds files of these paths and their folders, and nothing else.
pub(crate) fn only(folder: &Path, files: &[&str]) -> io::Result<bool> {
    let mut within = vec![folder.to_path_buf()];
    while let Some(next) = within.pop() {
        for entry in fs::read_dir(next)? {
            let path = entry?.path();
            let name = path.strip_prefix(folder).unwrap_or(&path);
            let there = fs::symlink_metadata(&path)?;
            let known = |file: &&str| Path::new(file).starts_with(name);
            if there.is_dir() && files.iter().any(known) {
                within.push(path);
            } else if !there.is_file() || !files.iter().any(|file| Path::new(file) == name) {
                return Ok(false);
            }
        }
    }
    Ok(true)
}

/// What a command reads: each input with all that it is made of, by device and number.
pub(crate) struct Inputs(Vec<(PathBuf, Vec<(u64, u64)>)>);

impl Inputs {
    pub(crate) fn of(inputs: &[&Path]) -> Self {
        let parts = |input: &&Path| {
            let mut parts = vec![];
            gather(input, DEEP, &mut parts);
            (input.to_path_buf(), parts)
        };
        Self(inputs.iter().map(parts).collect())
    }

    /// The input that an output would replace: the same file by any name, a part of the input, or a
    /// folder around it.
    pub(crate) fn replaced_by(&self, output: &Path) -> Option<&Path> {
        let there = fs::metadata(output).ok()?;
        let this = (there.dev(), there.ino());
        let around = |input: &Path| {
            let input = fs::canonicalize(input).unwrap_or_default();
            there.is_dir()
                && input
                    .ancestors()
                    .any(|folder| fs::metadata(folder).is_ok_and(|at| (at.dev(), at.ino()) == this))
        };
        let mut inputs = self.0.iter();
        let found = inputs.find(|(input, parts)| parts.contains(&this) || around(input));
        found.map(|(input, _)| input.as_path())
    }
}

fn gather(path: &Path, deep: usize, parts: &mut Vec<(u64, u64)>) {
    let Ok(there) = fs::metadata(path) else {
        return;
    };
    parts.push((there.dev(), there.ino()));
    if there.is_dir() && deep > 0 {
        for entry in fs::read_dir(path).into_iter().flatten().flatten() {
            gather(&entry.path(), deep - 1, parts);
        }
    }
}
