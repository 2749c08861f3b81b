//! The whole run under supervision.

use std::cell::{Cell, RefCell};
use std::path::Path;
use std::process::ExitCode;
use std::time::{Duration, Instant};

use config::{Config, Kind};
use durable::{Existing, Output};
use rustix::process::Signal;
use wire::{
    Bus, Directive, DirectivePublisher, EpisodeResult, MAX_ACTORS, Phase, ReportReader, Role,
    RunDomain, State, Status,
};

use crate::accounts::Accounts;
use crate::children::{Children, Ended};
use crate::folder::RunFolder;
use crate::interrupts::Interrupts;
use crate::live::Live;
use crate::metrics::Metrics;
use crate::progress::{Progress, Scene, Statuses};
use crate::saved::{Saved, Saver};
use crate::stages::Times;
use crate::throughput::Throughput;
use crate::{check, folder, outputs, recovery, role, score, stages};

/// How often children, reports and dead nodes are looked after.
const TICK: Duration = Duration::from_millis(50);
/// Dead nodes are swept this often: an actor that died must not hold a place on a channel.
const SWEEP: Duration = Duration::from_millis(200);
/// A tick that took longer shows that the launcher itself stood still.
const STOOD_STILL: Duration = Duration::from_secs(2);
/// From the word to finish to SIGTERM, and from there to SIGKILL.
const PATIENCE: [Duration; 2] = [Duration::from_secs(8), Duration::from_secs(4)];
/// The same for a run that ends before its time: within 5 s in all.
const HASTE: [Duration; 2] = [Duration::from_millis(2500), Duration::from_millis(1500)];
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
    /// Why the run ends before its time.
    failure: Option<String>,
}

/// Launches a run and stays until it has ended.
pub(crate) fn launch(config: &Config, plain: bool) -> anyhow::Result<ExitCode> {
    let interrupts = Interrupts::listen()?;
    clear_dead();
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
    let folder = folder::create(config)?;
    println!(
        "run {} with config {}",
        folder.path.display(),
        config.hash()
    );
    host(config, &folder, saved, interrupts, plain)
}

/// Goes on with a run that was stopped, or whose launcher died.
pub(crate) fn resume(name: &str, plain: bool) -> anyhow::Result<ExitCode> {
    let interrupts = Interrupts::listen()?;
    clear_dead();
    let (folder, config) = folder::reopen(name)?;
    check::resources(&config)?;
    recovery::sweep(&folder.path, config.topology.actors);
    let saved = Saver::new(&folder.path).load().unwrap_or_default();
    println!(
        "run {} goes on after {:.0} s, with config {}",
        folder.path.display(),
        saved.seconds,
        config.hash()
    );
    host(&config, &folder, saved, interrupts, plain)
}

fn clear_dead() {
    for dead in wire::leftovers().iter().filter(|run| !run.alive) {
        if wire::clear(dead) {
            println!(
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
    println!("collect: making {}", path.display());
    let output = Output::file(path, Existing::Refuse, &[]).map_err(anyhow::Error::from);
    match output.and_then(|output| role::collect(config, &output, interrupts)) {
        // Of another launch: one data set is as good as the other.
        Err(error) if outputs::taken(&error) => {
            println!(
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
    let live = (!plain).then(|| Live::start(config, folder));
    let mut progress = Progress::new(live.flatten());
    let mut run = Run {
        config,
        folder,
        directives: DirectivePublisher::new(&bus)?,
        directive: Directive {
            round: rounds_learned(config, folder),
            ..Directive::default()
        },
        reports: ReportReader::new(&bus)?,
        bus,
        children: Children::new(folder, domain.id()),
        statuses: Statuses::new(),
        accounts: saved.accounts,
        throughput: Throughput::new(metrics.steps_before(), Instant::now()),
        metrics,
        progress: &mut progress,
        saver: Saver::new(folder),
        trained: saved.trained,
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

impl Run<'_> {
    /// From the first start to the last exit.
    fn supervise(&mut self) -> anyhow::Result<()> {
        self.directives.publish(&self.directive)?;
        if self.config.run.kind == Kind::Offline {
            self.children.start(Role::GraphBuilder, 0, self.config)?;
        }
        self.children.start(Role::Learner, 0, self.config)?;
        for id in 0..self.config.topology.actors {
            self.children.start(Role::Actor, id as u32, self.config)?;
        }
        let mut swept = Instant::now();
        let mut ticked = Instant::now();
        loop {
            if ticked.elapsed() > STOOD_STILL {
                self.children.forgive();
            }
            ticked = Instant::now();
            self.read_reports()?;
            if swept.elapsed() > SWEEP {
                self.bus.sweep();
                swept = Instant::now();
            }
            self.directives.keep_alive();
            self.tend(false)?;
            if self.failure.is_some() || self.interrupts.count() > 0 {
                break;
            }
            if self.saver.is_due() {
                self.save();
            }
            self.measure();
            self.show();
            if !self.rewound()? || self.advance()? {
                std::thread::sleep(TICK);
                continue;
            }
            break;
        }
        self.save();
        self.finish()
    }

    fn show(&mut self) {
        let scene = Scene {
            phase: self.directive.phase(),
            seconds: self.metrics.seconds(),
            statuses: &self.statuses,
            places: &self.children.places,
            newest: self.metrics.newest(),
            throughput: &self.throughput,
            score: self.score_so_far(),
            episodes: self.results.len(),
        };
        self.progress.show(&scene);
    }

    /// Writes the launcher's own metrics, and says what could not be written.
    fn measure(&mut self) {
        for (name, step, value) in self.throughput.due(Instant::now()) {
            self.metrics.add_own(name, step, value);
            self.progress.note(name, value);
        }
        self.metrics.flush_if_due();
        for complaint in self.metrics.complaints() {
            self.progress.warn(&complaint);
        }
    }

    /// Goes on to the next part when its time has come; false when all is done.
    fn advance(&mut self) -> anyhow::Result<bool> {
        match self.directive.phase() {
            Phase::Train if !self.has(State::Trained) => {}
            Phase::Train if !self.trained => {
                self.trained = true;
                self.times.train += lap(&mut self.began);
            }
            Phase::Train if self.config.run.kind == Kind::Walker => return Ok(false),
            Phase::Train if self.config.run.deterministic => self.next_round()?,
            Phase::Train => {
                if self.began.elapsed().as_secs_f64() >= self.config.rollouts.seconds {
                    self.turn(Phase::Settle)?;
                }
            }
            Phase::Settle => {
                if self.settle()? {
                    self.times.rollouts += lap(&mut self.began);
                    self.evaluate()?;
                }
            }
            Phase::Evaluate if self.results.iter().all(Option::is_some) => {
                self.times.evaluate += lap(&mut self.began);
                return Ok(false);
            }
            Phase::Evaluate | Phase::Finish => {}
        }
        Ok(true)
    }

    fn turn(&mut self, phase: Phase) -> anyhow::Result<()> {
        self.directive.phase = phase as u32;
        self.directives.publish(&self.directive)?;
        Ok(())
    }

    fn status(&self, role: Role) -> Option<&Status> {
        self.statuses.get(&(role, 0)).map(|(status, _)| status)
    }

    /// Whether learner and graph-builder have come as far.
    fn has(&self, state: State) -> bool {
        let done = |role: Role| {
            self.status(role)
                .is_some_and(|status| status.state >= state as u32)
        };
        done(Role::Learner) && (self.config.run.kind == Kind::Walker || done(Role::GraphBuilder))
    }

    /// Begins the next round once the one before is learned from; after the last one, settles.
    fn next_round(&mut self) -> anyhow::Result<()> {
        let learned = |role: Role| {
            self.status(role)
                .is_some_and(|s| s.round >= self.directive.round)
        };
        if !learned(Role::Learner) || !learned(Role::GraphBuilder) {
            return Ok(());
        }
        let rollouts = &self.config.rollouts;
        if self.directive.round as usize >= rollouts.rounds {
            // Of the graph that settles, nothing is known yet.
            self.directive.graph_version = 0;
            return self.turn(Phase::Settle);
        }
        self.ask_for(rollouts.episodes);
        self.directive.round += 1;
        self.progress.say(&format!(
            "round {} of {}: {} episodes",
            self.directive.round, rollouts.rounds, rollouts.episodes
        ));
        self.turn(Phase::Train)
    }

    /// The graph settles first, then the weights on it; whether both have.
    fn settle(&mut self) -> anyhow::Result<bool> {
        if self.directive.graph_version == 0 {
            let settled = State::Settled as u32;
            let builder = self.status(Role::GraphBuilder);
            if let Some(status) = builder.filter(|status| status.state == settled) {
                self.directive.graph_version = status.versions[2];
                self.turn(Phase::Settle)?;
            }
        }
        Ok(self.has(State::Settled))
    }

    /// Asks for episodes with the newest weights and graph.
    fn ask_for(&mut self, episodes: usize) {
        let [low, high, graph] = self.status(Role::Learner).map_or([0; 3], |s| s.versions);
        self.directive = Directive {
            phase: self.directive.phase,
            round: self.directive.round,
            episodes: episodes as u32,
            low_version: low,
            high_version: high,
            graph_version: graph,
            ..Directive::default()
        };
    }

    fn evaluate(&mut self) -> anyhow::Result<()> {
        self.ask_for(self.config.evaluation.episodes);
        self.directive.round = 0;
        let Directive {
            episodes,
            low_version,
            high_version,
            graph_version,
            ..
        } = self.directive;
        let versions = [low_version, high_version, graph_version];
        if versions != self.evaluated {
            self.results.fill(None);
            self.evaluated = versions;
        }
        // What was played with the same weights before the run was stopped is played.
        for result in self.results.iter().flatten() {
            self.directive.mark_done(result.episode);
        }
        let known = self.results.iter().flatten().count();
        let known = match known {
            0 => String::new(),
            _ => format!(", {known} of them known"),
        };
        self.progress.say(&format!(
            "evaluate: {episodes} episodes with weights {low_version}, {high_version} and graph \
             {graph_version}{known}"
        ));
        self.turn(Phase::Evaluate)
    }

    fn read_reports(&mut self) -> anyhow::Result<()> {
        let Self {
            config,
            reports,
            children,
            statuses,
            accounts,
            metrics,
            throughput,
            progress,
            results,
            directive,
            refused,
            ..
        } = self;
        // Both closures tell them.
        let (throughput, progress) = (RefCell::new(throughput), RefCell::new(progress));
        let attached = config.topology.actors..config.topology.max_actors.min(MAX_ACTORS);
        let most_steps = config.evaluation.max_steps as u32;
        let mut news = false;
        let strange = Cell::new(0);
        reports.read(
            |status| {
                let id = status.id as usize;
                let known = Role::from_number(status.role).filter(|_| id < MAX_ACTORS);
                let Some(role) = known else {
                    strange.set(strange.get() + 1);
                    return;
                };
                let own = children.place_of(role, status);
                if own.is_none() && (role != Role::Actor || !attached.contains(&id)) {
                    return; // The last word of a process that was replaced.
                }
                if let Some(place) = own {
                    place.hear(status);
                }
                if role == Role::Actor {
                    accounts.hear(status);
                    throughput.borrow_mut().hear(status, Instant::now());
                }
                progress.borrow_mut().hear(role, status);
                statuses.insert((role, status.id), (*status, Instant::now()));
            },
            |metric| {
                let name = metric.name();
                let mut throughput = throughput.borrow_mut();
                throughput.note(&name, metric.step, Instant::now());
                progress.borrow_mut().note(&name, metric.value);
                metrics.add(metric);
            },
            |result| {
                let sound = result.success <= 1
                    && result.fell <= 1
                    && result.steps <= most_steps
                    && result.nearest.is_finite()
                    && (result.actor as usize) < MAX_ACTORS;
                // Words of an earlier round may come late.
                if !sound || result.round != directive.round || directive.is_done(result.episode) {
                    strange.set(strange.get() + u64::from(!sound));
                    return;
                }
                directive.mark_done(result.episode);
                news = true;
                if directive.phase() == Phase::Evaluate
                    && let Some(slot) = results.get_mut(result.episode as usize)
                {
                    *slot = Some(*result);
                }
            },
        );
        *refused += strange.get();
        if news {
            self.directives.publish(&self.directive)?;
        }
        Ok(())
    }

    /// Looks after the children; a failure that ends the run is noted.
    fn tend(&mut self, stopping: bool) -> anyhow::Result<()> {
        for (i, ended) in self.children.tend(stopping)? {
            let place = &self.children.places[i];
            let (name, role, id) = (place.name(), place.role, place.id);
            match ended {
                Ended::Finished => continue,
                Ended::Restarting(why) => {
                    self.progress
                        .say(&format!("{name} {why}; starting it again"));
                    if self.config.run.deterministic && LEARNERS.contains(&role) {
                        self.children.hold(&LEARNERS);
                        self.rewinding = true;
                    }
                }
                Ended::GivenUp(why) => {
                    self.progress
                        .say(&format!("{name} {why}; going on without it"));
                }
                Ended::Failed(why) => {
                    let lines = place.last_lines(20);
                    let told = if lines.is_empty() {
                        String::new()
                    } else {
                        format!(":\n{lines}")
                    };
                    self.failure
                        .get_or_insert_with(|| format!("{name} {why}{told}"));
                }
            }
            // Actors' last words still count as steps that were made.
            if role != Role::Actor {
                self.statuses.remove(&(role, id));
            }
        }
        Ok(())
    }

    /// In rounds, one that learns and died is started again together with the other, from the
    /// last round that both have learned from. False while that is under way.
    fn rewound(&mut self) -> anyhow::Result<bool> {
        if !self.rewinding {
            return Ok(true);
        }
        if !self.children.are_gone(&LEARNERS) {
            return Ok(false);
        }
        self.directive = Directive {
            round: rounds_learned(self.config, self.folder),
            ..Directive::default()
        };
        self.directives.publish(&self.directive)?;
        self.statuses.retain(|(role, _), _| *role == Role::Actor);
        self.children.release(&LEARNERS);
        self.rewinding = false;
        Ok(true)
    }

    fn save(&mut self) {
        let saved = Saved {
            seconds: self.metrics.seconds(),
            times: self.times,
            trained: self.trained,
            since: self.began.elapsed().as_secs_f64(),
            evaluated: self.evaluated,
            results: self.results.iter().flatten().copied().collect(),
            restarts: self.restarts(),
            accounts: self.accounts.clone(),
        };
        if let Some(error) = self.saver.save(&saved) {
            self.progress.warn(&error);
        }
    }

    fn restarts(&self) -> usize {
        let own = self.children.places.iter().map(|place| place.restarted);
        self.restarts_before + own.sum::<usize>()
    }

    /// Ends all processes in order: by word, by SIGTERM, by SIGKILL.
    fn finish(&mut self) -> anyhow::Result<()> {
        let early = self.failure.is_some() || self.interrupts.count() > 0;
        self.directive.phase = Phase::Finish as u32;
        self.directives.publish(&self.directive)?;
        let start = Instant::now();
        let seen = self.interrupts.count();
        let (mut termed, mut killed) = (false, false);
        let [patience, hurry] = if early { HASTE } else { PATIENCE };
        while self.children.any_left(true) {
            self.read_reports()?;
            self.bus.sweep();
            self.directives.keep_alive();
            self.tend(true)?;
            self.measure();
            if self.progress.is_live() {
                self.show();
            }
            let passed = start.elapsed();
            let hasty = self.interrupts.count() > seen;
            if !termed && passed >= patience {
                self.children.signal(Signal::TERM);
                termed = true;
            }
            if !killed && (hasty || passed >= patience + hurry) {
                self.children.signal(Signal::KILL);
                killed = true;
            }
            std::thread::sleep(TICK);
        }
        self.read_reports()
    }

    /// Successes and episodes of the evaluation that are over.
    fn score_so_far(&self) -> Option<(usize, usize)> {
        let evaluating = matches!(self.directive.phase(), Phase::Evaluate | Phase::Finish);
        let done = self.results.iter().flatten();
        let successes = done.clone().filter(|result| result.success == 1).count();
        let done = done.count();
        (evaluating && done > 0).then_some((successes, done))
    }

    /// Says how it went, and writes it down.
    fn report(&mut self) -> anyhow::Result<ExitCode> {
        self.save();
        let readers = &self.bus.limits().readers;
        let (text, agree) = self.accounts.settle(self.folder, readers);
        self.progress.say(&text);
        let restarts = self.restarts();
        if restarts > 0 {
            self.progress.say(&format!("restarts: {restarts}"));
        }
        if self.refused > 0 {
            let refused = self.refused;
            self.progress
                .say(&format!("reports refused by the launcher: {refused}"));
        }
        let folder = self.folder;
        if self.interrupts.count() > 0 {
            self.progress.say(&format!(
                "ended by signal; `formica launch --resume {}` goes on",
                folder.display()
            ));
            return Ok(ExitCode::from(Interrupts::EXIT));
        }
        if let Some(failure) = self.failure.take() {
            anyhow::bail!(failure);
        }
        anyhow::ensure!(
            agree,
            "the counts of transitions do not agree; see {}",
            folder.display()
        );
        if self.config.run.kind == Kind::Offline {
            let results: Vec<EpisodeResult> = self.results.iter().flatten().copied().collect();
            let score = score::write(folder, self.config, &results)?;
            let newest = self.metrics.newest();
            let json = serde_json::to_string_pretty(&stages::json(newest, &self.times))?;
            let table = stages::table(self.config, newest, &self.times);
            folder::write(&folder.join("stages.json"), json.as_bytes())?;
            self.progress.say(&table);
            self.progress.say(&score);
        }
        self.progress
            .say(&format!("all of it is in {}", folder.display()));
        Ok(ExitCode::SUCCESS)
    }
}

/// Time since a moment, which moves on to now.
fn lap(began: &mut Instant) -> Duration {
    let passed = began.elapsed();
    *began = Instant::now();
    passed
}
