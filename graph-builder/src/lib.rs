//! The graph-builder: data set and encoder in, latent graph out; then what rollouts tell of its
//! edges.

mod build;

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use config::Config;
use dataset::Dataset;
use graph::Graph;
use maze::Layout;
use wire::{
    Bus, DirectiveSubscriber, GraphPublisher, Metric, Module, Phase, Reader, Reporter, Role,
    RunDomain, State, Status, TrajectoryReceiver, Transition, WeightsSubscriber, flags,
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
    let config = Config::load(&args.folder.join("config.toml"), &[])?;
    let domain = RunDomain::open(&args.domain)?;
    let bus = Bus::join(&domain, "graph-builder")?;
    let reporter = Reporter::new(&bus)?;
    let mut status = Status {
        role: Role::GraphBuilder as u32,
        ..Status::default()
    };
    status.set_text("loading the data set");
    reporter.status(&status);
    let receiver = TrajectoryReceiver::new(&bus, Reader::GraphBuilder)?;
    let data = Dataset::open(Path::new(&config.dataset))?;
    let layout = Layout::of(&config.maze.layout, &config.maze.rows)?;
    Builder {
        encoder: WeightsSubscriber::new(&bus, Module::Encoder)?,
        publisher: GraphPublisher::new(&bus)?,
        directives: DirectiveSubscriber::new(&bus)?,
        receiver,
        reporter,
        status,
        graph: None,
        published: Instant::now(),
        config: &config,
        folder: &args.folder,
        layout: &layout,
        tried: 0,
        reached: 0,
        told: 0,
    }
    .work(&data, stop)
}

struct Builder<'a> {
    config: &'a Config,
    folder: &'a Path,
    layout: &'a Layout,
    encoder: WeightsSubscriber,
    publisher: GraphPublisher,
    directives: DirectiveSubscriber,
    receiver: TrajectoryReceiver,
    reporter: Reporter,
    status: Status,
    graph: Option<Graph>,
    published: Instant,
    tried: u64,
    reached: u64,
    /// Tries that the published version knows of.
    told: u64,
}

/// Books the edges that a trajectory settled; returns how many were tried and reached.
fn book(graph: &mut Graph, record: &[Transition]) -> (u64, u64) {
    let (mut tried, mut reached) = (0, 0);
    let mut open: Option<(u32, u32)> = None;
    for step in record {
        if step.has(flags::REACHED | flags::FAILED)
            && let Some((from, to)) = open.take()
            && graph.record(from, to, step.has(flags::REACHED))
        {
            tried += 1;
            reached += u64::from(step.has(flags::REACHED));
        }
        if step.has(flags::CHOICE)
            && let (Ok(from), Ok(to)) = (u32::try_from(step.node), u32::try_from(step.subgoal))
        {
            open = Some((from, to));
        }
    }
    (tried, reached)
}

impl Builder<'_> {
    fn work(mut self, data: &Dataset, stop: &AtomicBool) -> anyhow::Result<()> {
        self.status.state = State::Waiting as u32;
        self.status.set_text("waits for the encoder");
        let refresh = Duration::from_secs_f64(self.config.graph.refresh_seconds);
        let mut pulse = Instant::now();
        while !stop.load(Ordering::Relaxed) {
            let phase = self.directives.latest().phase();
            self.receive();
            if let Some(weights) = self.encoder.latest()
                && self.graph.is_none()
            {
                self.status.state = State::Working as u32;
                self.status.set_text("building the graph");
                self.reporter.status(&self.status);
                let graph = build::graph(self.config, data, &weights.values)?;
                self.measure(&graph);
                self.publish(graph)?;
            }
            let due = self.tried > self.told && self.published.elapsed() >= refresh;
            if due
                && phase == Phase::Train
                && let Some(mut graph) = self.graph.take()
            {
                graph.version += 1;
                self.publish(graph)?;
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
        if let Some(graph) = &self.graph {
            graph.save(&self.folder.join("graph.bin"))?;
        }
        self.pulse();
        self.status.state = State::Finished as u32;
        self.reporter.status(&self.status);
        Ok(())
    }

    fn receive(&mut self) {
        let (mut tried, mut reached) = (0, 0);
        let graph = &mut self.graph;
        self.receiver.receive(64, |_, record| {
            if let Some(graph) = graph {
                let booked = book(graph, record);
                tried += booked.0;
                reached += booked.1;
            }
        });
        self.receiver.acknowledge();
        self.tried += tried;
        self.reached += reached;
    }

    fn publish(&mut self, graph: Graph) -> anyhow::Result<()> {
        self.publisher.publish(graph.version, &graph.to_bytes())?;
        graph.save(&self.folder.join("graph.bin"))?;
        self.published = Instant::now();
        self.told = self.tried;
        self.status.versions[2] = graph.version;
        self.status.state = State::Trained as u32;
        self.metric("graph/edges_tried", self.tried as f64);
        self.metric(
            "graph/edge_success",
            self.reached as f64 / self.tried.max(1) as f64,
        );
        self.graph = Some(graph);
        Ok(())
    }

    fn metric(&self, name: &str, value: f64) {
        let step = self.status.versions[2];
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
        self.metric("graph/mean_edge_steps", f64::from(graph.mean_edge_steps()));
    }

    fn pulse(&mut self) {
        let s = &mut self.status;
        if let Some(graph) = &self.graph {
            let share = 100.0 * self.reached as f64 / self.tried.max(1) as f64;
            s.set_text(&format!(
                "{} nodes, {} edges, {share:.0}% of {} tries reached",
                graph.len(),
                graph.edges.len(),
                self.tried
            ));
        }
        self.receiver.report(s);
        self.reporter.status(s);
    }
}
