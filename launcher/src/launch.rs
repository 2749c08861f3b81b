//! The whole run under supervision.

use std::process::ExitCode;
use std::time::{Duration, Instant};

use anyhow::Context;
use config::{Config, Kind};
use rustix::process::Signal;
use wire::{
    Bus, Directive, DirectivePublisher, EpisodeResult, Phase, ReportReader, Role, RunDomain, State,
    Status,
};

use crate::children::{Children, Ended};
use crate::interrupts::Interrupts;
use crate::progress::{MetricsFile, Progress, Statuses};
use crate::stages::Times;
use crate::{check, folder, role, stages};

/// How often children, reports and dead nodes are looked after.
const TICK: Duration = Duration::from_millis(50);
/// Dead nodes are swept this often: an actor that died must not hold a place on a channel.
const SWEEP: Duration = Duration::from_millis(200);
/// From the word to finish to SIGTERM, and from there to SIGKILL.
const PATIENCE: Duration = Duration::from_secs(8);
const HURRY: Duration = Duration::from_secs(4);

struct Run<'c> {
    config: &'c Config,
    bus: Bus,
    directives: DirectivePublisher,
    directive: Directive,
    reports: ReportReader,
    children: Children,
    statuses: Statuses,
    metrics: MetricsFile,
    progress: Progress,
    /// Of the evaluation.
    results: Vec<Option<EpisodeResult>>,
    times: Times,
    interrupts: Interrupts,
    /// Why the run ends before its time.
    failure: Option<String>,
}

/// Launches a run and stays until it has ended.
pub(crate) fn launch(config: &Config) -> anyhow::Result<ExitCode> {
    let interrupts = Interrupts::listen()?;
    for dead in wire::leftovers().iter().filter(|run| !run.alive) {
        if wire::clear(dead) {
            println!(
                "cleared what the dead run {} left in shared memory",
                dead.id
            );
        }
    }
    let start = Instant::now();
    if let Some(code) = collect(config, &interrupts)? {
        return Ok(code);
    }
    let times = Times {
        collect: start.elapsed(),
        ..Times::default()
    };
    let folder = folder::create(config)?;
    println!("run {} with config {}", folder.display(), config.hash());
    let domain = RunDomain::create()?;
    folder::write_whole(&folder.join("domain"), domain.id().as_bytes())?;
    let bus = Bus::host(&domain, &check::limits(config))?;
    let window = Duration::from_secs_f64(config.topology.restart_window_seconds);
    let mut run = Run {
        config,
        directives: DirectivePublisher::new(&bus)?,
        directive: Directive::default(),
        reports: ReportReader::new(&bus)?,
        bus,
        children: Children::new(&folder, domain.id(), config.topology.restarts, window),
        statuses: Statuses::new(),
        metrics: MetricsFile::create(&folder.join("metrics.csv"))?,
        progress: Progress::new(),
        results: vec![None; config.evaluation.episodes],
        times,
        interrupts,
        failure: None,
    };
    let outcome = run.supervise();
    let report = outcome.and_then(|()| run.report(&folder));
    drop(run);
    domain.remove();
    report
}

/// Makes the data set where it is missing. Some exit code when a signal stopped that.
fn collect(config: &Config, interrupts: &Interrupts) -> anyhow::Result<Option<ExitCode>> {
    let missing = !std::path::Path::new(&config.dataset.path).exists();
    if config.run.kind == Kind::Walker || config.collect.is_none() || !missing {
        return Ok(None);
    }
    println!("collect: making {}", config.dataset.path);
    role::collect(config, interrupts)
}

impl Run<'_> {
    /// From the first start to the last exit.
    fn supervise(&mut self) -> anyhow::Result<()> {
        self.directives.publish(&self.directive)?;
        if self.config.run.kind == Kind::Offline {
            self.children.start(Role::GraphBuilder, 0)?;
        }
        self.children.start(Role::Learner, 0)?;
        for id in 0..self.config.topology.actors {
            self.children.start(Role::Actor, id as u32)?;
        }
        let mut swept = Instant::now();
        let mut began = Instant::now();
        let mut trained = false;
        loop {
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
            let phase = match self.directive.phase() {
                Phase::Train => "train",
                Phase::Settle => "settle",
                Phase::Evaluate => "evaluate",
                Phase::Finish => "finish",
            };
            let extra = self.score_so_far();
            self.progress.show(phase, &self.statuses, &extra);
            match self.directive.phase() {
                Phase::Train if !trained => {
                    if self.has(State::Trained) {
                        trained = true;
                        self.times.train = lap(&mut began);
                    }
                }
                Phase::Train if self.config.run.kind == Kind::Walker => break,
                Phase::Train if self.config.run.deterministic => self.next_round()?,
                Phase::Train => {
                    if began.elapsed().as_secs_f64() >= self.config.rollouts.seconds {
                        self.turn(Phase::Settle)?;
                    }
                }
                Phase::Settle => {
                    if self.settle()? {
                        self.times.rollouts = lap(&mut began);
                        self.evaluate()?;
                    }
                }
                Phase::Evaluate if self.results.iter().all(Option::is_some) => {
                    self.times.evaluate = lap(&mut began);
                    break;
                }
                Phase::Evaluate | Phase::Finish => {}
            }
            std::thread::sleep(TICK);
        }
        self.finish()
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
        self.progress.say(&format!(
            "evaluate: {episodes} episodes with weights {low_version}, {high_version} and graph \
             {graph_version}"
        ));
        self.turn(Phase::Evaluate)
    }

    fn read_reports(&mut self) -> anyhow::Result<()> {
        let Self {
            reports,
            statuses,
            metrics,
            results,
            directive,
            ..
        } = self;
        let mut news = false;
        reports.read(
            |status| {
                if let Some(role) = Role::from_number(status.role) {
                    statuses.insert((role, status.id), (*status, Instant::now()));
                }
            },
            |metric| metrics.add(metric),
            |result| {
                // Words of an earlier round may come late.
                if result.round != directive.round || directive.is_done(result.episode) {
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
        if news {
            self.directives.publish(&self.directive)?;
        }
        Ok(())
    }

    /// Looks after the children; a failure that ends the run is noted.
    fn tend(&mut self, stopping: bool) -> anyhow::Result<()> {
        for (i, ended) in self.children.tend(stopping)? {
            let place = &self.children.places[i];
            let name = place.name();
            match ended {
                Ended::Finished if stopping => {}
                Ended::Finished => {
                    self.failure = Some(format!("{name} left before the run was over"));
                }
                Ended::Restarting(status) => {
                    self.progress
                        .say(&format!("{name} ended with {status}; starting it again"));
                }
                Ended::Failed(status) => {
                    let lines = place.last_lines(20);
                    let told = if lines.is_empty() {
                        String::new()
                    } else {
                        format!(":\n{lines}")
                    };
                    self.failure
                        .get_or_insert_with(|| format!("{name} failed with {status}{told}"));
                }
            }
        }
        Ok(())
    }

    /// Ends all processes in order: by word, by SIGTERM, by SIGKILL.
    fn finish(&mut self) -> anyhow::Result<()> {
        let early = self.failure.is_some() || self.interrupts.count() > 0;
        self.directive.phase = Phase::Finish as u32;
        self.directives.publish(&self.directive)?;
        let start = Instant::now();
        let seen = self.interrupts.count();
        let (mut termed, mut killed) = (false, false);
        while self.children.any_left(true) {
            self.read_reports()?;
            self.bus.sweep();
            self.directives.keep_alive();
            self.tend(true)?;
            let passed = start.elapsed();
            let patience = if early { PATIENCE / 4 } else { PATIENCE };
            let hasty = self.interrupts.count() > seen;
            if !termed && passed >= patience {
                self.children.signal(Signal::TERM);
                termed = true;
            }
            if !killed && (hasty || passed >= patience + HURRY) {
                self.children.signal(Signal::KILL);
                killed = true;
            }
            std::thread::sleep(TICK);
        }
        self.read_reports()
    }

    fn score_so_far(&self) -> String {
        let done: Vec<&EpisodeResult> = self.results.iter().flatten().collect();
        if self.directive.phase() != Phase::Evaluate || done.is_empty() {
            return String::new();
        }
        let successes: u32 = done.iter().map(|result| result.success).sum();
        format!("{successes} of {} episodes reached the goal", done.len())
    }

    /// Says how it went, and writes it down.
    fn report(&mut self, folder: &std::path::Path) -> anyhow::Result<ExitCode> {
        let restarted: usize = self
            .children
            .places
            .iter()
            .map(|place| place.restarted)
            .sum();
        let of = |role: Role| {
            self.statuses
                .iter()
                .filter(move |((r, _), _)| *r == role)
                .map(|(_, (status, _))| status)
        };
        let sent: u64 = of(Role::Actor).map(|status| status.sent).sum();
        let mut text = format!("transitions: {sent} sent");
        let mut agree = true;
        for role in [Role::Learner, Role::GraphBuilder] {
            for status in of(role) {
                text += &format!(
                    ", {} received by the {} ({} lost, {} refused)",
                    status.settled,
                    role.name(),
                    status.lost,
                    status.refused
                );
                if status.received > status.settled {
                    let more = status.received - status.settled;
                    text += &format!(" and {more} from actors that took no leave");
                }
                agree &= status.settled == sent && status.lost == 0;
            }
        }
        self.progress.say(&text);
        if restarted > 0 {
            self.progress.say(&format!("restarts: {restarted}"));
        }
        if self.interrupts.count() > 0 {
            self.progress.say("ended by signal");
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
            let score = self.score(folder)?;
            let newest = self.metrics.newest();
            let json = serde_json::to_string_pretty(&stages::json(newest, &self.times))?;
            let table = stages::table(self.config, newest, &self.times);
            folder::write_whole(&folder.join("stages.json"), json.as_bytes())?;
            self.progress.say(&table);
            self.progress.say(&score);
        }
        self.progress
            .say(&format!("all of it is in {}", folder.display()));
        Ok(ExitCode::SUCCESS)
    }

    fn score(&self, folder: &std::path::Path) -> anyhow::Result<String> {
        let results: Vec<&EpisodeResult> = self.results.iter().flatten().collect();
        let n = results.len().max(1) as f64;
        let successes: u32 = results.iter().map(|result| result.success).sum();
        let falls: u32 = results.iter().map(|result| result.fell).sum();
        // D4RL's references for antmaze are 0 and 1, so the score is the share of successes.
        let score = 100.0 * f64::from(successes) / n;
        let arrived = results.iter().filter(|result| result.success == 1);
        let steps: u32 = arrived.map(|result| result.steps).sum();
        let mut csv = String::from("episode,actor,success,steps,fell,nearest_m,edges,reached\n");
        for r in &results {
            let [edges, reached] = r.edges;
            csv += &format!(
                "{},{},{},{},{},{:.3},{edges},{reached}\n",
                r.episode, r.actor, r.success, r.steps, r.fell, r.nearest
            );
        }
        folder::write_whole(&folder.join("episodes.csv"), csv.as_bytes())?;
        let json = serde_json::json!({
            "score": score,
            "episodes": results.len(),
            "successes": successes,
            "fallen": falls,
            "mean_steps_of_successes": f64::from(steps) / f64::from(successes.max(1)),
            "maze": self.config.maze.layout,
            "seed": self.config.run.seed,
            "config": self.config.hash(),
            "version": env!("CARGO_PKG_VERSION"),
        });
        let text = serde_json::to_string_pretty(&json).context("writing the score")?;
        folder::write_whole(&folder.join("score.json"), text.as_bytes())?;
        let mean = f64::from(steps) / f64::from(successes.max(1));
        Ok(format!(
            "normalized score {score:.1}: {successes} of {} episodes reached the goal, in {mean:.0} \
             steps on average; {falls} ended on the back",
            results.len()
        ))
    }
}

/// Time since a moment, which moves on to now.
fn lap(began: &mut Instant) -> Duration {
    let passed = began.elapsed();
    *began = Instant::now();
    passed
}
