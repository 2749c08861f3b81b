//! Launches a new run, or resumes one.

use std::process::ExitCode;
use std::time::Instant;

use config::Config;
use runs::folder;
use runs::times::Times;

use super::host::host;
use super::progress_file::RunProgress;
use super::resume::{self, Reopened, Resumed};
use super::{collect, salvage};
use crate::interrupts::Interrupts;
use crate::{check, output};

/// Launches a run and waits for its end.
pub(crate) fn launch(config: &Config, plain: bool) -> anyhow::Result<ExitCode> {
    output::detach();
    let interrupts = Interrupts::listen()?;
    clear_dead();
    check::resources(config)?;
    let start = Instant::now();
    if let Some(code) = collect::if_missing(config, &interrupts)? {
        return Ok(code);
    }
    let progress = RunProgress {
        times: Times {
            collect: start.elapsed(),
            ..Times::default()
        },
        ..RunProgress::default()
    };
    let folder = folder::create(config)?;
    outln!(
        "run {} with config {}",
        folder.path.display(),
        config.hash()
    );
    host(config, &folder, progress, interrupts, plain)
}

/// Continues a run that was stopped, or whose launcher died, with `table.key` and value pairs that override
/// its config.
pub(crate) fn resume(
    name: &str,
    sets: &[(String, String)],
    plain: bool,
) -> anyhow::Result<ExitCode> {
    output::detach();
    let interrupts = Interrupts::listen()?;
    clear_dead();
    let Resumed {
        folder,
        config,
        progress,
        notes,
    } = match resume::open(name, sets)? {
        Reopened::Open(resumed) => *resumed,
        Reopened::Finished(message) => {
            outln!("{message}");
            return Ok(ExitCode::SUCCESS);
        }
    };
    check::resources(&config)?;
    salvage::sweep(&folder.path, config.topology.actors);
    outln!(
        "run {} goes on after {:.0} s, with config {}",
        folder.path.display(),
        progress.seconds,
        config.hash()
    );
    notes.iter().for_each(|note| outln!("{note}"));
    host(&config, &folder, progress, interrupts, plain)
}

/// Clears what dead runs left in shared memory.
fn clear_dead() {
    let found = wire::leftovers();
    for dead in found
        .iter()
        .filter(|run| run.liveness == wire::Liveness::Dead)
    {
        if wire::clear(&dead.id).is_ok() {
            outln!(
                "cleared what the dead run {} left in shared memory",
                dead.id
            );
        }
    }
}
