//! Runs by what a user calls them: a name, a folder, a link to one, `latest`.

use std::fs;
use std::io::ErrorKind;
use std::os::unix::fs::symlink;
use std::path::{Component, Path, PathBuf};

/// Link to the newest run, among all of them.
const LATEST: &str = "latest";
/// Other runs that a message names.
const NAMED: usize = 5;

/// Why there is no run of a name.
#[derive(Debug, thiserror::Error)]
#[error(
    "there is no run {given}: neither it nor {under} is a folder with the config.toml that \
     `formica launch` writes{hint}", given = .given.display(), under = .under.display()
)]
pub(crate) struct NoRun {
    given: PathBuf,
    under: PathBuf,
    /// What may have been meant, or what is in the way.
    hint: String,
}

/// The folder of a run that was given as such, by its name under `runs`, or by a link to either.
pub(crate) fn find(given: &Path) -> Result<PathBuf, NoRun> {
    let under = Path::new("runs").join(given);
    let candidates = [given.to_owned(), under.clone()];
    if let Some(folder) = candidates.iter().find(|folder| is_run(folder)) {
        return Ok(folder.clone());
    }
    // Its config.
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

/// A run's folder has its config; one that lost it is told by what else is there.
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

/// An actor's arguments, with the folder of the run that it shall join. What cannot be found is
/// its own to tell.
pub(crate) fn resolve(mut args: actor::Args) -> anyhow::Result<actor::Args> {
    if let Some(name) = &args.attach {
        match find(Path::new(name)) {
            Ok(folder) => args.attach = folder.to_str().map(str::to_owned),
            Err(_) => {
                if let Some(near) = near(name, &names()) {
                    anyhow::bail!("there is no run '{name}'; did you mean '{near}'?");
                }
            }
        }
    }
    Ok(args)
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

/// All runs here, by name.
fn names() -> Vec<String> {
    let entries = fs::read_dir("runs").into_iter().flatten().flatten();
    let runs = entries.filter(|entry| is_run(&entry.path()) && entry.file_name() != LATEST);
    let mut names: Vec<String> = runs
        .filter_map(|entry| entry.file_name().into_string().ok())
        .collect();
    names.sort();
    names
}

/// A run's folder as it is to be remembered: not through a link that may come to point elsewhere,
/// and short where it is below the present folder.
pub(crate) fn settled(folder: &Path) -> PathBuf {
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

/// Points `latest` to a run, where its folder is among the runs; what is wrong where that fails.
/// `found` is the folder as the user gave it.
pub(crate) fn point(found: &Path) -> Option<String> {
    let whole = fs::canonicalize(found).ok()?;
    // A run that lies elsewhere and is linked to is pointed to by that link.
    let named = match found.components().next_back() {
        Some(Component::Normal(name)) if name != LATEST => found.parent().map(|runs| (runs, name)),
        _ => None,
    };
    let (runs, name) = named.or_else(|| Some((whole.parent()?, whole.file_name()?)))?;
    let runs = if runs.as_os_str().is_empty() {
        Path::new(".")
    } else {
        runs
    };
    let link = runs.join(LATEST);
    let about = fs::symlink_metadata(&link);
    let is_link = about.as_ref().is_ok_and(fs::Metadata::is_symlink);
    if !is_link
        && !fs::canonicalize(runs).is_ok_and(|runs| runs.ends_with("runs"))
        && !runs.ends_with("runs")
    {
        return None;
    }
    if about.is_ok() && !is_link {
        let link = link.display();
        return Some(format!(
            "{link} is no link, so it is left as it is and does not point to the newest run"
        ));
    }
    if fs::read_link(&link).is_ok_and(|target| target == Path::new(name)) {
        return None;
    }
    // Beside it first: nobody finds it missing, and one that leads in a circle is replaced.
    let part = runs.join(format!(".{LATEST}-{}", std::process::id()));
    let _ = fs::remove_file(&part);
    let pointed = symlink(name, &part).and_then(|()| fs::rename(&part, &link));
    let error = pointed.err()?;
    let _ = fs::remove_file(&part);
    Some(format!(
        "{} does not point to the newest run: {error}",
        link.display()
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn run(runs: &Path, name: &str) -> PathBuf {
        let folder = runs.join(name);
        fs::create_dir_all(&folder).unwrap();
        fs::write(folder.join("config.toml"), "").unwrap();
        folder
    }

    #[test]
    fn latest_points_to_the_run_whatever_it_was_before() {
        let folder = tempfile::tempdir().unwrap();
        let runs = folder.path().join("runs");
        let (small, other) = (run(&runs, "small"), run(&runs, "other"));
        let latest = runs.join("latest");
        let target = || fs::read_link(&latest).unwrap();
        assert_eq!(point(&small), None);
        assert_eq!(target(), Path::new("small"));
        // By way of itself, and with a slash.
        assert_eq!(point(&latest), None);
        assert_eq!(point(&runs.join("latest/")), None);
        assert_eq!(target(), Path::new("small"));
        for circle in ["latest", "gone", "./latest"] {
            fs::remove_file(&latest).unwrap();
            symlink(circle, &latest).unwrap();
            assert!(find(&latest).is_err());
            assert_eq!(point(&other), None);
            assert_eq!(target(), Path::new("other"), "{circle}");
        }
        // Through a link to all of the runs, and to one run that lies elsewhere.
        let linked = folder.path().join("linked");
        symlink(&runs, &linked).unwrap();
        assert_eq!(point(&linked.join("small")), None);
        assert_eq!(target(), Path::new("small"));
        let away = run(folder.path(), "away");
        symlink(&away, runs.join("near")).unwrap();
        assert_eq!(point(&runs.join("near")), None);
        assert_eq!(target(), Path::new("near"));
        assert_eq!(point(&away), None);
        assert!(!folder.path().join("latest").exists());
    }

    #[test]
    fn a_latest_of_the_user_s_own_is_left() {
        let folder = tempfile::tempdir().unwrap();
        let runs = folder.path().join("runs");
        let small = run(&runs, "small");
        fs::create_dir(runs.join("latest")).unwrap();
        fs::write(runs.join("latest/mine"), "mine").unwrap();
        assert!(point(&small).unwrap().contains("is no link"));
        assert!(runs.join("latest/mine").is_file());
    }

    #[test]
    fn a_near_name_is_told() {
        let names = ["small", "antmaze-large-2"].map(str::to_owned);
        assert_eq!(near("smal", &names), Some(&names[0]));
        assert_eq!(near("runs/Small/", &names), Some(&names[0]));
        assert_eq!(near("antmaze-large", &names), Some(&names[1]));
        assert_eq!(near("nowhere", &names), None);
        assert_eq!(others(&names), "; there are small, antmaze-large-2");
    }
}
