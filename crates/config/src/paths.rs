//! Paths of a run file: `~` and variables filled in, made absolute.

use std::ffi::OsString;
use std::path::{Path, PathBuf};

use crate::fault::shown;

/// How the paths in a run file are read.
#[derive(Debug, Clone, Copy, Default)]
pub struct Paths<'b> {
    /// Base of relative paths; by default the working directory.
    pub base: Option<&'b Path>,
    /// Whether the files may be missing.
    pub lenient: bool,
}

/// Fills in `~`, `$NAME` and `${NAME}`; `$$` is a dollar sign.
///
/// # Errors
/// What cannot be filled in.
pub(crate) fn expand(
    given: &str,
    variable: impl Fn(&str) -> Option<OsString>,
) -> Result<String, String> {
    let value = |name: &str| match variable(name).map(OsString::into_string) {
        Some(Ok(value)) if !value.is_empty() => Ok(value),
        Some(Ok(_)) => Err(format!("the variable {name} is empty")),
        Some(Err(_)) => Err(format!("the variable {name} is not UTF-8 text")),
        None => Err(format!(
            "the variable {name} is not set; set it or write the path out ('$$' is a dollar sign)"
        )),
    };
    if given.contains('\0') {
        return Err("a path has no zero byte".to_owned());
    }
    let mut path = String::new();
    let mut rest = given;
    if let Some(after) = given.strip_prefix('~') {
        if !after.is_empty() && !after.starts_with('/') {
            let user = after.split('/').next().unwrap_or_default();
            return Err(format!(
                "the home folder '~{}' is not looked up; write the path out",
                shown(user)
            ));
        }
        path = value("HOME").map_err(|_| {
            "the variable HOME, which '~' stands for, is not set; write the path out".to_owned()
        })?;
        rest = after;
    }
    while let Some((before, after)) = rest.split_once('$') {
        path.push_str(before);
        if let Some(after) = after.strip_prefix('$') {
            path.push('$');
            rest = after;
            continue;
        }
        let in_name = |c: char| c.is_ascii_alphanumeric() || c == '_';
        let (name, after) = match after.strip_prefix('{') {
            Some(braced) => braced.split_once('}').unwrap_or_default(),
            None => after.split_at(after.find(|c| !in_name(c)).unwrap_or(after.len())),
        };
        let sound = name.chars().all(in_name) && !name.starts_with(|c: char| c.is_ascii_digit());
        if name.is_empty() || !sound {
            return Err(
                "'$' begins a variable's name, as in $HOME or ${HOME}; write '$$' for a dollar sign"
                    .to_owned(),
            );
        }
        path.push_str(&value(name)?);
        rest = after;
    }
    path.push_str(rest);
    Ok(path)
}

/// The path from the root; a relative one begins at `base`, or else at the present folder. Links
/// in it stay as they are.
///
/// # Errors
/// A present folder that is gone or whose name is not UTF-8.
pub(crate) fn absolute(path: &str, base: Option<&Path>) -> Result<String, String> {
    let from = base.map_or_else(|| PathBuf::from(path), |base| base.join(path));
    let whole = std::path::absolute(from).map_err(|error| {
        format!("the present folder cannot be told: {error}; change to another")
    })?;
    whole.into_os_string().into_string().map_err(|_| {
        "the present folder's name is not UTF-8; launch from another or write the path out"
            .to_owned()
    })
}

/// An absolute path as a run file says it, so that nothing of it is filled in again.
pub(crate) fn written(absolute: &str) -> String {
    absolute.replace('$', "$$")
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn filled(given: &str) -> Result<String, String> {
        expand(given, |name| match name {
            "HOME" => Some("/home/me".into()),
            "DATA" => Some("/big/$x~".into()),
            "EMPTY" => Some("".into()),
            _ => None,
        })
    }

    #[test]
    fn home_and_variables_are_filled_in() {
        for (given, path) in [
            ("a/b.hdf5", "a/b.hdf5"),
            ("~", "/home/me"),
            ("~/x", "/home/me/x"),
            ("./~/x", "./~/x"),
            ("$HOME/x", "/home/me/x"),
            ("${DATA}set", "/big/$x~set"),
            ("a$$b", "a$b"),
            ("$$HOME", "$HOME"),
        ] {
            assert_eq!(filled(given).as_deref(), Ok(path), "{given}");
        }
    }

    #[test]
    fn what_cannot_be_filled_in_is_named() {
        for (given, told) in [
            ("$NONE/x", "the variable NONE is not set"),
            ("${NONE}", "the variable NONE is not set"),
            ("$EMPTY/x", "the variable EMPTY is empty"),
            ("~other/x", "'~other' is not looked up"),
            ("a$", "'$$' for a dollar sign"),
            ("${HOME", "'$$' for a dollar sign"),
            ("${a b}", "'$$' for a dollar sign"),
            ("$1", "'$$' for a dollar sign"),
            ("a\0b", "zero byte"),
        ] {
            let error = filled(given).unwrap_err();
            assert!(error.contains(told), "{given}: {error}");
        }
        let nowhere = expand("~/x", |_| None).unwrap_err();
        assert!(nowhere.contains("HOME"), "{nowhere}");
    }

    proptest! {
        #[test]
        fn a_written_path_is_read_as_itself(path in "/\\PC{0,40}") {
            prop_assert_eq!(filled(&written(&path)), Ok(path));
        }

        #[test]
        fn no_path_makes_it_panic(given in "[~$a{}/A_.]{0,12}") {
            let _ = filled(&given);
        }
    }
}
