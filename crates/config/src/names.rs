//! Names of runs: what they may be, and the one that a file's name gives.

/// The longest name (bytes).
const LONGEST: usize = 64;

/// The name that a run file's name without its ending gives: letters of other scripts are written
/// in ASCII, what is neither letter, digit, '-', '_' nor '.' becomes one '-', none at either end,
/// at most 64 in all. It is empty where nothing is left.
pub(crate) fn of_file(stem: &str) -> String {
    let mut name = String::new();
    for c in deunicode::deunicode(stem).chars() {
        let plain = c.is_ascii_alphanumeric() || c == '_' || c == '.' || c == '-';
        match plain {
            true => name.push(c),
            false if name.ends_with('-') => {}
            false => name.push('-'),
        }
    }
    let ends = |c: char| c == '-' || c == '.';
    let mut name = name.trim_matches(ends).to_owned();
    name.truncate(LONGEST);
    name.trim_end_matches(ends).to_owned()
}

/// Whether a run may be called so.
///
/// # Errors
/// Why it may not.
pub(crate) fn check(name: &str) -> Result<(), String> {
    let plain = |b: u8| b.is_ascii_alphanumeric() || b"-_.".contains(&b);
    let sound = !name.is_empty() && name.len() <= LONGEST && name.bytes().all(plain);
    if !sound || name.starts_with('.') || name.starts_with('-') {
        return Err(format!(
            "a name has 1 to {LONGEST} letters, digits, '-', '_' or '.', and begins with none of '-' \
             and '.'"
        ));
    }
    let lower = name.to_ascii_lowercase();
    if lower == "latest" {
        return Err(format!(
            "'{name}' is taken: runs/latest is the newest run; choose another name"
        ));
    }
    let ends = [".mcap", ".part", ".toml"];
    if let Some(end) = ends.iter().find(|end| lower.ends_with(**end)) {
        return Err(format!(
            "commands would take '{name}' for a file; choose a name that does not end in '{end}'"
        ));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn names_of_files_give_names_of_runs() {
        for (stem, name) in [
            ("small", "small"),
            ("antmaze-large_v1.2", "antmaze-large_v1.2"),
            ("my config (1)", "my-config-1"),
            ("Größe", "Grosse"),
            ("café ☕", "cafe-coffee"),
            ("-x-", "x"),
            (".hidden", "hidden"),
            ("a'b\"c;rm", "a-b-c-rm"),
            ("a\nb\tc", "a-b-c"),
            ("---", ""),
            ("", ""),
        ] {
            assert_eq!(of_file(stem), name, "{stem}");
        }
        assert_eq!(of_file(&"ab".repeat(100)).len(), LONGEST);
    }

    #[test]
    fn what_a_command_would_misunderstand_is_no_name() {
        for name in [
            "", ".", "..", "-x", ".x", "latest", "Latest", "a b", "a/b", "x.mcap", "ä",
        ] {
            assert!(check(name).is_err(), "{name}");
        }
        assert!(check(&"a".repeat(LONGEST)).is_ok());
        assert!(check(&"a".repeat(LONGEST + 1)).is_err());
    }

    proptest! {
        #[test]
        fn any_file_gives_a_sound_name_or_a_fault_and_a_sound_name_is_kept(stem in "\\PC{0,100}") {
            let name = of_file(&stem);
            let reserved = ["latest", ".mcap", ".part", ".toml"];
            let taken = reserved.iter().any(|r| name.to_ascii_lowercase().ends_with(r));
            prop_assert!(name.is_empty() || taken || check(&name).is_ok(), "{}", name);
            prop_assert_eq!(&of_file(&name), &name);
        }

        #[test]
        fn a_sound_name_of_a_file_is_the_run_s(stem in "[a-z0-9_][a-zA-Z0-9._-]{0,40}[a-zA-Z0-9_]") {
            prop_assert_eq!(of_file(&stem), stem);
        }
    }
}
