//! Creates the channels of a run, and supervises its processes from start to end.

use std::process::ExitCode;

use anyhow::Context;
use config::Config;
use runs::file;
use runs::folder::RunFolder;
use wire::{Bus, RunDomain};

use super::progress_file::RunProgress;
use super::run::Run;
use super::salvage;
use crate::check::limits::limits;
use crate::interrupts::Interrupts;
use crate::output;
use crate::record::metrics::Metrics;
use crate::show::live::Live;
use crate::show::progress::Progress;

/// Hosts a run until its end.
pub(super) fn host(
    config: &Config,
    folder: &RunFolder,
    saved: RunProgress,
    interrupts: Interrupts,
    plain: bool,
) -> anyhow::Result<ExitCode> {
    let folder = &folder.path;
    let plan = agents::plan(config).context("the config's algorithm is unknown")?;
    let domain = RunDomain::create()?;
    let bus = Bus::host(&domain, &limits(config, &*plan))?;
    // Written now, since all channels exist for actors that attach.
    file::write(&folder.join("domain"), domain.id().as_bytes())?;
    let several = config.topology.max_actors.max(config.topology.actors) > 1;
    let metrics = Metrics::open(folder, saved.seconds, several)?;
    // Earlier lines belong on the main screen, not on that of the view.
    output::flush();
    let live = (!plain).then(|| Live::start(config, folder));
    let mut progress = Progress::new(live.flatten());
    let mut run = Run::new(
        config,
        &*plan,
        folder,
        (bus, domain.id()),
        saved,
        (metrics, &mut progress),
        interrupts,
    )?;
    let outcome = run.supervise();
    let report = outcome.and_then(|()| run.report());
    drop(run);
    domain.remove();
    // After the score, which has priority on a full disk.
    let recovered = salvage::sweep(folder, config.topology.actors);
    if recovered > 0 {
        progress.print(&format!("traces of killed actors recovered: {recovered}"));
    }
    // Last, since the terminal may be blocked.
    progress.close();
    report
}
