//! The whole run under supervision.

mod ending;
mod phases;
mod reports;
mod supervise;

use std::path::Path;
use std::process::ExitCode;
use std::time::{Duration, Instant};

use config::{Config, Kind};
use dataset::{Loaded, prepared};
use durable::{Existing, Output};
use wire::{
    Bus, Directive, DirectivePublisher, EpisodeResult, Phase, ReportReader, Role, RunDomain,
};

use crate::accounts::Accounts;
use crate::children::{Children, Failure};
use crate::folder::RunFolder;
use crate::interrupts::{Interrupts, Stops};
use crate::live::Live;
use crate::metrics::Metrics;
use crate::output;
use crate::progress::{Progress, Statuses};
use crate::resume::{self, Reopened, Resumed};
use crate::saved::{Saved, Saver};
use crate::stages::Times;
use crate::throughput::Throughput;
use crate::{check, folder, outputs, recovery, role};

/// How often children, reports and dead nodes are looked after.
const TICK: Duration = Duration::from_millis(50);
/// Dead nodes are swept this often: an actor that died must not hold a place on a channel.
const SWEEP: Duration = Duration::from_millis(200);
/// Roles that learn from rounds together.
const LEARNERS: [Role; 2] = [Role::GraphBuilder, Role::Learner];

struct Run<'c> {
    config: &'c Config,
    folder: &'c Path,
    bus: Bus,
    directives: DirectivePublisher,
    directive: Directive,
    reports: ReportReader,
    children: Children,
    statuses: Statuses,
    accounts: Accounts,
    metrics: Metrics,
    throughput: Throughput,
    progress: &'c mut Progress,
    saver: Saver,
    /// Whether all weights are there.
    trained: bool,
    /// Whether graph and weights are final.
    settled: bool,
    /// Whether all is done.
    finished: bool,
    /// When the present part began.
    began: Instant,
    /// Versions of low, high and graph that the results are of.
    evaluated: [u64; 3],
    /// Of the evaluation.
    results: Vec<Option<EpisodeResult>>,
    times: Times,
    /// Of processes, by earlier launchers of the run.
    restarts_before: usize,
    /// Learner and graph-builder are to go on from a round that both have learned from.
    rewinding: bool,
    refused: u64,
    interrupts: Interrupts,
    stops: Stops,
    /// Why the run ends before its time.
    failure: Option<Failure>,
}

/// Launches a run and stays until it has ended. `data` is its data set, if it has been read.
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
    if let Some(code) = collect(config, &interrupts)? {
        return Ok(code);
    }
    let saved = Saved {
        times: Times {
            collect: start.elapsed(),
            ..Times::default()
        },
        ..Saved::default()
    };
    let data = match data {
        None => check::data(config)?,
        data => data,
    };
    let folder = folder::create(config)?;
    say!(
        "run {} with config {}",
        folder.path.display(),
        config.hash()
    );
    if let Some(data) = data {
        prepared::save(&folder.path, &data)?;
    }
    host(config, &folder, saved, interrupts, plain)
}

/// Goes on with a run that was stopped, or whose launcher died, with `table.key` and value pairs
/// laid over its config.
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
        saved,
        notes,
    } = match resume::open(name, sets)? {
        Reopened::Open(resumed) => *resumed,
        Reopened::Finished(told) => {
            say!("{told}");
            return Ok(ExitCode::SUCCESS);
        }
    };
    check::resources(&config)?;
    recovery::sweep(&folder.path, config.topology.actors);
    say!(
        "run {} goes on after {:.0} s, with config {}",
        folder.path.display(),
        saved.seconds,
        config.hash()
    );
    notes.iter().for_each(|note| say!("{note}"));
    if !prepared::is_fresh(&folder.path, &config)
        && let Some(data) = check::data(&config)?
    {
        prepared::save(&folder.path, &data)?;
    }
    host(&config, &folder, saved, interrupts, plain)
}

fn clear_dead() {
    let found = wire::leftovers();
    for dead in found
        .iter()
        .filter(|run| run.liveness == wire::Liveness::Dead)
    {
        if wire::clear(&dead.id).is_ok() {
            say!(
                "cleared what the dead run {} left in shared memory",
                dead.id
            );
        }
    }
}

/// Makes the data set where it is missing. Some exit code when a signal stopped that.
fn collect(config: &Config, interrupts: &Interrupts) -> anyhow::Result<Option<ExitCode>> {
    let missing = !Path::new(&config.dataset.path).exists();
    if config.run.kind == Kind::Walker || config.collect.is_none() || !missing {
        return Ok(None);
    }
    let path = Path::new(&config.dataset.path);
    say!("collect: making {}", path.display());
    let output = Output::file(path, Existing::Refuse, &[]).map_err(anyhow::Error::from);
    match output.and_then(|output| role::collect(config, &output, interrupts)) {
        // Of another launch: one data set is as good as the other.
        Err(error) if outputs::taken(&error) => {
            say!(
                "collect: another process made {} meanwhile; it is used",
                path.display()
            );
            Ok(None)
        }
        collected => collected,
    }
}

/// Makes the channels, and supervises the processes that use them.
fn host(
    config: &Config,
    folder: &RunFolder,
    saved: Saved,
    interrupts: Interrupts,
    plain: bool,
) -> anyhow::Result<ExitCode> {
    let folder = &folder.path;
    let domain = RunDomain::create()?;
    let bus = Bus::host(&domain, &check::limits(config))?;
    // Whoever wants to attach finds all channels there.
    folder::write(&folder.join("domain"), domain.id().as_bytes())?;
    let mut results = vec![None; config.evaluation.episodes];
    for result in &saved.results {
        if let Some(slot) = results.get_mut(result.episode as usize) {
            *slot = Some(*result);
        }
    }
    let since = Duration::from_secs_f64(saved.since.clamp(0.0, 1e9));
    let several = config.topology.max_actors.max(config.topology.actors) > 1;
    let metrics = Metrics::open(folder, saved.seconds, several)?;
    // What was said so far is not for the view's screen.
    output::flush();
    let live = (!plain).then(|| Live::start(config, folder));
    let mut progress = Progress::new(live.flatten());
    let mut run = Run {
        config,
        folder,
        directives: DirectivePublisher::new(&bus)?,
        directive: Directive {
            round: rounds_learned(config, folder),
            // What is final shall not move again.
            phase: match saved.settled && !config.run.deterministic {
                true => Phase::Settle as u32,
                false => Directive::default().phase,
            },
            ..Directive::default()
        },
        reports: ReportReader::new(&bus)?,
        bus,
        children: Children::new(&std::path::absolute(folder)?, domain.id()),
        statuses: Statuses::new(),
        accounts: saved.accounts,
        throughput: Throughput::new(metrics.steps_before(), Instant::now()),
        metrics,
        progress: &mut progress,
        saver: Saver::new(folder),
        trained: saved.trained,
        settled: saved.settled,
        finished: false,
        began: Instant::now()
            .checked_sub(since)
            .unwrap_or_else(Instant::now),
        evaluated: saved.evaluated,
        results,
        times: saved.times,
        restarts_before: saved.restarts,
        rewinding: false,
        refused: 0,
        interrupts,
        stops: Stops::listen()?,
        failure: None,
    };
    let outcome = run.supervise();
    let report = outcome.and_then(|()| run.report());
    drop(run);
    domain.remove();
    // After the score, which a disk may hold no more with them.
    let recovered = recovery::sweep(folder, config.topology.actors);
    if recovered > 0 {
        progress.say(&format!("traces of killed actors recovered: {recovered}"));
    }
    // Last: a terminal that takes nothing holds nothing else up.
    progress.close();
    report
}

/// Rounds of a deterministic run that both learner and graph-builder can go on from.
fn rounds_learned(config: &Config, folder: &Path) -> u32 {
    if !config.run.deterministic {
        return 0;
    }
    let checkpoints = folder.join("checkpoints");
    let rounds = |name| durable::States::new(&checkpoints, name).rounds();
    let graph = rounds("graph");
    if config.high.planner == config::Planner::Search {
        return graph.first().copied().unwrap_or(0);
    }
    let high = rounds("high");
    let common = graph.iter().filter(|round| high.contains(round)).max();
    common.copied().unwrap_or(0)
}
