//! Traces of processes that were killed: what is whole of them.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::ensure;
use durable::{Existing, OutputError};
use trace::{Recovered, TraceError};

use crate::outputs::{self, Force};
use crate::{replay, traces};

/// What a trace is called until it is whole.
const PART: &str = ".mcap.part";

#[derive(clap::Args)]
pub(crate) struct Args {
    /// The trace, a .part or a damaged one; of a folder or a run all that are not whole
    trace: PathBuf,
    /// Where it goes; X.cut.mcap beside it by default
    #[arg(long)]
    out: Option<PathBuf>,
    #[command(flatten)]
    force: Force,
}

/// `formica recover TRACE`: exit code 3 where something of it is lost, 1 where nothing is left.
pub(crate) fn run(args: &Args) -> anyhow::Result<ExitCode> {
    outputs::end_at_signals()?;
    let existing = args.force.existing();
    let named = traces::find(&args.trace)?;
    if let traces::Named::File(from) = &named {
        let to = args.out.clone().unwrap_or_else(|| beside(from));
        let recovered = trace::recover(from, &to, existing)?;
        return Ok(ExitCode::from(told(from, &recovered)));
    }
    let paths = traces::all(std::slice::from_ref(&args.trace))?;
    let paths: Vec<PathBuf> = paths.into_iter().filter(|path| is_damaged(path)).collect();
    ensure!(
        args.out.is_none() || paths.len() == 1,
        "--out is for one trace, and {} of those in {} are to be recovered; name one",
        paths.len(),
        args.trace.display()
    );
    if paths.is_empty() {
        say!("{}: all traces are whole", args.trace.display());
    }
    let codes = paths.iter().map(|from| {
        let to = args.out.clone().unwrap_or_else(|| beside(from));
        match trace::recover(from, &to, existing) {
            Ok(recovered) => told(from, &recovered),
            Err(error) => {
                log::warn!("{error}");
                1
            }
        }
    });
    Ok(ExitCode::from(replay::worst(codes)))
}

fn is_damaged(path: &Path) -> bool {
    trace::read_whole(path).is_err()
}

/// Says what was recovered and what was not; the exit code.
fn told(from: &Path, recovered: &Recovered) -> u8 {
    let messages: u64 = recovered.messages.values().sum();
    say!(
        "{}: {} steps, {messages} messages{}",
        recovered.path.display(),
        recovered.steps,
        match recovered.was_whole() {
            true => ", nothing was lost",
            false => "",
        }
    );
    if recovered.was_whole() {
        return 0;
    }
    let topics: Vec<String> = (recovered.messages.iter())
        .map(|(topic, count)| format!("{count} {}", topic.escape_debug()))
        .collect();
    say!("messages kept: {}", topics.join(", "));
    let from = from.display();
    if let Some(reason) = &recovered.cut {
        log::warn!("{from} is cut off: {reason}");
    }
    for lost in &recovered.lost {
        log::warn!("{from}: {lost}");
    }
    for damage in &recovered.damage {
        log::warn!("{from}: {damage}");
    }
    3
}

/// `X.cut.mcap` beside `X.mcap.part` or `X.mcap`.
fn beside(from: &Path) -> PathBuf {
    let name = from.file_name().unwrap_or_default().to_string_lossy();
    let stem = name.strip_suffix(PART).or(name.strip_suffix(".mcap"));
    from.with_file_name(format!("{}.cut.mcap", stem.unwrap_or(&name)))
}

/// Makes a trace of each part that a run's own actors left when they were killed, unless the
/// episode was played again; how many. Attached ones may still be at work.
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
            // What could not be salvaged stays for another attempt.
            if again || salvage(&part, &mut recovered) {
                let _ = std::fs::remove_file(&part);
            }
        }
    }
    recovered
}

/// Recovers one; whether the part is of no more use.
fn salvage(part: &Path, recovered: &mut usize) -> bool {
    let salvaged = match trace::recover(part, &beside(part), Existing::Refuse) {
        // What an earlier actor of that number left of the same episode stays.
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
        // A process that was killed as it began leaves nothing to recover.
        Err(error) => {
            let nothing = matches!(error, TraceError::Nothing { .. });
            log::warn!("a trace is not recovered: {error}");
            nothing
        }
    }
}

/// `X.2.cut.mcap` and so on: the first that is not there.
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
    fn a_part_is_removed_only_when_there_is_nothing_more_in_it() {
        let run = tempfile::tempdir().unwrap();
        let traces = run.path().join("traces");
        fs::create_dir(&traces).unwrap();
        let part = |episode: &str| traces.join(format!("{episode}.actor-0.mcap.part"));
        // Nothing in it; one of an actor that this run has not; one that was played again.
        fs::write(part("a"), mcap_magic()).unwrap();
        fs::write(traces.join("b.actor-7.mcap.part"), mcap_magic()).unwrap();
        fs::write(part("c"), mcap_magic()).unwrap();
        fs::write(traces.join("c.mcap"), "").unwrap();
        // Not to be read: whoever looks after the disk may yet have it back.
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
