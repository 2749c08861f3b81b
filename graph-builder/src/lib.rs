//! The graph-builder: data set and encoder in, latent graph out; then what rollouts tell of its
//! edges.

mod build;
mod tries;

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{self, Receiver, TryRecvError};
use std::time::{Duration, Instant};

use agents::vae::Encoder;
use anyhow::Context;
use config::Config;
use dataset::Dataset;
use durable::{Stamp, States};
use graph::{Graph, Pool};
use maze::Layout;
use serde::{Deserialize, Serialize};
use wire::{
    Bus, DirectiveSubscriber, GraphPublisher, Metric, Module, Phase, Reader, Reporter, Role,
    Rounds, RunDomain, State, Status, Trajectory, TrajectoryHeader, TrajectoryReceiver, Transition,
    WeightsSubscriber,
};

use tries::{Tally, Tries};

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
    let config = Config::of_run(&args.folder)?;
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
    let layout = Layout::of(&config.maze.layout, &config.maze.rows)?;
    let loaded = dataset::prepared::open(&args.folder)?;
    for note in &loaded.notes {
        log::info!("{note}");
    }
    let data = loaded.data;
    Builder {
        weights: WeightsSubscriber::new(&bus, Module::Encoder)?,
        publisher: GraphPublisher::new(&bus)?,
        directives: DirectiveSubscriber::new(&bus)?,
        limit: bus.limits().graph_bytes,
        receiver,
        reporter,
        status,
        states: States::new(&args.folder.join("checkpoints"), "graph"),
        building: None,
        built: None,
        tries: Tries::default(),
        rounds: Rounds::default(),
        published: Instant::now(),
        began: Instant::now(),
        config: &config,
        folder: &args.folder,
        layout: &layout,
    }
    .work(&Arc::new(data), stop)
}

/// What a successor goes on from.
#[derive(Serialize, Deserialize)]
struct Kept {
    pool: Pool,
    /// The version that was published with it.
    graph: Vec<u8>,
    total: Tally,
}

/// What the encoder's weights made.
struct Built {
    encoder: Encoder,
    pool: Pool,
}

impl Built {
    /// Learns from a trajectory: of its edges, and of new places where the graph is online.
    fn take(
        &mut self,
        tries: &mut Tries,
        online: bool,
        header: &TrajectoryHeader,
        record: &[Transition],
    ) {
        tries.book(&mut self.pool, header, record);
        if online {
            tries.explore(&mut self.pool, &mut self.encoder, header, record);
        }
    }
}

struct Builder<'a> {
    config: &'a Config,
    folder: &'a Path,
    layout: &'a Layout,
    weights: WeightsSubscriber,
    publisher: GraphPublisher,
    directives: DirectiveSubscriber,
    /// What the graph's channel takes (bytes).
    limit: usize,
    receiver: TrajectoryReceiver,
    reporter: Reporter,
    status: Status,
    states: States,
    /// A thread that builds.
    building: Option<Receiver<anyhow::Result<Built>>>,
    built: Option<Built>,
    tries: Tries,
    rounds: Rounds,
    published: Instant,
    began: Instant,
}

impl Builder<'_> {
    fn work(mut self, data: &Arc<Dataset>, stop: &AtomicBool) -> anyhow::Result<()> {
        self.status.state = State::Waiting as u32;
        self.status.set_text("waits for the encoder");
        self.reporter.status(&self.status);
        let Some(mut kept) = self.kept(stop) else {
            return Ok(());
        };
        let refresh = Duration::from_secs_f64(self.config.graph.refresh_seconds);
        let mut pulse = Instant::now();
        while !stop.load(Ordering::Relaxed) {
            let directive = self.directives.latest();
            let phase = directive.phase();
            self.receive(phase);
            if let Some(weights) = self.weights.latest()
                && self.built.is_none()
                && self.building.is_none()
            {
                match kept.take() {
                    Some(kept) => self.restore(kept, &weights.values)?,
                    None => self.build(data, weights.values),
                }
            }
            self.adopt()?;
            let due = self.tries.recent.tried > 0 && self.published.elapsed() >= refresh;
            if due && phase == Phase::Train && !self.config.run.deterministic {
                self.publish()?;
            }
            if directive.round == self.rounds.taken() + 1
                && let Some(trajectories) = self.rounds.take(directive.episodes)
            {
                let online = self.config.graph.online;
                if let Some(built) = &mut self.built {
                    for Trajectory { header, steps } in &trajectories {
                        built.take(&mut self.tries, online, header, steps);
                    }
                }
                self.publish()?;
            }
            if phase == Phase::Settle && self.built.is_some() {
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
            self.rounds = Rounds::after(rounds);
            self.status.round = rounds;
        }
        let newest = self.states.newest::<Kept>(rounds);
        for damaged in &newest.damaged {
            log::warn!("{damaged}; going on from the one before");
        }
        let sound = newest.state.filter(|(_, kept)| kept.pool.is_sound());
        Some(sound.map(|(stamp, kept)| {
            log::info!("going on from version {}", stamp.number);
            self.states.forget_after(stamp.number);
            kept
        }))
    }

    /// Goes on from what the one before left.
    fn restore(&mut self, kept: Kept, weights: &[f32]) -> anyhow::Result<()> {
        let encoder = build::encoder(self.config, weights)?;
        let graph = Graph::from_bytes(&kept.graph).context("the graph that was kept")?;
        self.built = Some(Built {
            encoder,
            pool: kept.pool,
        });
        self.tries.total = kept.total;
        self.announce(graph)
    }

    /// Begins to build, on a thread: actors are answered meanwhile.
    fn build(&mut self, data: &Arc<Dataset>, weights: Vec<f32>) {
        self.status.state = State::Working as u32;
        self.status.set_text("building the graph");
        let (sender, receiver) = mpsc::channel();
        self.building = Some(receiver);
        let (config, data) = (self.config.clone(), Arc::clone(data));
        let folder = self.folder.to_path_buf();
        // It ends with the process, should that end first.
        std::thread::spawn(move || {
            let build = || {
                let mut encoder = build::encoder(&config, &weights)?;
                let pool = build::pool(&config, &data, &mut encoder, &weights, &folder)?;
                Ok(Built { encoder, pool })
            };
            let _ = sender.send(build());
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
            Ok(built) => self.built = Some(built?),
        }
        self.building = None;
        self.publish()?;
        self.metric("time/graph_s", self.began.elapsed().as_secs_f64());
        Ok(())
    }

    fn receive(&mut self, phase: Phase) {
        // Evaluation is not learned from.
        let train = phase == Phase::Train;
        let deterministic = self.config.run.deterministic;
        let (built, tries, rounds) = (&mut self.built, &mut self.tries, &mut self.rounds);
        let online = self.config.graph.online;
        self.receiver.receive(64, |header, record| match built {
            Some(built) if train && !deterministic => built.take(tries, online, header, record),
            _ if train && deterministic => rounds.add(header, record),
            _ => {}
        });
        self.receiver.acknowledge();
    }

    /// Publishes the next version of the graph, and what it is worth.
    fn publish(&mut self) -> anyhow::Result<()> {
        let Some(built) = &mut self.built else {
            return Ok(());
        };
        let (mut graph, share, added) = built.pool.renew();
        if let Err(unusable) = graph.judge(built.pool.len(), self.limit) {
            // Rollouts can drop too many edges: the version before them stays, under this number.
            let Some(before) = self.tries.newest() else {
                return Err(unusable.into());
            };
            log::warn!("{unusable}; the version before stays");
            let version = graph.version;
            graph = Graph {
                version,
                ..before.clone()
            };
        }
        let bytes = graph.to_bytes();
        let tally = self.tries.recent;
        // Kept before it is published: no successor gives a number to another graph.
        let kept = Kept {
            pool: built.pool.clone(),
            graph: bytes,
            total: self.tries.total,
        };
        let stamp = Stamp {
            number: graph.version,
            round: self.rounds.taken(),
        };
        if let Err(error) = self.states.save(stamp, &kept) {
            log::warn!("no state was kept, the one before stays: {error}");
        }
        // Without its file the graph still is what everyone works with.
        if let Err(error) = graph.save(&self.folder.join("graph.bin")) {
            log::warn!("{error}");
        }
        if tally.tried > 0 {
            let reached = tally.reached.max(1) as f64;
            self.metric("graph/edges_tried", self.tries.total.tried as f64);
            self.metric(
                "graph/edge_success",
                tally.reached as f64 / tally.tried as f64,
            );
            self.metric("low/steps_over_best", tally.over_best / reached);
        }
        let same = |newest: &Graph| {
            newest.edges.len() == graph.edges.len() && newest.structure() == graph.structure()
        };
        if !self.tries.newest().is_some_and(same) {
            self.metric("graph/connected_share", f64::from(share));
            self.metric("graph/nodes_added", added as f64);
            self.measure(&graph);
        }
        self.announce(graph)
    }

    /// Publishes a version.
    fn announce(&mut self, graph: Graph) -> anyhow::Result<()> {
        self.publisher.publish(graph.version, &graph.to_bytes())?;
        self.published = Instant::now();
        self.status.versions[2] = graph.version;
        self.status.round = self.rounds.taken();
        self.status.state = State::Trained as u32;
        self.tries.publish(graph);
        Ok(())
    }

    fn metric(&self, name: &str, value: f64) {
        let step = self.tries.newest().map_or(0, |graph| graph.version);
        self.reporter
            .metric(&Metric::new(Role::GraphBuilder, 0, name, step, value));
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
        self.metric("graph/nodes", graph.len() as f64);
        self.metric("graph/edges", graph.edges.len() as f64);
        self.metric(
            "graph/coverage",
            f64::from(graph.coverage(&centres, maze::CELL_SIZE / 2.0)),
        );
        self.metric("graph/edges_through_walls", wall as f64);
        self.metric("graph/mean_edge_steps", f64::from(graph.mean_edge_steps));
    }

    fn pulse(&mut self) {
        let s = &mut self.status;
        if let Some(graph) = self.tries.newest() {
            let Tally { tried, reached, .. } = self.tries.total;
            let share = 100.0 * reached as f64 / tried.max(1) as f64;
            let tries = match tried {
                0 => String::new(),
                _ => format!(", {share:.0}% of {tried} tries reached"),
            };
            let (nodes, edges) = (graph.len(), graph.edges.len());
            s.set_text(&format!("{nodes} nodes, {edges} edges{tries}"));
        }
        self.receiver.report(s);
        s.refused += self.weights.refused() + self.directives.refused();
        self.reporter.status(s);
    }
}
