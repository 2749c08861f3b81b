//! The graph-builder: data set and weights in, graph out; then what rollouts change of it.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{self, Receiver, TryRecvError};
use std::time::{Duration, Instant};

use agents::{BuildError, GraphRule, GraphWork, Parts, Rollout, Weights};
use anyhow::Context;
use config::Config;
use dataset::Dataset;
use durable::{Stamp, States};
use graph::Graph;
use maze::Layout;
use serde::{Deserialize, Serialize};
use simulator::RowLayout;
use wire::{
    Bus, DirectiveSubscriber, GRAPH, GraphPublisher, Metric, Phase, Reader, Reporter, Role, Rounds,
    RunDomain, State, Status, Trajectory, TrajectoryHeader, TrajectoryReceiver, WeightsSubscriber,
};

/// What the graph-builder is told.
#[derive(Debug, Clone, clap::Args)]
pub struct Args {
    /// The run's domain of channels (8 hexadecimal digits)
    #[arg(long)]
    pub domain: String,
    /// The run's folder
    #[arg(long)]
    pub folder: PathBuf,
}

/// Runs the graph-builder until the launcher says that all is done, or `stop` is set.
///
/// # Errors
/// A run that is not there, a channel that cannot be used, a config or data set that cannot be
/// read, data that make no graph.
pub fn run(args: &Args, stop: &Arc<AtomicBool>) -> anyhow::Result<()> {
    let config = agents::CONFIGS.of_run(&args.folder)?;
    let plan = agents::plan(&config).context("the config's algorithm is unknown")?;
    let rule = plan
        .graph()
        .with_context(|| format!("'{}' has no graph to build", config.run.algorithm))?;
    let domain = RunDomain::open(&args.domain)?;
    let bus = Bus::join(&domain, "graph-builder")?;
    let reporter = Reporter::new(&bus)?;
    let mut status = Status {
        role: Role::GraphBuilder as u32,
        ..Status::default()
    };
    status.set_text("loading the data set");
    reporter.status(&status);
    let receiver = TrajectoryReceiver::new(&bus, Reader::GraphBuilder, &args.folder)?;
    let loaded = dataset::prepared::open(&args.folder)?;
    for note in &loaded.notes {
        log::info!("{note}");
    }
    let data = loaded.data;
    let networks = plan.networks();
    let rows = RowLayout::new(&bus.limits().spaces);
    let subscribers = rule.after().into_iter().map(|number| {
        let subscriber = WeightsSubscriber::new(&bus, number)?;
        Ok((number, subscriber))
    });
    Builder {
        weights: subscribers.collect::<Result<_, wire::WireError>>()?,
        parts: Parts::new(networks.len()),
        rule,
        publisher: GraphPublisher::new(&bus)?,
        directives: DirectiveSubscriber::new(&bus)?,
        limit: bus.limits().graph_bytes,
        receiver,
        reporter,
        status,
        states: States::new(&args.folder.join("checkpoints"), "graph"),
        building: None,
        work: None,
        measured: None,
        rounds: Rounds::after(0, rows),
        rows,
        published: Instant::now(),
        began: Instant::now(),
        config: &config,
        folder: &args.folder,
        layout: Layout::of(&config.maze.layout, &config.maze.rows)?,
    }
    .work(&Arc::new(data), stop)
}

/// What is kept of the work.
#[derive(Serialize, Deserialize)]
struct Kept(Vec<u8>);

/// A rollout as the work sees it.
fn rollout<'a>(header: &TrajectoryHeader, trajectory: Trajectory<'a>) -> Rollout<'a> {
    Rollout {
        rows: trajectory.rows,
        choices: trajectory.choices,
        graph_version: header.versions[GRAPH],
        structure: 0,
        episode: header.name(),
    }
}

type Building = Receiver<Result<Box<dyn GraphWork>, BuildError>>;

struct Builder<'a> {
    config: &'a Config,
    folder: &'a Path,
    layout: Layout,
    rule: Arc<dyn GraphRule>,
    /// Of the networks that the graph is made with.
    weights: Vec<(usize, WeightsSubscriber)>,
    parts: Parts,
    publisher: GraphPublisher,
    directives: DirectiveSubscriber,
    /// What the graph's channel takes (bytes).
    limit: usize,
    receiver: TrajectoryReceiver,
    reporter: Reporter,
    status: Status,
    states: States,
    /// A thread that builds.
    building: Option<Building>,
    work: Option<Box<dyn GraphWork>>,
    /// The version that was measured last.
    measured: Option<Arc<Graph>>,
    rounds: Rounds,
    rows: RowLayout,
    published: Instant,
    began: Instant,
}

impl Builder<'_> {
    fn work(mut self, data: &Arc<Dataset>, stop: &AtomicBool) -> anyhow::Result<()> {
        self.status.state = State::Waiting as u32;
        self.status.set_text("waiting for weights");
        self.reporter.status(&self.status);
        let Some(mut kept) = self.kept(stop) else {
            return Ok(());
        };
        let refresh = self.rule.refresh();
        let mut pulse = Instant::now();
        while !stop.load(Ordering::Relaxed) {
            let directive = self.directives.latest();
            let phase = directive.phase();
            self.receive(phase);
            if self.take_weights() && self.work.is_none() && self.building.is_none() {
                match kept.take() {
                    Some(kept) => self.restore(&kept)?,
                    None => self.build(data),
                }
            }
            self.adopt()?;
            let changed = self.work.as_ref().is_some_and(|work| work.has_changed());
            let due = changed && self.published.elapsed() >= refresh;
            if due && phase == Phase::Train && !self.config.run.deterministic {
                self.publish()?;
            }
            if directive.round == self.rounds.taken() + 1
                && let Some(trajectories) = self.rounds.take(directive.episodes)
            {
                if let Some(work) = &mut self.work {
                    for trajectory in &trajectories {
                        work.learn(&rollout(&trajectory.header, trajectory.view()));
                    }
                }
                self.publish()?;
            }
            if phase == Phase::Settle && self.work.is_some() {
                self.status.state = State::Settled as u32;
            }
            self.publisher.keep_alive();
            if pulse.elapsed() > Duration::from_millis(500) {
                self.pulse();
                pulse = Instant::now();
            }
            if phase == Phase::Finish && self.receiver.all_left() {
                break;
            }
            self.receiver.wait(Duration::from_millis(50));
        }
        self.pulse();
        self.status.state = State::Finished as u32;
        self.reporter.status(&self.status);
        Ok(())
    }

    /// What the one before left: some of nothing where there is nothing, and nothing where the
    /// process shall end before that is known.
    fn kept(&mut self, stop: &AtomicBool) -> Option<Option<Kept>> {
        let mut rounds = u32::MAX;
        if self.config.run.deterministic {
            // The launcher knows which rounds all have learned from.
            let receiver = &self.receiver;
            rounds = self
                .directives
                .first(|| {
                    receiver.wait(Duration::from_millis(50));
                    !stop.load(Ordering::Relaxed)
                })?
                .round;
            self.rounds = Rounds::after(rounds, self.rows);
            self.status.round = rounds;
        }
        let newest = self.states.newest::<Kept>(rounds);
        for damaged in &newest.damaged {
            log::warn!("{damaged}; going on from the one before");
        }
        Some(newest.state.map(|(stamp, kept)| {
            log::info!("going on from version {}", stamp.number);
            self.states.forget_after(stamp.number);
            kept
        }))
    }

    /// Takes newer weights. Returns whether all that the graph is made with are there.
    fn take_weights(&mut self) -> bool {
        for (number, subscriber) in &mut self.weights {
            if let Some(newer) = subscriber.latest() {
                let weights = Weights {
                    version: newer.version,
                    structure: newer.shape_hash,
                    values: newer.values.into(),
                };
                self.parts.set_weights(*number, weights);
            }
        }
        let mut needed = self.weights.iter();
        needed.all(|(number, _)| self.parts.weights(*number).is_some())
    }

    /// Goes on from what the one before left.
    fn restore(&mut self, kept: &Kept) -> anyhow::Result<()> {
        let (work, graph) = self.rule.restore(&kept.0, &self.parts)?;
        self.work = Some(work);
        self.announce(&graph)
    }

    /// Begins to build, on a thread: actors are answered meanwhile.
    fn build(&mut self, data: &Arc<Dataset>) {
        self.status.state = State::Working as u32;
        self.status.set_text("building the graph");
        let (sender, receiver) = mpsc::channel();
        self.building = Some(receiver);
        let (rule, data, parts) = (Arc::clone(&self.rule), Arc::clone(data), self.parts.clone());
        let folder = self.folder.to_path_buf();
        // It ends with the process, should that end first.
        std::thread::spawn(move || {
            let _ = sender.send(rule.build(&data, &parts, &folder));
        });
        self.began = Instant::now();
    }

    /// Takes what was built, once it is.
    fn adopt(&mut self) -> anyhow::Result<()> {
        let Some(building) = &self.building else {
            return Ok(());
        };
        match building.try_recv() {
            Err(TryRecvError::Empty) => return Ok(()),
            Err(TryRecvError::Disconnected) => anyhow::bail!("the thread that builds panicked"),
            Ok(work) => self.work = Some(work?),
        }
        self.building = None;
        self.publish()?;
        let version = self.status.versions[GRAPH];
        self.metric(version, "time/graph_s", self.began.elapsed().as_secs_f64());
        Ok(())
    }

    fn receive(&mut self, phase: Phase) {
        // Evaluation is not learned from.
        let train = phase == Phase::Train;
        let deterministic = self.config.run.deterministic;
        let (work, rounds) = (&mut self.work, &mut self.rounds);
        self.receiver.receive(64, |header, trajectory| match work {
            Some(work) if train && !deterministic => work.learn(&rollout(header, trajectory)),
            _ if train && deterministic => rounds.add(header, trajectory),
            _ => {}
        });
        self.receiver.acknowledge();
    }

    /// Publishes the next version of the graph, and what it is worth.
    fn publish(&mut self) -> anyhow::Result<()> {
        let Some(work) = &mut self.work else {
            return Ok(());
        };
        let mut metrics = vec![];
        let graph = work.renew(self.limit, &mut metrics)?;
        // Kept before it is published: no successor gives a number to another graph.
        let stamp = Stamp {
            number: graph.version,
            round: self.rounds.taken(),
        };
        if let Err(error) = self.states.save(stamp, &Kept(work.save())) {
            log::warn!("no state was kept, the one before stays: {error}");
        }
        // Without its file the graph still is what everyone works with.
        if let Err(error) = graph.save(&self.folder.join("graph.bin")) {
            log::warn!("{error}");
        }
        for (name, value) in metrics {
            self.metric(graph.version, name, value);
        }
        let same = |before: &Arc<Graph>| {
            before.edges.len() == graph.edges.len() && before.structure() == graph.structure()
        };
        if !self.measured.as_ref().is_some_and(same) {
            self.measure(&graph);
            self.measured = Some(Arc::clone(&graph));
        }
        self.announce(&graph)
    }

    /// Publishes a version.
    fn announce(&mut self, graph: &Graph) -> anyhow::Result<()> {
        self.publisher.publish(graph.version, &graph.to_bytes())?;
        self.published = Instant::now();
        self.status.versions[GRAPH] = graph.version;
        self.status.round = self.rounds.taken();
        self.status.state = State::Trained as u32;
        Ok(())
    }

    fn metric(&self, version: u64, name: &str, value: f64) {
        let metric = Metric::new(Role::GraphBuilder, 0, name, version, value);
        self.reporter.metric(&metric);
    }

    /// What the graph is worth, as numbers.
    fn measure(&self, graph: &Graph) {
        let centres: Vec<[f32; 2]> = self
            .layout
            .free_cells()
            .into_iter()
            .map(|cell| self.layout.centre(cell))
            .collect();
        let wall = graph.edges_through_walls(|place| self.layout.is_wall_at(place));
        let coverage = graph.coverage(&centres, maze::CELL_SIZE / 2.0);
        for (name, value) in [
            ("graph/nodes", graph.len() as f64),
            ("graph/edges", graph.edges.len() as f64),
            ("graph/coverage", f64::from(coverage)),
            ("graph/edges_through_walls", wall as f64),
            ("graph/mean_edge_steps", f64::from(graph.mean_edge_steps)),
        ] {
            self.metric(graph.version, name, value);
        }
    }

    fn pulse(&mut self) {
        let s = &mut self.status;
        if let Some(work) = &self.work {
            s.set_text(&work.status());
        }
        self.receiver.report(s);
        let weights = self
            .weights
            .iter()
            .map(|(_, subscriber)| subscriber.refused());
        s.refused += weights.sum::<u64>() + self.directives.refused();
        self.reporter.status(s);
    }
}
