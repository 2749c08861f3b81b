//! The link `latest` to the newest run.

use std::fs;
use std::os::unix::fs::symlink;
use std::path::{Component, Path};

use crate::find::LATEST;

/// Points `latest` to a run, if its folder is in a folder of runs. Returns what went wrong. `found` is the
/// folder as the user gave it.
pub fn point(found: &Path) -> Option<String> {
    let whole = fs::canonicalize(found).ok()?;
    // If the run is linked to from elsewhere, `latest` points to that link.
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
    // A new link is renamed over it: it never is missing, and a link to itself is replaced.
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
    use std::path::PathBuf;

    use super::*;
    use crate::find::find;

    fn run(runs: &Path, name: &str) -> PathBuf {
        let folder = runs.join(name);
        fs::create_dir_all(&folder).unwrap();
        fs::write(folder.join("config.toml"), "").unwrap();
        folder
    }

    #[test]
    fn latest_points_to_the_run_whatever_it_pointed_to_before() {
        let folder = tempfile::tempdir().unwrap();
        let runs = folder.path().join("runs");
        let (small, other) = (run(&runs, "small"), run(&runs, "other"));
        let latest = runs.join("latest");
        let target = || fs::read_link(&latest).unwrap();
        assert_eq!(point(&small), None);
        assert_eq!(target(), Path::new("small"));
        // Through the link itself, and with a slash.
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
        // Through a link to the folder of runs, and through one to a run elsewhere.
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
    fn a_folder_called_latest_is_left_alone() {
        let folder = tempfile::tempdir().unwrap();
        let runs = folder.path().join("runs");
        let small = run(&runs, "small");
        fs::create_dir(runs.join("latest")).unwrap();
        fs::write(runs.join("latest/mine"), "mine").unwrap();
        assert!(point(&small).unwrap().contains("is no link"));
        assert!(runs.join("latest/mine").is_file());
    }
}
