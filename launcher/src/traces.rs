//! The traces that a user names: by path, by a folder, by a run's name or folder, or by a link to
//! any of these.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};

use crate::runs;

/// Folders below the given one that are looked into: a run's `traces/training`.
const DEPTH: usize = 3;
/// Where runs are.
const RUNS: &str = "runs";

/// What a user named.
#[derive(Debug, PartialEq, Eq)]
pub(crate) enum Named {
    /// A trace, or any other file.
    File(PathBuf),
    /// A folder with traces in it; of a run that of its traces.
    Folder(PathBuf),
}

/// Finds what a user named.
pub(crate) fn find(given: &Path) -> anyhow::Result<Named> {
    let under = Path::new(RUNS).join(given);
    for path in [given, &under] {
        let Ok(about) = fs::metadata(path) else {
            continue;
        };
        // A folder that happens to have a run's name is not meant.
        let other = path == given && about.is_dir() && !has_traces(path) && has_traces(&under);
        match about.is_dir() {
            true if other => {}
            true => return Ok(Named::Folder(within(path))),
            false => return Ok(Named::File(path.to_path_buf())),
        }
    }
    let shown = given.display();
    // Why it is not there, where that is not all there is to say.
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

/// All traces that were named, each folder's by name.
pub(crate) fn all(given: &[PathBuf]) -> anyhow::Result<Vec<PathBuf>> {
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

/// The newest whole trace of what was named; none where there is none yet.
#[cfg(feature = "live")]
pub(crate) fn newest(named: &Named) -> Option<PathBuf> {
    let folder = match named {
        Named::File(path) => return Some(path.clone()),
        Named::Folder(folder) => folder,
    };
    let mut paths = vec![];
    // A run that has just begun has no folder of traces yet.
    let _ = search(folder, 1, &mut paths);
    let whole = paths
        .into_iter()
        .filter(|path| path.extension().is_some_and(|end| end == "mcap"));
    let time = |path: &PathBuf| {
        let about = fs::metadata(path).and_then(|about| about.modified());
        about.unwrap_or(std::time::SystemTime::UNIX_EPOCH)
    };
    whole.max_by_key(time)
}

/// The folder itself, or a run's traces.
fn within(folder: &Path) -> PathBuf {
    let traces = folder.join("traces");
    let is_run = traces.is_dir() || runs::find(folder).is_ok_and(|run| run == folder);
    if is_run { traces } else { folder.to_path_buf() }
}

fn has_traces(folder: &Path) -> bool {
    let mut paths = vec![];
    let traces = within(folder);
    traces.is_dir() && search(&traces, DEPTH, &mut paths).is_ok() && !paths.is_empty()
}

/// Traces in a folder and those below it, by name.
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
    fn a_folder_is_searched_and_a_run_has_its_traces() {
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
        let told = all(&[empty.path().to_path_buf()]).unwrap_err().to_string();
        assert!(told.contains("no trace in"), "{told}");
    }

    #[test]
    fn a_link_that_leads_nowhere_is_told_from_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let link = folder.path().join("old.mcap");
        std::os::unix::fs::symlink("gone.mcap", &link).unwrap();
        let told = find(&link).unwrap_err().to_string();
        assert!(
            told.contains("a link to gone.mcap, which is not there"),
            "{told}"
        );
        let told = find(&folder.path().join("x")).unwrap_err().to_string();
        assert!(told.starts_with("there is no "), "{told}");
    }
}
