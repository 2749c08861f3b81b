//! What a process said last.

use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::Path;

/// Of a log, no more is looked at.
const MOST_BYTES: u64 = 16 << 10;
/// Lines that are shown.
const MOST_LINES: usize = 20;

/// The error that a process ended with, of the log that it began at byte `from`; where it told
/// none, its last lines. None where it said nothing.
pub(super) fn last_words(log: &Path, from: u64) -> Option<String> {
    let mut file = File::open(log).ok()?;
    let end = file.metadata().ok()?.len();
    let from = from.max(end.saturating_sub(MOST_BYTES));
    file.seek(SeekFrom::Start(from)).ok()?;
    let mut bytes = vec![];
    file.take(MOST_BYTES).read_to_end(&mut bytes).ok()?;
    of_text(&String::from_utf8_lossy(&bytes))
}

fn of_text(text: &str) -> Option<String> {
    let lines: Vec<&str> = text.lines().collect();
    let error = lines.iter().rposition(|line| error_of(line).is_some());
    let mut words = lines[error.unwrap_or(0)..].to_vec();
    if let Some(first) = words.first_mut() {
        *first = error_of(first).unwrap_or(first);
    }
    let words = words[words.len().saturating_sub(MOST_LINES)..].join("\n");
    let words = words.trim();
    (!words.is_empty()).then(|| words.to_owned())
}

/// The error that a line of a log tells: behind its time and its level.
fn error_of(line: &str) -> Option<&str> {
    let (time, rest) = line.split_once(' ')?;
    let text = rest.strip_prefix("ERROR ")?;
    time.ends_with('Z').then_some(text)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_last_error_of_the_process_itself_is_told() {
        let folder = tempfile::tempdir().unwrap();
        let log = folder.path().join("log");
        let before = "2026-11-28T00:18:04.123Z ERROR of an earlier process\n";
        let own = "2026-11-28T00:18:05.001Z INFO going on\n\
                   2026-11-28T00:18:05.002Z ERROR a.hdf5: damaged\n  row 3\n";
        std::fs::write(&log, format!("{before}{own}")).unwrap();
        let told = |from| last_words(&log, from);
        let expected = "a.hdf5: damaged\n  row 3";
        assert_eq!(told(before.len() as u64).as_deref(), Some(expected));
        assert_eq!(told(1 << 40), None, "it said nothing");
        std::fs::write(&log, "a\nb\n").unwrap();
        assert_eq!(told(0).as_deref(), Some("a\nb"));
        assert_eq!(last_words(&folder.path().join("none"), 0), None);
    }

    #[test]
    fn a_long_log_is_cut() {
        let text: String = (0..100).map(|i| format!("line {i}\n")).collect();
        let words = of_text(&text).unwrap();
        assert_eq!(words.lines().count(), MOST_LINES);
        assert!(words.ends_with("line 99"), "{words}");
    }
}
