//! The last error in the log of a process.

use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::Path;

/// Maximum bytes that are read of a log.
const MOST_BYTES: u64 = 16 << 10;
/// Maximum lines that are shown.
const MOST_LINES: usize = 20;

/// The last error in a log after byte `from`, where the process started it, or else the last lines; `None`
/// if it logged nothing.
pub(super) fn last_error(log: &Path, from: u64) -> Option<String> {
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
    let mut message = lines[error.unwrap_or(0)..].to_vec();
    if let Some(first) = message.first_mut() {
        *first = error_of(first).unwrap_or(first);
    }
    let message = message[message.len().saturating_sub(MOST_LINES)..].join("\n");
    let message = message.trim();
    (!message.is_empty()).then(|| message.to_owned())
}

/// The error in a line of a log, after time and level.
fn error_of(line: &str) -> Option<&str> {
    let (time, rest) = line.split_once(' ')?;
    let text = rest.strip_prefix("ERROR ")?;
    time.ends_with('Z').then_some(text)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_last_error_of_the_process_itself_is_found() {
        let folder = tempfile::tempdir().unwrap();
        let log = folder.path().join("log");
        let before = "2026-11-28T00:18:04.123Z ERROR of an earlier process\n";
        let own = "2026-11-28T00:18:05.001Z INFO going on\n\
                   2026-11-28T00:18:05.002Z ERROR a.hdf5: damaged\n  row 3\n";
        std::fs::write(&log, format!("{before}{own}")).unwrap();
        let error = |from| last_error(&log, from);
        let expected = "a.hdf5: damaged\n  row 3";
        assert_eq!(error(before.len() as u64).as_deref(), Some(expected));
        assert_eq!(error(1 << 40), None, "it logged nothing");
        std::fs::write(&log, "a\nb\n").unwrap();
        assert_eq!(error(0).as_deref(), Some("a\nb"));
        assert_eq!(last_error(&folder.path().join("none"), 0), None);
    }

    #[test]
    fn a_long_log_is_cut() {
        let text: String = (0..100).map(|i| format!("line {i}\n")).collect();
        let message = of_text(&text).unwrap();
        assert_eq!(message.lines().count(), MOST_LINES);
        assert!(message.ends_with("line 99"), "{message}");
    }
}
