//! Finds a run by name, folder or link.

use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

/// Name of the link to the newest run, in the folder of all runs.
pub(crate) const LATEST: &str = "latest";
/// Maximum number of other runs that a message lists.
const NAMED: usize = 5;

/// There is no run of this name.
#[derive(Debug, thiserror::Error)]
#[error(
    "there is no run {given}: neither it nor {under} is a folder with the config.toml that \
     `formica launch` writes{hint}", given = .given.display(), under = .under.display()
)]
pub struct NoRun {
    given: PathBuf,
    under: PathBuf,
    /// A similar name, or the reason.
    hint: String,
}

/// The folder of a run, by that folder, by its name under `runs`, by its config.toml, or by a link to any
/// of these.
///
/// # Errors
/// There is no such run.
pub fn find(given: &Path) -> Result<PathBuf, NoRun> {
    let under = Path::new("runs").join(given);
    let candidates = [given.to_owned(), under.clone()];
    if let Some(folder) = candidates.iter().find(|folder| is_run(folder)) {
        return Ok(folder.clone());
    }
    // Its config was named.
    let parent = given.parent().filter(|_| given.ends_with("config.toml"));
    if let Some(folder) = parent.filter(|folder| is_run(folder)) {
        return Ok(folder.to_owned());
    }
    Err(NoRun {
        hint: hint(given, &candidates),
        given: given.to_owned(),
        under,
    })
}

/// Whether a folder is a run's: it has a config.toml, or the other files of a run that lost it.
fn is_run(folder: &Path) -> bool {
    folder.join("config.toml").is_file()
        || folder.join("checkpoints").is_dir() && folder.join("domain").is_file()
}

fn hint(given: &Path, candidates: &[PathBuf]) -> String {
    for path in candidates {
        match fs::metadata(path) {
            Ok(about) if about.is_file() && path.extension().is_some_and(|end| end == "toml") => {
                let path = path.display();
                return format!(
                    "; {path} is a run file, `formica launch {path}` begins a run of it"
                );
            }
            Err(error) if error.kind() == ErrorKind::PermissionDenied => {
                return format!("; {} may not be read", path.display());
            }
            Err(_) if fs::symlink_metadata(path).is_ok_and(|link| link.is_symlink()) => {
                let target = fs::read_link(path).unwrap_or_default();
                return format!(
                    "; {} is a link to {}, which is not there{}",
                    path.display(),
                    target.display(),
                    others(&names())
                );
            }
            _ => {}
        }
    }
    let names = names();
    match near(&given.to_string_lossy(), &names) {
        Some(name) => format!("; did you mean {name}?"),
        None => others(&names),
    }
}

/// The name of a run here that is close to a given one.
pub fn similar(name: &str) -> Option<String> {
    near(name, &names()).cloned()
}

fn near<'n>(given: &str, names: &'n [String]) -> Option<&'n String> {
    let given = given.trim_end_matches('/');
    let given = given.strip_prefix("runs/").unwrap_or(given).to_lowercase();
    let distance = |name: &String| strsim::damerau_levenshtein(&given, &name.to_lowercase());
    let nearest = names.iter().min_by_key(|name| distance(name))?;
    (distance(nearest) <= 1 + nearest.chars().count() / 3).then_some(nearest)
}

fn others(names: &[String]) -> String {
    match names {
        [] => String::new(),
        _ if names.len() <= NAMED => format!("; there are {}", names.join(", ")),
        _ => format!(
            "; there are {} and {} more",
            names[..NAMED].join(", "),
            names.len() - NAMED
        ),
    }
}

/// Names of all runs under `runs`, sorted.
fn names() -> Vec<String> {
    let entries = fs::read_dir("runs").into_iter().flatten().flatten();
    let runs = entries.filter(|entry| is_run(&entry.path()) && entry.file_name() != LATEST);
    let mut names: Vec<String> = runs
        .filter_map(|entry| entry.file_name().into_string().ok())
        .collect();
    names.sort();
    names
}

/// A run's folder without links, which could change later; relative if it is below the working directory.
pub fn resolved(folder: &Path) -> PathBuf {
    let Ok(whole) = fs::canonicalize(folder) else {
        return folder.to_owned();
    };
    let here = std::env::current_dir().and_then(fs::canonicalize);
    let below = here
        .ok()
        .and_then(|here| whole.strip_prefix(here).ok().map(Path::to_path_buf));
    match below {
        Some(path) if path.as_os_str().is_empty() => PathBuf::from("."),
        Some(path) => path,
        None => whole,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_similar_name_is_suggested() {
        let names = ["small", "antmaze-large-2"].map(str::to_owned);
        assert_eq!(near("smal", &names), Some(&names[0]));
        assert_eq!(near("runs/Small/", &names), Some(&names[0]));
        assert_eq!(near("antmaze-large", &names), Some(&names[1]));
        assert_eq!(near("nowhere", &names), None);
        assert_eq!(others(&names), "; there are small, antmaze-large-2");
    }
}
