//! The state of a run under supervision. Its methods are in [`run_loop`](super::run_loop),
//! [`phases`](super::phases), [`reports`](super::reports) and [`ending`](super::ending).

use std::path::Path;
use std::time::{Duration, Instant};

use agents::Plan;
use config::Config;
use runs::times::Times;
use wire::{
    Bus, Directive, DirectivePublisher, EpisodeResult, Phase, ReportReader, Role, Versions,
};

use super::children::{Children, Failure};
use super::delivery_audit::DeliveryAudit;
use super::progress_file::{ProgressFile, RunProgress};
use crate::interrupts::{Interrupts, Stops};
use crate::record::metrics::Metrics;
use crate::record::throughput::Throughput;
use crate::show::progress::Progress;
use crate::show::scene::Statuses;

/// Time between two passes of the loop.
pub(super) const TICK: Duration = Duration::from_millis(50);
/// Roles that learn from rounds together.
pub(super) const LEARNERS: [Role; 2] = [Role::GraphBuilder, Role::Learner];

/// A run under supervision.
pub(super) struct Run<'c> {
    pub(super) config: &'c Config,
    pub(super) plan: &'c dyn Plan,
    /// Whether there is a graph, and a process that builds it.
    pub(super) graph: bool,
    pub(super) folder: &'c Path,
    pub(super) bus: Bus,
    pub(super) directives: DirectivePublisher,
    pub(super) directive: Directive,
    pub(super) reports: ReportReader,
    pub(super) children: Children,
    pub(super) statuses: Statuses,
    pub(super) audit: DeliveryAudit,
    pub(super) metrics: Metrics,
    pub(super) throughput: Throughput,
    pub(super) progress: &'c mut Progress,
    pub(super) progress_file: ProgressFile,
    /// Whether training is complete.
    pub(super) trained: bool,
    /// Whether graph and weights are final.
    pub(super) settled: bool,
    /// Whether the run is complete.
    pub(super) finished: bool,
    /// When the current part started.
    pub(super) part_start: Instant,
    /// Versions of weights and graph of the results.
    pub(super) evaluated: Versions,
    /// Results of the evaluation.
    pub(super) results: Vec<Option<EpisodeResult>>,
    pub(super) times: Times,
    /// Restarts of processes by earlier launchers of the run.
    pub(super) restarts_before: usize,
    /// Whether learner and graph-builder go back to a round that both have learned from.
    pub(super) rewinding: bool,
    /// Invalid reports.
    pub(super) refused: u64,
    pub(super) interrupts: Interrupts,
    pub(super) stops: Stops,
    /// Why the run failed.
    pub(super) failure: Option<Failure>,
}

impl<'c> Run<'c> {
    /// A run that continues from its saved progress.
    pub(super) fn new(
        config: &'c Config,
        plan: &'c dyn Plan,
        folder: &'c Path,
        (bus, domain): (Bus, &str),
        saved: RunProgress,
        (metrics, progress): (Metrics, &'c mut Progress),
        interrupts: Interrupts,
    ) -> anyhow::Result<Self> {
        let since = Duration::from_secs_f64(saved.since.clamp(0.0, 1e9));
        Ok(Self {
            config,
            plan,
            graph: plan.graph().is_some(),
            folder,
            directives: DirectivePublisher::new(&bus)?,
            directive: Directive {
                round: rounds_learned(config, plan, folder),
                // A final graph must not change again.
                phase: match saved.settled && !config.run.deterministic {
                    true => Phase::Settle as u32,
                    false => Directive::default().phase,
                },
                ..Directive::default()
            },
            reports: ReportReader::new(&bus)?,
            bus,
            children: Children::new(&std::path::absolute(folder)?, domain),
            statuses: Statuses::new(),
            results: results(config, &saved),
            audit: saved.audit,
            throughput: Throughput::new(config, metrics.steps_before(), Instant::now()),
            metrics,
            progress,
            progress_file: ProgressFile::new(folder),
            trained: saved.trained,
            settled: saved.settled,
            finished: false,
            part_start: Instant::now()
                .checked_sub(since)
                .unwrap_or_else(Instant::now),
            evaluated: saved.evaluated,
            times: saved.times,
            restarts_before: saved.restarts,
            rewinding: false,
            refused: 0,
            interrupts,
            stops: Stops::listen()?,
            failure: None,
        })
    }
}

/// Known results by episode.
fn results(config: &Config, saved: &RunProgress) -> Vec<Option<EpisodeResult>> {
    let mut results = vec![None; config.evaluation.episodes];
    for result in &saved.results {
        if let Some(slot) = results.get_mut(result.episode as usize) {
            *slot = Some(*result);
        }
    }
    results
}

/// Rounds of a deterministic run that the graph-builder and all stages that learn from rollouts can
/// continue from.
pub(super) fn rounds_learned(config: &Config, plan: &dyn Plan, folder: &Path) -> u32 {
    if !config.run.deterministic {
        return 0;
    }
    let checkpoints = folder.join("checkpoints");
    let stages = plan.stages().into_iter().filter(|stage| stage.online);
    let graph = plan.graph().map(|_| "graph");
    let names = graph.into_iter().chain(stages.map(|stage| stage.name));
    let rounds = names.map(|name| durable::States::new(&checkpoints, name).rounds());
    let common = rounds.reduce(|common, rounds| {
        let both = common.into_iter().filter(|round| rounds.contains(round));
        both.collect()
    });
    common.into_iter().flatten().max().unwrap_or(0)
}
