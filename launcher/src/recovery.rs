//! Traces of processes that were killed: what is whole of them.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::ensure;

/// What a trace is called until it is whole.
const PART: &str = ".mcap.part";

/// `formica recover TRACE`: exit code 3 where something of it is lost.
pub(crate) fn run(from: &Path, to: Option<&Path>) -> anyhow::Result<ExitCode> {
    let to = to.map_or_else(|| beside(from), Path::to_path_buf);
    ensure!(
        !to.exists(),
        "{} is there already; give another --out",
        to.display()
    );
    let recovered = trace::recover(from, &to)?;
    say!(
        "{}: {} steps{}",
        to.display(),
        recovered.steps,
        if recovered.cut.is_some() {
            ""
        } else {
            ", nothing was lost"
        }
    );
    match recovered.cut {
        Some(reason) => {
            log::warn!("{} is cut off: {reason}", from.display());
            Ok(ExitCode::from(3))
        }
        None => Ok(ExitCode::SUCCESS),
    }
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
            if !folder.join(format!("{episode}.mcap")).exists() {
                match trace::recover(&part, &beside(&part)) {
                    Ok(_) => recovered += 1,
                    // A process that was killed as it began leaves nothing to recover.
                    Err(error) => log::warn!("nothing to recover of a trace: {error}"),
                }
            }
            let _ = std::fs::remove_file(&part);
        }
    }
    recovered
}
