//! Finds traces by path, by folder, by a run's name or folder, or by a link to any of these.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};

use crate::find;

/// Depth of subfolders that are searched, for a run's `traces/training`.
const DEPTH: usize = 3;
/// Folder of all runs.
const RUNS: &str = "runs";

/// What a user named.
#[derive(Debug, PartialEq, Eq)]
pub enum Named {
    /// A trace, or another file.
    File(PathBuf),
    /// A folder of traces; for a run, the folder of its traces.
    Folder(PathBuf),
}

/// Finds what a user named.
///
/// # Errors
/// There is no such file or folder.
pub fn find(given: &Path) -> anyhow::Result<Named> {
    let under = Path::new(RUNS).join(given);
    for path in [given, &under] {
        let Ok(about) = fs::metadata(path) else {
            continue;
        };
        // A folder that happens to have the name of a run, but holds no traces.
        let other = path == given && about.is_dir() && !has_traces(path) && has_traces(&under);
        match about.is_dir() {
            true if other => {}
            true => return Ok(Named::Folder(within(path))),
            false => return Ok(Named::File(path.to_path_buf())),
        }
    }
    let shown = given.display();
    // The reason, if it is not just missing.
    let reason = match fs::read_link(given) {
        Ok(to) => format!(": it is a link to {}, which is not there", to.display()),
        Err(_) => match fs::symlink_metadata(given) {
            Err(error) if error.kind() != std::io::ErrorKind::NotFound => format!(": {error}"),
            _ => String::new(),
        },
    };
    bail!(
        "there is no {shown}{reason}; name a trace, a folder of traces or a run, by its folder or by \
         its name under {RUNS}"
    )
}

/// All traces that a user named, those of a folder sorted by name.
///
/// # Errors
/// An unknown path, or a folder without traces.
pub fn all(given: &[PathBuf]) -> anyhow::Result<Vec<PathBuf>> {
    let mut paths = vec![];
    for given in given {
        match find(given)? {
            Named::File(path) => paths.push(path),
            Named::Folder(folder) => {
                let before = paths.len();
                search(&folder, DEPTH, &mut paths)?;
                if paths.len() == before {
                    bail!(
                        "there is no trace in {}; a run writes them when it evaluates, and every so \
                         many training episodes with traces.training_every",
                        folder.display()
                    );
                }
            }
        }
    }
    Ok(paths)
}

/// The newest complete trace of what a user named; `None` if there is none yet.
pub fn newest(named: &Named) -> Option<PathBuf> {
    let folder = match named {
        Named::File(path) => return Some(path.clone()),
        Named::Folder(folder) => folder,
    };
    let mut paths = vec![];
    // A run that has just started has no folder of traces yet.
    let _ = search(folder, 1, &mut paths);
    let complete = paths
        .into_iter()
        .filter(|path| path.extension().is_some_and(|end| end == "mcap"));
    let time = |path: &PathBuf| {
        let about = fs::metadata(path).and_then(|about| about.modified());
        about.unwrap_or(std::time::SystemTime::UNIX_EPOCH)
    };
    complete.max_by_key(time)
}

/// The folder of a run's traces, or else the folder itself.
fn within(folder: &Path) -> PathBuf {
    let traces = folder.join("traces");
    let is_run = traces.is_dir() || find::find(folder).is_ok_and(|run| run == folder);
    if is_run { traces } else { folder.to_path_buf() }
}

fn has_traces(folder: &Path) -> bool {
    let mut paths = vec![];
    let traces = within(folder);
    traces.is_dir() && search(&traces, DEPTH, &mut paths).is_ok() && !paths.is_empty()
}

/// Adds the traces in a folder and its subfolders, sorted by name.
fn search(folder: &Path, depth: usize, paths: &mut Vec<PathBuf>) -> anyhow::Result<()> {
    let reading = || format!("reading {}", folder.display());
    let mut entries = vec![];
    for entry in fs::read_dir(folder).with_context(reading)? {
        entries.push(entry.with_context(reading)?.path());
    }
    entries.sort();
    let is_trace = |path: &PathBuf| {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        path.is_file() && (name.ends_with(".mcap") || name.ends_with(".mcap.part"))
    };
    paths.extend(entries.iter().filter(|path| is_trace(path)).cloned());
    for folder in entries.iter().filter(|path| path.is_dir() && depth > 0) {
        search(folder, depth - 1, paths)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn folders_are_searched_for_traces() {
        let folder = tempfile::tempdir().unwrap();
        let deep = folder.path().join("traces/training");
        fs::create_dir_all(&deep).unwrap();
        for name in [
            "traces/b.mcap",
            "traces/a.mcap.part",
            "traces/training/c.mcap",
            "x.mcap",
        ] {
            fs::write(folder.path().join(name), "").unwrap();
        }
        fs::write(deep.join("notes.txt"), "").unwrap();
        let found = |given: PathBuf| -> Vec<String> {
            let names = all(&[given]).unwrap().into_iter().map(|path| {
                let name = path.strip_prefix(folder.path()).unwrap_or(&path);
                name.display().to_string()
            });
            names.collect()
        };
        let traces = [
            "traces/a.mcap.part",
            "traces/b.mcap",
            "traces/training/c.mcap",
        ];
        assert_eq!(found(folder.path().to_path_buf()), traces);
        let link = folder.path().join("link.mcap");
        std::os::unix::fs::symlink(folder.path().join("x.mcap"), &link).unwrap();
        assert_eq!(found(link), ["link.mcap"]);
        assert!(all(&[folder.path().join("none")]).is_err());
        let empty = tempfile::tempdir().unwrap();
        let text = all(&[empty.path().to_path_buf()]).unwrap_err().to_string();
        assert!(text.contains("no trace in"), "{text}");
    }

    #[test]
    fn a_broken_link_has_another_message_than_a_missing_file() {
        let folder = tempfile::tempdir().unwrap();
        let link = folder.path().join("old.mcap");
        std::os::unix::fs::symlink("gone.mcap", &link).unwrap();
        let text = find(&link).unwrap_err().to_string();
        assert!(
            text.contains("a link to gone.mcap, which is not there"),
            "{text}"
        );
        let text = find(&folder.path().join("x")).unwrap_err().to_string();
        assert!(text.starts_with("there is no "), "{text}");
    }
}
