//! What is wrong with a run file, as the user reads it.

use std::fmt;

/// Characters of a text that a message shows.
const SHOWN: usize = 60;

/// One thing that is wrong with a run file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Fault {
    /// Line in the file, from 1; 0 for a value given by `--set`, and, without a key, for the file
    /// as a whole.
    pub line: usize,
    /// `table.key`, or empty for a syntax error.
    pub key: String,
    /// What is wrong and what would be right.
    pub message: String,
}

/// All that is wrong with a run file.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub struct Faults {
    /// The file's name.
    pub origin: String,
    /// In the order of lines.
    pub faults: Vec<Fault>,
}

impl Faults {
    /// One fault of a file as a whole.
    pub(crate) fn of_file(origin: String, message: String) -> Self {
        let key = String::new();
        let faults = vec![Fault {
            line: 0,
            key,
            message,
        }];
        Self { origin, faults }
    }

    /// Adds a word about the file as a whole.
    pub fn note(&mut self, message: String) {
        self.faults.push(Fault {
            line: 0,
            key: String::new(),
            message,
        });
    }
}

impl fmt::Display for Faults {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (i, fault) in self.faults.iter().enumerate() {
            let gap = if i > 0 { "\n" } else { "" };
            let separator = if fault.key.is_empty() { "" } else { ": " };
            let Fault { line, key, message } = fault;
            match line {
                0 if key.is_empty() => write!(f, "{gap}{}: {message}", self.origin)?,
                0 => write!(f, "{gap}--set {key}{separator}{message}")?,
                _ => write!(f, "{gap}{}:{line}: {key}{separator}{message}", self.origin)?,
            }
        }
        Ok(())
    }
}

/// A text of the user's as a message shows it: on one line, without control characters, not too
/// long.
pub(crate) fn shown(text: &str) -> String {
    let mut shown: String = text.chars().take(SHOWN).collect();
    if shown.len() < text.len() {
        shown.push('…');
    }
    escaped(&shown)
}

/// The same in full, as for a path.
pub(crate) fn escaped(text: &str) -> String {
    let turns = |c: char| matches!(c, '\u{200e}' | '\u{200f}' | '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}');
    let plain = |c: char| !c.is_control() && !turns(c);
    text.chars()
        .flat_map(|c| match plain(c) {
            true => vec![c],
            false => c.escape_default().collect(),
        })
        .collect()
}

/// What to do about an unknown name: the one that was probably meant, or all that there are.
pub(crate) fn unknown(what: &str, name: &str, known: &[&str]) -> String {
    match nearest(name, known) {
        Some(known) => format!("unknown {what}; did you mean '{known}'?"),
        None => format!("unknown {what}; known are {}", known.join(", ")),
    }
}

/// The one of some names that was probably meant: upper case, hyphens and a few letters aside.
fn nearest<'n>(name: &str, known: &[&'n str]) -> Option<&'n str> {
    // A distance takes time that grows with both lengths.
    let name: String = name.chars().take(SHOWN).collect();
    let plain = name.to_lowercase().replace('-', "_");
    let distance = |known: &str| {
        let as_written = strsim::damerau_levenshtein(&name, known);
        as_written.min(strsim::damerau_levenshtein(
            &plain,
            &known.replace('-', "_"),
        ))
    };
    known
        .iter()
        .map(|known| (distance(known), *known))
        .min()
        .filter(|(distance, known)| *distance <= 1 + known.len() / 3)
        .map(|(_, known)| known)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_is_taken_for_the_nearest_one() {
        let known = ["maze", "max_nodes", "k-means++"];
        for (name, meant) in [
            ("Maze", Some("maze")),
            ("MAX-NODES", Some("max_nodes")),
            ("kmeans++", Some("k-means++")),
            ("something", None),
        ] {
            assert_eq!(nearest(name, &known), meant, "{name}");
        }
    }

    #[test]
    fn what_is_shown_of_a_text_is_short_and_harmless() {
        assert_eq!(shown("a \"b\" ä"), "a \"b\" ä");
        assert_eq!(shown("\u{1b}[31m\n"), "\\u{1b}[31m\\n");
        assert!(shown(&"x".repeat(1000)).chars().count() <= SHOWN + 1);
    }
}
