//! Outputs replace nothing that they should not, and leave nothing behind.

use std::fs;
use std::io::Write;
use std::os::unix::fs::{PermissionsExt, symlink};
use std::os::unix::net::UnixListener;
use std::path::{Path, PathBuf};

use crate::{Existing, Output, OutputError, Staged};

const HOLDS: &[&str] = &["data/a", "data/b"];

fn file(path: &Path, existing: Existing, inputs: &[&Path]) -> Result<Output, OutputError> {
    Output::file(path, existing, inputs)
}

fn staged(output: &Output, text: &str) -> Staged {
    let staged = output.stage::<OutputError>(|file| {
        file.write_all(text.as_bytes()).unwrap();
        Ok(())
    });
    staged.unwrap()
}

/// Names in a folder, in order.
fn names(folder: &Path) -> Vec<String> {
    let entries = fs::read_dir(folder).unwrap();
    let mut names: Vec<String> = entries
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect();
    names.sort();
    names
}

fn told(result: Result<Output, OutputError>) -> String {
    result.unwrap_err().to_string()
}

#[test]
fn a_file_that_is_there_is_replaced_only_when_told_to() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("-x y.hdf5");
    staged(&file(&path, Existing::Refuse, &[]).unwrap(), "one")
        .place()
        .unwrap();
    fs::set_permissions(&path, fs::Permissions::from_mode(0o604)).unwrap();
    let error = told(file(&path, Existing::Refuse, &[]));
    assert!(
        error.ends_with("x y.hdf5 is there already; --force replaces it"),
        "{error}"
    );
    staged(&file(&path, Existing::Replace, &[]).unwrap(), "two")
        .place()
        .unwrap();
    assert_eq!(fs::read(&path).unwrap(), b"two");
    assert_eq!(
        fs::metadata(&path).unwrap().permissions().mode() & 0o777,
        0o604
    );
    assert_eq!(names(folder.path()), ["-x y.hdf5"]);
}

#[test]
fn an_input_is_never_an_output_by_any_name() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    fs::write(at("in"), "x").unwrap();
    fs::hard_link(at("in"), at("hard")).unwrap();
    symlink("in", at("soft")).unwrap();
    fs::create_dir_all(at("set/data")).unwrap();
    fs::write(at("set/data/a"), "x").unwrap();
    let [input, set] = [at("in"), at("set")];
    for name in ["in", "hard", "soft", "./in"] {
        let error = told(file(&at(name), Existing::Replace, &[&input]));
        assert!(error.contains("is the input"), "{name}: {error}");
    }
    // A part of an input, the input itself, and a folder around it.
    let error = told(file(&at("set/data/a"), Existing::Replace, &[&set]));
    assert!(error.contains("is the input"), "{error}");
    for name in ["set", "set/", "set/data", ""] {
        let error = told(Output::folder(&at(name), Existing::Replace, &[&set], HOLDS));
        assert!(error.contains("is the input"), "{name}: {error}");
    }
    assert_eq!(fs::read(at("in")).unwrap(), b"x");
}

#[test]
fn what_is_no_file_is_refused_even_when_told_to_replace() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    fs::create_dir(at("dir")).unwrap();
    let _listener = UnixListener::bind(at("socket")).unwrap();
    let pipe = rustix::fs::FileType::Fifo;
    rustix::fs::mknodat(rustix::fs::CWD, at("pipe"), pipe, 0o600.into(), 0).unwrap();
    symlink("dir", at("link")).unwrap();
    fs::write(at("file"), "x").unwrap();
    for (path, wanted) in [
        (at("dir"), "is a folder; name a file"),
        (at("dir/"), "is a folder; name a file"),
        (at("link"), "is a folder; name a file"),
        (at("socket"), "is a socket; name a file"),
        (at("pipe"), "is a pipe; name a file"),
        (PathBuf::from("/dev/null"), "is a device; name a file"),
        (at("file/x"), "file is a file; name a path within a folder"),
        (PathBuf::from("/"), "names nothing"),
        (PathBuf::from(""), "names nothing"),
        (at(".."), "names nothing"),
    ] {
        let error = told(file(&path, Existing::Replace, &[]));
        assert!(error.contains(wanted), "{}: {error}", path.display());
    }
    let error = told(Output::folder(&at("file"), Existing::Replace, &[], HOLDS));
    assert!(error.contains("is a file; name a folder"), "{error}");
    symlink("round", at("about")).unwrap();
    symlink("about", at("round")).unwrap();
    assert!(told(file(&at("round"), Existing::Replace, &[])).contains("cannot be written"));
}

#[test]
fn links_are_followed_and_stay() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    symlink("big/data", at("link")).unwrap();
    // What it leads to is not there yet.
    staged(&file(&at("link"), Existing::Refuse, &[]).unwrap(), "one")
        .place()
        .unwrap();
    assert_eq!(fs::read(at("big/data")).unwrap(), b"one");
    assert!(file(&at("link"), Existing::Refuse, &[]).is_err());
    staged(&file(&at("link"), Existing::Replace, &[]).unwrap(), "two")
        .place()
        .unwrap();
    assert!(fs::symlink_metadata(at("link")).unwrap().is_symlink());
    assert_eq!(fs::read(at("big/data")).unwrap(), b"two");
    assert_eq!(names(&at("big")), ["data"]);
}

#[test]
fn what_appears_meanwhile_is_left() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("x");
    let output = file(&path, Existing::Refuse, &[]).unwrap();
    // Two at once to one place: names beside it differ, and the second finds the first.
    let (first, second) = (staged(&output, "first"), staged(&output, "second"));
    assert_eq!(names(folder.path()).len(), 2);
    first.place().unwrap();
    let error = second.place().unwrap_err();
    assert!(matches!(error, OutputError::Appeared(_)), "{error}");
    assert_eq!(fs::read(&path).unwrap(), b"first");
    assert_eq!(names(folder.path()), ["x"]);
}

#[test]
fn what_fails_leaves_nothing_behind() {
    let folder = tempfile::tempdir().unwrap();
    let output = file(&folder.path().join("new/deep/x"), Existing::Refuse, &[]).unwrap();
    let failed = output.stage::<OutputError>(|file| {
        file.write_all(b"half").unwrap();
        Err(OutputError::Nameless(PathBuf::new()))
    });
    assert!(failed.is_err());
    assert_eq!(names(folder.path()), [""; 0]);
    drop(staged(&output, "whole, and not wanted"));
    assert_eq!(names(folder.path()), [""; 0]);
    // A folder that another process put something into stays.
    let written = staged(&output, "whole");
    fs::write(folder.path().join("new/other"), "").unwrap();
    drop(written);
    assert_eq!(names(&folder.path().join("new")), ["other"]);
}

#[test]
fn folders_are_placed_in_one_step_and_replaced_only_if_they_hold_the_same() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let stage = |output: &Output, text: &str| {
        let staged = output.stage_folder::<OutputError>(|within| {
            fs::create_dir(within.join("data")).unwrap();
            fs::write(within.join("data/a"), text).unwrap();
            Ok(())
        });
        staged.unwrap()
    };
    let output = Output::folder(&at("set/"), Existing::Refuse, &[], HOLDS).unwrap();
    let (first, second) = (stage(&output, "one"), stage(&output, "two"));
    first.place().unwrap();
    assert!(matches!(second.place(), Err(OutputError::Appeared(_))));
    assert!(Output::folder(&at("set"), Existing::Refuse, &[], HOLDS).is_err());

    let again = Output::folder(&at("set"), Existing::Replace, &[], HOLDS).unwrap();
    stage(&again, "three").place().unwrap();
    assert_eq!(fs::read(at("set/data/a")).unwrap(), b"three");
    // A file that is put into it while the output is written is not lost.
    let late = stage(&again, "four");
    fs::write(at("set/data/notes"), "mine").unwrap();
    assert!(matches!(late.place(), Err(OutputError::Foreign(_))));
    assert_eq!(fs::read(at("set/data/notes")).unwrap(), b"mine");
    let error = told(Output::folder(&at("set"), Existing::Replace, &[], HOLDS));
    assert!(error.contains("holds other files too"), "{error}");
    assert_eq!(names(folder.path()), ["set"]);
    assert_eq!(names(&at("set/data")), ["a", "notes"]);
    // An empty folder is somebody's, but nothing is lost with it.
    fs::create_dir(at("empty")).unwrap();
    assert!(Output::folder(&at("empty"), Existing::Refuse, &[], HOLDS).is_err());
    let empty = Output::folder(&at("empty"), Existing::Replace, &[], HOLDS).unwrap();
    stage(&empty, "five").place().unwrap();
    assert_eq!(names(&at("empty/data")), ["a"]);
}
