//! The main thread: the channels, and the threads of the stages.

use std::cell::Cell;
use std::collections::VecDeque;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{self, Sender};
use std::thread::Scope;
use std::time::{Duration, Instant};

use agents::{GraphRule, Network, Parts, Plan, Publication, Weights};
use config::Config;
use dataset::{Dataset, Shape};
use maze::Layout;
use simulator::RowLayout;
use wire::{
    Bus, Directive, DirectiveSubscriber, GRAPH, GraphSubscriber, Metric, OwnedTrajectory, Phase,
    Reader, Reporter, Role, Rounds, State, Status, TrajectoryReceiver, Versions, WeightsPublisher,
};

use crate::commands::{Command, CommandQueue, OwnedRollout};
use crate::policy_lag::PolicyLag;
use crate::save;
use crate::stage::{self, StageContext, StageEvent, Start};
use crate::stages::Stages;

const _: () = assert!(agents::PARTS == wire::PARTS && agents::GRAPH == GRAPH);

/// Weights that nobody would take: training them on does not help.
#[derive(Debug, thiserror::Error)]
#[error(
    "the {network}'s weights diverged (value {at} is not finite); lower its learning_rate, or look \
     for huge values in the data"
)]
pub struct Diverged {
    network: &'static str,
    at: usize,
}

/// Versions of the graph whose structure is remembered.
const REMEMBERED: usize = 64;

struct Learner<'c> {
    config: &'c Config,
    plan: &'c dyn Plan,
    folder: &'c Path,
    networks: Vec<Network>,
    rule: Option<Arc<dyn GraphRule>>,
    receiver: TrajectoryReceiver,
    layout: RowLayout,
    publishers: Vec<WeightsPublisher>,
    graphs: Option<GraphSubscriber>,
    directives: DirectiveSubscriber,
    reporter: Reporter,
    status: Status,
    parts: Parts,
    /// Versions that were published, and of the graph that the last weights over it are of.
    versions: Versions,
    stages: Stages,
    /// Structures of the newest versions of the graph.
    structures: VecDeque<(u64, u64)>,
    lag: PolicyLag,
    rounds: Rounds,
    settling: bool,
}

pub(crate) fn run(
    config: &Config,
    plan: &dyn Plan,
    folder: &Path,
    bus: &Bus,
    stop: &Arc<AtomicBool>,
) -> anyhow::Result<()> {
    let reporter = Reporter::new(bus)?;
    let mut status = Status {
        role: Role::Learner as u32,
        ..Status::default()
    };
    status.set_text("loading the data set");
    reporter.status(&status);
    let networks = plan.networks();
    let publishers = (0..networks.len()).map(|number| WeightsPublisher::new(bus, number));
    let rule = plan.graph();
    let layout = RowLayout::new(&bus.limits().spaces);
    let mut learner = Learner {
        config,
        plan,
        folder,
        receiver: TrajectoryReceiver::new(bus, Reader::Learner, folder)?,
        layout,
        publishers: publishers.collect::<Result<_, _>>()?,
        graphs: match rule {
            Some(_) => Some(GraphSubscriber::new(bus)?),
            None => None,
        },
        rule,
        directives: DirectiveSubscriber::new(bus)?,
        reporter,
        status,
        parts: Parts::new(networks.len()),
        networks,
        versions: [0; wire::PARTS],
        stages: Stages::new(plan),
        structures: VecDeque::new(),
        lag: PolicyLag::new(plan.on_policy(), config.topology.max_policy_lag),
        rounds: Rounds::after(0, layout),
        settling: false,
    };
    let data = match plan.needs() {
        Some(_) => {
            let data = dataset::prepared::open(folder)?.data;
            learner.describe(&data)?;
            data
        }
        None => Dataset::new(Shape::vectors(0, 0)),
    };
    let halt = AtomicBool::new(false);
    let result = std::thread::scope(|scope| {
        let result = learner.work(scope, &Arc::new(data), &halt, stop);
        halt.store(true, Ordering::Relaxed);
        result
    });
    result?;
    learner.finish()
}

impl<'c> Learner<'c> {
    fn work<'s>(
        &mut self,
        scope: &'s Scope<'s, '_>,
        data: &Arc<Dataset>,
        halt: &'s AtomicBool,
        stop: &AtomicBool,
    ) -> anyhow::Result<()>
    where
        'c: 's,
    {
        let Some(rounds) = self.first_round(stop) else {
            return Ok(());
        };
        let (sender, events) = mpsc::channel();
        self.status.state = State::Working as u32;
        self.reporter.status(&self.status);
        let mut pulse = Instant::now();
        while !stop.load(Ordering::Relaxed) {
            let directive = self.directives.latest();
            self.receive(directive.phase());
            self.publishers
                .iter()
                .for_each(WeightsPublisher::keep_alive);
            while let Ok(event) = events.try_recv() {
                self.handle(event)?;
            }
            self.take_graph();
            self.begin_stages(scope, data, rounds, &sender, halt);
            self.round(&directive);
            if directive.phase() == Phase::Settle {
                self.settle(&directive);
            }
            if pulse.elapsed() > Duration::from_millis(500) {
                self.pulse();
                pulse = Instant::now();
            }
            if directive.phase() == Phase::Finish && self.receiver.all_left() {
                return Ok(());
            }
            self.receiver.wait(Duration::from_millis(50));
        }
        Ok(())
    }

    /// In rounds, the launcher knows which of them all have learned from. `None` where the process
    /// is stopped before that is known.
    fn first_round(&mut self, stop: &AtomicBool) -> Option<u32> {
        if !self.config.run.deterministic {
            return Some(u32::MAX);
        }
        let receiver = &self.receiver;
        let wait = || {
            receiver.wait(Duration::from_millis(50));
            !stop.load(Ordering::Relaxed)
        };
        let rounds = self.directives.first(wait)?.round;
        self.rounds = Rounds::after(rounds, self.layout);
        self.status.round = rounds;
        Some(rounds)
    }

    /// Starts the threads of stages that have all that they need.
    fn begin_stages<'s>(
        &mut self,
        scope: &'s Scope<'s, '_>,
        data: &Arc<Dataset>,
        rounds: u32,
        sender: &Sender<StageEvent>,
        halt: &'s AtomicBool,
    ) where
        'c: 's,
    {
        for (number, spec) in self.stages.ready(&self.parts) {
            let (queue, commands) = CommandQueue::new();
            self.stages.begin(number, queue);
            let context = StageContext {
                sender: sender.clone(),
                stop: halt,
                folder: self.folder,
                config: self.config,
                rounds,
                ended: Cell::new(false),
            };
            let start = Start {
                plan: self.plan,
                number,
                spec,
                data: Arc::clone(data),
                parts: self.parts.clone(),
                commands,
            };
            stage::spawn(scope, start, context);
        }
    }

    /// What the data are, as numbers.
    fn describe(&self, data: &Dataset) -> anyhow::Result<()> {
        let layout = Layout::of(&self.config.maze.layout, &self.config.maze.rows)?;
        let goal = layout.goals().first().copied().unwrap_or(layout.start());
        let [start, goal] = [layout.start(), goal].map(|cell| layout.centre(cell));
        let share = data.share_from_to(start, goal, maze::CELL_SIZE / 2.0);
        for (name, value) in [
            ("data/rows", data.len() as f64),
            ("data/episodes", data.episodes.len() as f64),
            ("data/start_to_goal", f64::from(share)),
        ] {
            self.reporter
                .metric(&Metric::new(Role::Learner, 0, name, 0, value));
        }
        Ok(())
    }

    /// Takes in what actors sent; in training it goes to the stages that learn from it.
    fn receive(&mut self, phase: Phase) {
        let (rounds, structures, lag) = (&mut self.rounds, &self.structures, &mut self.lag);
        let deterministic = self.config.run.deterministic;
        let (current, layout, with_graph) = (self.versions, self.layout, self.rule.is_some());
        // While a stage has no time, what comes waits in the channel, and actors do in turn.
        let most = if self.stages.flush() { 16 } else { 0 };
        let stages = &mut self.stages;
        self.receiver.receive(most, |header, trajectory| {
            if phase != Phase::Train {
                return;
            }
            if deterministic {
                rounds.add(header, trajectory);
                return;
            }
            let version = header.versions[GRAPH];
            let known = structures.iter().find(|(known, _)| *known == version);
            if (known.is_none() && with_graph) || !lag.admits(header, &current) {
                return;
            }
            let rollout = OwnedRollout {
                trajectory: OwnedTrajectory::new(header, layout, trajectory),
                structure: known.map_or(0, |(_, structure)| *structure),
            };
            stages.push(&Command::Rollout(Arc::new(rollout)));
        });
        self.receiver.acknowledge();
    }

    /// Takes the newest graph. Before what it is made with is there it waits in its channel: it may
    /// come no second time.
    fn take_graph(&mut self) {
        let (Some(graphs), Some(rule)) = (&mut self.graphs, &self.rule) else {
            return;
        };
        let mut after = rule.after().into_iter();
        if !after.all(|network| self.parts.weights(network).is_some()) {
            return;
        }
        let Some(graph) = graphs.latest(|bytes| rule.read(bytes)) else {
            return;
        };
        let graph = Arc::new(graph);
        self.structures
            .push_front((graph.version, graph.structure()));
        self.structures.truncate(REMEMBERED);
        self.parts.set_graph(Arc::clone(&graph));
        // In rounds a graph goes with its rollouts.
        if !self.config.run.deterministic && !self.settling {
            self.stages.push(&Command::Graph(Arc::clone(&graph)));
        }
        if !self.networks.iter().any(|network| network.over_graph) {
            self.versions[GRAPH] = graph.version;
        }
    }

    /// Learns from a round once it is whole and the graph-builder has learned from it.
    fn round(&mut self, directive: &Directive) {
        let round = self.rounds.taken() + 1;
        let graph = self.parts.graph().cloned();
        let newer = |graph: &Arc<graph::Graph>| graph.version > u64::from(round);
        let ready = self.rule.is_none() || graph.as_ref().is_some_and(newer);
        if directive.round != round || !ready {
            return;
        }
        let Some(trajectories) = self.rounds.take(directive.episodes) else {
            return;
        };
        if !self.stages.any_online() {
            self.status.round = round;
            return;
        }
        let structure = |version: u64| {
            let mut known = self.structures.iter();
            known
                .find(|(known, _)| *known == version)
                .map_or(0, |(_, structure)| *structure)
        };
        let rollouts = trajectories.into_iter().map(|trajectory| OwnedRollout {
            structure: structure(trajectory.header.versions[GRAPH]),
            trajectory,
        });
        let rollouts = Arc::new(rollouts.collect());
        self.stages.push(&Command::Round(rollouts, graph));
    }

    /// Ends the training on the final graph, once it is there.
    fn settle(&mut self, directive: &Directive) {
        let wanted = directive.versions[GRAPH];
        let graph = self.parts.graph().cloned();
        let last = |graph: &Arc<graph::Graph>| wanted > 0 && graph.version >= wanted;
        let ready = self.rule.is_none() || graph.as_ref().is_some_and(last);
        if ready && !self.settling {
            self.settling = true;
            self.stages.push(&Command::Settle(graph));
        }
    }

    fn handle(&mut self, event: StageEvent) -> anyhow::Result<()> {
        match event {
            StageEvent::Metrics(metrics) => {
                for (name, step, value) in metrics.0 {
                    let metric = Metric::new(Role::Learner, 0, name, step, f64::from(value));
                    self.reporter.metric(&metric);
                }
            }
            StageEvent::Progress { stage, progress } => {
                self.stages.set_progress(stage, progress);
                self.status.updates += 1;
            }
            StageEvent::Published {
                stage,
                publications,
                rounds,
                done,
            } => {
                for publication in publications {
                    self.publish(publication)?;
                }
                if self.stages.is_online(stage) {
                    self.status.round = rounds;
                }
                if done {
                    self.stages.set_done(stage);
                }
            }
            StageEvent::Settled { stage } => {
                self.stages.set_settled(stage);
                self.checkpoint()?;
            }
            StageEvent::Failed(error) => return Err(error),
        }
        Ok(())
    }

    fn publish(&mut self, publication: Publication) -> anyhow::Result<()> {
        let Publication {
            network,
            version,
            weights,
            graph,
        } = publication;
        if let Some(at) = weights.iter().position(|value| !value.is_finite()) {
            let network = self.networks[network].title;
            return Err(Diverged { network, at }.into());
        }
        let (graph_version, structure) = graph.unwrap_or_default();
        self.publishers[network].publish(version, structure, &weights)?;
        self.versions[network] = version;
        if graph.is_some() {
            self.versions[GRAPH] = graph_version;
        }
        let weights = Weights {
            version,
            structure,
            values: weights.into(),
        };
        self.parts.set_weights(network, weights);
        Ok(())
    }

    /// Saves all weights that there are.
    fn checkpoint(&self) -> anyhow::Result<()> {
        for (number, network) in self.networks.iter().enumerate() {
            if let Some(weights) = self.parts.weights(number) {
                let checkpoint = self.plan.checkpoint(number, &weights.values);
                save::checkpoint(
                    self.folder,
                    network.name,
                    self.config,
                    weights.version,
                    &checkpoint,
                )?;
            }
        }
        Ok(())
    }

    fn pulse(&mut self) {
        let s = &mut self.status;
        self.stages.describe(s);
        self.receiver.report(s);
        let graphs = self.graphs.as_ref().map_or(0, GraphSubscriber::refused);
        s.refused += graphs + self.directives.refused();
        s.versions = self.versions;
        self.reporter.status(s);
        self.lag.report(&self.reporter, &self.versions);
    }

    fn finish(&mut self) -> anyhow::Result<()> {
        self.pulse();
        // Runs without an evaluation do not settle.
        if !self.stages.all_settled() {
            self.checkpoint()?;
        }
        if self.stages.all_done() {
            self.copy()?;
        }
        self.status.state = State::Finished as u32;
        self.reporter.status(&self.status);
        Ok(())
    }

    /// Writes trained weights to where the config wants them besides.
    fn copy(&self) -> anyhow::Result<()> {
        for (number, network) in self.networks.iter().enumerate() {
            if let Some(weights) = self.parts.weights(number) {
                let checkpoint = self.plan.checkpoint(number, &weights.values);
                if let Some(path) = &checkpoint.copy {
                    let path = Path::new(path);
                    save::write(
                        path,
                        network.name,
                        self.config,
                        weights.version,
                        &checkpoint,
                    )?;
                }
            }
        }
        Ok(())
    }
}
