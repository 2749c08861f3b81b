//! Recovers the traces of killed actors.

use std::path::{Path, PathBuf};

use durable::{Existing, OutputError};
use trace::TraceError;

/// Suffix of an incomplete trace.
const PART: &str = ".mcap.part";

/// The path `X.cut.mcap` beside `X.mcap.part` or `X.mcap`.
pub(crate) fn beside(from: &Path) -> PathBuf {
    let name = from.file_name().unwrap_or_default().to_string_lossy();
    let stem = name.strip_suffix(PART).or(name.strip_suffix(".mcap"));
    from.with_file_name(format!("{}.cut.mcap", stem.unwrap_or(&name)))
}

/// Recovers the incomplete traces that a run's own actors left when they were killed, except those of
/// episodes that were repeated. Returns how many were recovered. Attached actors may still be at work.
pub(crate) fn sweep(run: &Path, actors: usize) -> usize {
    let traces = run.join("traces");
    let folders = [traces.join("training"), traces];
    let mut recovered = 0;
    for folder in folders {
        let Ok(entries) = std::fs::read_dir(&folder) else {
            continue;
        };
        for entry in entries.flatten() {
            let part = entry.path();
            let name = entry.file_name();
            let name = name.to_string_lossy();
            let stem = name.strip_suffix(PART);
            let Some((episode, actor)) = stem.and_then(|stem| stem.rsplit_once(".actor-")) else {
                continue;
            };
            if !actor.parse::<usize>().is_ok_and(|actor| actor < actors) {
                continue;
            }
            let again = folder.join(format!("{episode}.mcap")).exists();
            // What could not be recovered stays for another attempt.
            if again || salvage(&part, &mut recovered) {
                let _ = std::fs::remove_file(&part);
            }
        }
    }
    recovered
}

/// Recovers one trace. Returns whether its incomplete file is no longer needed.
fn salvage(part: &Path, recovered: &mut usize) -> bool {
    let salvaged = match trace::recover(part, &beside(part), Existing::Refuse) {
        // Keep what an earlier actor with this id left of the same episode.
        Err(TraceError::Output(OutputError::Exists(_))) => match free(part) {
            Some(to) => trace::recover(part, &to, Existing::Refuse),
            None => return false,
        },
        salvaged => salvaged,
    };
    match salvaged {
        Ok(_) => {
            *recovered += 1;
            true
        }
        // A process that was killed at its start leaves nothing to recover.
        Err(error) => {
            let nothing = matches!(error, TraceError::Nothing { .. });
            log::warn!("a trace is not recovered: {error}");
            nothing
        }
    }
}

/// The first path of `X.2.cut.mcap` and so on that does not exist.
fn free(part: &Path) -> Option<PathBuf> {
    let name = part.file_name()?.to_str()?.strip_suffix(PART)?.to_owned();
    let names = (2..100).map(|number| part.with_file_name(format!("{name}.{number}.cut.mcap")));
    names.into_iter().find(|path| !path.exists())
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    #[test]
    fn an_incomplete_trace_is_removed_only_when_it_is_not_needed() {
        let run = tempfile::tempdir().unwrap();
        let traces = run.path().join("traces");
        fs::create_dir(&traces).unwrap();
        let part = |episode: &str| traces.join(format!("{episode}.actor-0.mcap.part"));
        // An empty one, one of an unknown actor, and one of a repeated episode.
        fs::write(part("a"), mcap_magic()).unwrap();
        fs::write(traces.join("b.actor-7.mcap.part"), mcap_magic()).unwrap();
        fs::write(part("c"), mcap_magic()).unwrap();
        fs::write(traces.join("c.mcap"), "").unwrap();
        // An unreadable one, which may become readable again.
        std::os::unix::fs::symlink("nowhere", part("d")).unwrap();
        assert_eq!(sweep(run.path(), 2), 0);
        let mut left: Vec<String> = (fs::read_dir(&traces).unwrap())
            .map(|entry| entry.unwrap().file_name().to_string_lossy().into_owned())
            .collect();
        left.sort();
        assert_eq!(
            left,
            ["b.actor-7.mcap.part", "c.mcap", "d.actor-0.mcap.part"]
        );
    }

    fn mcap_magic() -> &'static [u8] {
        b"\x89MCAP0\r\n"
    }
}
