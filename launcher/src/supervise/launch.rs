//! Launches a new run, or resumes one.

use std::process::ExitCode;
use std::time::Instant;

use anyhow::Context;
use config::Config;
use dataset::{Loaded, prepared};
use runs::folder;
use runs::times::Times;

use super::host::host;
use super::progress_file::RunProgress;
use super::resume::{self, Reopened, Resumed};
use super::{collect, salvage};
use crate::interrupts::Interrupts;
use crate::{check, output};

/// Launches a run and waits for its end. `data` are its data set's, if it existed.
pub(crate) fn launch(
    config: &Config,
    data: Option<Loaded>,
    plain: bool,
) -> anyhow::Result<ExitCode> {
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
    let data = match data {
        None => check::data(config)?,
        data => data,
    };
    check::allowance::segments(config)?;
    let folder = folder::create(config)?;
    outln!(
        "run {} with config {}",
        folder.path.display(),
        config.hash()
    );
    if let Some(data) = data {
        prepared::save(&folder.path, &data)?;
    }
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
    check::allowance::segments(&config)?;
    salvage::sweep(&folder.path, config.topology.actors);
    outln!(
        "run {} goes on after {:.0} s, with config {}",
        folder.path.display(),
        progress.seconds,
        config.hash()
    );
    notes.iter().for_each(|note| outln!("{note}"));
    let plan = agents::plan(&config).context("the config's algorithm is unknown")?;
    if let Some(needs) = plan.needs()
        && !prepared::is_fresh(&folder.path, &config, &needs)
        && let Some(data) = check::data(&config)?
    {
        prepared::save(&folder.path, &data)?;
    }
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
