//! The offline run: stages 1, 3a and 3b, each on its thread, and the channels.

use std::cell::Cell;
use std::collections::VecDeque;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{self, Receiver, Sender, SyncSender, TrySendError};
use std::thread::Scope;
use std::time::{Duration, Instant};

use config::{Config, Controller, Planner};
use dataset::Dataset;
use graph::Graph;
use maze::Layout;
use serde::de::DeserializeOwned;
use wire::{
    Bus, Directive, DirectiveSubscriber, GraphSubscriber, Metric, Module, Phase, Reader, Reporter,
    Role, Rounds, State, Status, TrajectoryReceiver, WeightsPublisher,
};

use crate::high::{self, Word};
use crate::save::Keeper;
use crate::{choices, encoder, low, save};

/// What a training thread has to tell.
pub(crate) enum News {
    Metric {
        name: &'static str,
        step: u64,
        value: f32,
    },
    Progress {
        stage: &'static str,
        done: u64,
        total: u64,
    },
    Encoder(Vec<f32>),
    Low {
        weights: Vec<f32>,
        version: u64,
        last: bool,
    },
    /// Weights over the nodes of a version of the graph, and of every other one of its structure.
    High {
        weights: Vec<f32>,
        version: u64,
        graph: u64,
        structure: u64,
        /// Rounds learned from.
        rounds: u32,
        last: bool,
    },
    /// No more of the high level will come.
    Settled,
    Failed(anyhow::Error),
}

/// Weights that nobody would take: training them on does not mend it.
#[derive(Debug, thiserror::Error)]
#[error(
    "the {module}'s weights diverged (value {at} is not finite); lower its learning_rate, or look \
     for huge values in the data"
)]
pub struct Diverged {
    module: &'static str,
    at: usize,
}

/// A training thread's way to tell it.
pub(crate) struct Post<'s> {
    sender: Sender<News>,
    stop: &'s AtomicBool,
    folder: &'s Path,
    /// States of more rounds are not gone on from.
    rounds: u32,
    /// The stage came to its end, or said why not.
    told: Cell<bool>,
}

impl Drop for Post<'_> {
    fn drop(&mut self) {
        if !self.told.get() {
            let error = anyhow::anyhow!("a thread of the learner panicked");
            self.send(News::Failed(error));
        }
    }
}

impl Post<'_> {
    pub(crate) fn send(&self, news: News) {
        // Nobody hears it only when the process ends.
        let _ = self.sender.send(news);
    }

    pub(crate) fn metric(&self, name: &'static str, step: u64, value: f32) {
        self.send(News::Metric { name, step, value });
    }

    pub(crate) fn progress(&self, stage: &'static str, done: u64, total: u64) {
        self.send(News::Progress { stage, done, total });
    }

    /// The run's folder.
    pub(crate) fn folder(&self) -> &Path {
        self.folder
    }

    /// The keeper of a stage's states, and the newest one.
    pub(crate) fn keeper<T: DeserializeOwned>(
        &self,
        name: &'static str,
        config: &Config,
    ) -> (Keeper, Option<T>) {
        Keeper::open(self.folder, name, config, self.rounds)
    }

    pub(crate) fn stopped(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }
}

/// Runs a stage on its thread; its failure is news.
fn spawn<'s>(
    scope: &'s Scope<'s, '_>,
    post: Post<'s>,
    stage: impl FnOnce(&Post<'s>) -> anyhow::Result<()> + Send + 's,
) {
    scope.spawn(move || {
        let result = stage(&post);
        post.told.set(true);
        if let Err(error) = result {
            post.send(News::Failed(error));
        }
    });
}

/// Rollouts that wait for the high level; when there are more, actors wait.
const WAITING: usize = 256;

/// The high level's ear: what it has no time for waits here, and then the actors do.
struct Words {
    sender: SyncSender<Word>,
    backlog: VecDeque<Word>,
}

impl Words {
    fn new() -> (Self, Receiver<Word>) {
        let (sender, ears) = mpsc::sync_channel(WAITING);
        let backlog = VecDeque::new();
        (Self { sender, backlog }, ears)
    }

    fn say(&mut self, word: Word) {
        self.backlog.push_back(word);
        self.flush();
    }

    /// Whether all was heard.
    fn flush(&mut self) -> bool {
        while let Some(word) = self.backlog.pop_front() {
            if let Err(TrySendError::Full(word)) = self.sender.try_send(word) {
                self.backlog.push_front(word);
                return false;
            }
        }
        true
    }
}

/// How old the weights of the rollouts are, since the last report.
#[derive(Default)]
struct Lag {
    trajectories: u64,
    sum: u64,
    most: u64,
    /// Trajectories that were too old to learn from, in all.
    stale: u64,
}

struct Learner<'c> {
    config: &'c Config,
    folder: &'c Path,
    receiver: TrajectoryReceiver,
    publishers: [WeightsPublisher; 3],
    graphs: GraphSubscriber,
    directives: DirectiveSubscriber,
    reporter: Reporter,
    status: Status,
    encoder: Option<Vec<f32>>,
    /// Versions of encoder, low and high.
    versions: [u64; 3],
    trained: [bool; 2],
    newest: [Vec<f32>; 2],
    progress: [[u64; 2]; 3],
    /// The newest version of the graph.
    graph: Option<Graph>,
    /// Structures of the newest versions: a trajectory tells only its version.
    structures: VecDeque<(u64, u64)>,
    words: Option<Words>,
    lag: Lag,
    rounds: Rounds,
    settling: bool,
    settled: bool,
}

/// Versions whose structure is remembered.
const REMEMBERED: usize = 64;

pub(crate) fn run(
    config: &Config,
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
    let mut learner = Learner {
        config,
        folder,
        receiver: TrajectoryReceiver::new(bus, Reader::Learner, folder)?,
        publishers: [
            WeightsPublisher::new(bus, Module::Encoder)?,
            WeightsPublisher::new(bus, Module::Low)?,
            WeightsPublisher::new(bus, Module::High)?,
        ],
        graphs: GraphSubscriber::new(bus)?,
        directives: DirectiveSubscriber::new(bus)?,
        reporter,
        status,
        encoder: None,
        versions: [0; 3],
        trained: [false; 2],
        newest: [vec![], vec![]],
        progress: [[0; 2]; 3],
        graph: None,
        structures: VecDeque::new(),
        words: None,
        lag: Lag::default(),
        rounds: Rounds::default(),
        settling: false,
        settled: false,
    };
    let layout = Layout::of(&config.maze.layout, &config.maze.rows)?;
    let data = dataset::prepared::open(folder)?.data;
    learner.describe(&data, &layout);
    let halt = AtomicBool::new(false);
    let result = std::thread::scope(|scope| {
        let result = learner.work(scope, &data, &halt, stop);
        halt.store(true, Ordering::Relaxed);
        result
    });
    result?;
    learner.finish();
    Ok(())
}

impl<'c> Learner<'c> {
    fn work<'s>(
        &mut self,
        scope: &'s Scope<'s, '_>,
        data: &'s Dataset,
        halt: &'s AtomicBool,
        stop: &AtomicBool,
    ) -> anyhow::Result<()>
    where
        'c: 's,
    {
        let (sender, news): (Sender<News>, Receiver<News>) = mpsc::channel();
        let (config, folder) = (self.config, self.folder);
        // In rounds, the launcher knows which of them all have learned from.
        let mut rounds = u32::MAX;
        if config.run.deterministic {
            let receiver = &self.receiver;
            let wait = || {
                receiver.wait(Duration::from_millis(50));
                !stop.load(Ordering::Relaxed)
            };
            let Some(directive) = self.directives.first(wait) else {
                return Ok(());
            };
            rounds = directive.round;
            self.rounds = Rounds::after(rounds);
            self.status.round = rounds;
        }
        let post = || Post {
            sender: sender.clone(),
            stop: halt,
            folder,
            rounds,
            told: Cell::new(false),
        };
        spawn(scope, post(), move |post| {
            encoder::train(config, data, post)
        });
        let read = |bytes: &[u8]| Graph::from_bytes_of(bytes, config.encoder.latent);
        self.status.state = State::Working as u32;
        self.reporter.status(&self.status);
        let mut pulse = Instant::now();
        while !stop.load(Ordering::Relaxed) {
            let directive = self.directives.latest();
            self.receive(directive.phase());
            self.publishers
                .iter()
                .for_each(WeightsPublisher::keep_alive);
            while let Ok(told) = news.try_recv() {
                self.hear(told)?;
            }
            // Before the encoder is there a graph waits in its channel: it may come no second time.
            if self.encoder.is_some()
                && let Some(graph) = self.graphs.latest(read)
            {
                self.take_graph(graph, |words, graph, encoder| {
                    if config.low.controller == Controller::Learned {
                        let own = graph.clone();
                        spawn(scope, post(), move |post| {
                            low::train(config, data, own, &encoder, post)
                        });
                    }
                    if config.high.planner == Planner::Learned {
                        spawn(scope, post(), move |post| {
                            high::train(config, graph, &words, post)
                        });
                    }
                });
            }
            self.round(&directive);
            if directive.phase() == Phase::Settle {
                self.settle(&directive)?;
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

    /// What the data are, as numbers.
    fn describe(&self, data: &Dataset, layout: &Layout) {
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
    }

    /// Takes in what actors sent; in training it is material for the high level.
    fn receive(&mut self, phase: Phase) {
        let (rounds, structures, lag) = (&mut self.rounds, &self.structures, &mut self.lag);
        let deterministic = self.config.run.deterministic;
        let current = self.versions[2];
        let most_lag = self.config.topology.max_policy_lag as u64;
        let heard = self.words.as_mut().is_none_or(Words::flush);
        let words = &mut self.words;
        // While the high level has no time, what comes waits in the channel, and actors do in turn.
        self.receiver
            .receive(if heard { 16 } else { 0 }, |header, record| {
                if phase != Phase::Train {
                    return;
                }
                if deterministic {
                    rounds.add(header, record);
                    return;
                }
                let known = structures.iter().find(|(v, _)| *v == header.graph_version);
                if let (Some(words), Some((_, structure))) = (words.as_mut(), known) {
                    let age = current.saturating_sub(header.weights_version);
                    lag.trajectories += 1;
                    lag.sum += age;
                    lag.most = lag.most.max(age);
                    if age > most_lag {
                        lag.stale += 1;
                        return;
                    }
                    let (choices, last) = choices::of(record);
                    if !choices.is_empty() {
                        words.say(Word::Rollout(*structure, (choices, last)));
                    }
                }
            });
        self.receiver.acknowledge();
    }

    /// The first graph starts the stages that need one; later ones go to the high level.
    fn take_graph(&mut self, graph: Graph, start: impl FnOnce(Receiver<Word>, Graph, Vec<f32>)) {
        let Some(encoder) = &self.encoder else { return };
        self.structures
            .push_front((graph.version, graph.structure()));
        self.structures.truncate(REMEMBERED);
        match &mut self.words {
            None => {
                let (words, ears) = Words::new();
                self.words = Some(words);
                self.trained = [
                    self.config.low.controller == Controller::Walker,
                    self.config.high.planner == Planner::Search,
                ];
                start(ears, graph.clone(), encoder.clone());
            }
            // In rounds a graph goes with its rollouts.
            Some(words) if !self.config.run.deterministic && !self.settling => {
                words.say(Word::Graph(Box::new(graph.clone())));
            }
            Some(_) => {}
        }
        if self.config.high.planner == Planner::Search {
            self.status.versions[2] = graph.version;
        }
        self.graph = Some(graph);
    }

    /// Learns from a round once it is whole and the graph-builder has learned from it.
    fn round(&mut self, directive: &Directive) {
        let round = self.rounds.taken() + 1;
        let (Some(graph), Some(words)) = (&self.graph, &mut self.words) else {
            return;
        };
        if directive.round != round || graph.version <= u64::from(round) {
            return;
        }
        let Some(trajectories) = self.rounds.take(directive.episodes) else {
            return;
        };
        if self.config.high.planner == Planner::Search {
            self.status.round = round;
            return;
        }
        let rollouts = trajectories.iter().map(|t| choices::of(&t.steps));
        let rollouts = rollouts
            .filter(|(choices, _)| !choices.is_empty())
            .collect();
        words.say(Word::Round(rollouts, Box::new(graph.clone())));
    }

    /// Ends the high level's training on the final graph, once it is there.
    fn settle(&mut self, directive: &Directive) -> anyhow::Result<()> {
        let Some(graph) = self.graph.as_ref().filter(|graph| {
            directive.graph_version > 0 && graph.version >= directive.graph_version
        }) else {
            return Ok(());
        };
        if self.settling || self.settled {
            return Ok(());
        }
        self.settling = true;
        match &mut self.words {
            Some(words) if self.config.high.planner == Planner::Learned => {
                words.say(Word::Settle(Box::new(graph.clone())));
                Ok(())
            }
            _ => self.hear(News::Settled),
        }
    }

    fn hear(&mut self, news: News) -> anyhow::Result<()> {
        match news {
            News::Metric { name, step, value } => {
                let value = f64::from(value);
                self.reporter
                    .metric(&Metric::new(Role::Learner, 0, name, step, value));
            }
            News::Progress { stage, done, total } => {
                let at = match stage {
                    "encoder" => 0,
                    "low" => 1,
                    _ => 2,
                };
                self.progress[at] = [done, total];
                self.status.updates += 1;
            }
            News::Encoder(weights) => {
                self.publish(0, 1, 0, &weights)?;
                save::module(self.folder, "encoder", self.config, 1, &weights)?;
                self.encoder = Some(weights);
            }
            News::Low {
                weights,
                version,
                last,
            } => {
                self.trained[0] |= last;
                self.publish(1, version, 0, &weights)?;
                self.newest[0] = weights;
            }
            News::High {
                weights,
                version,
                graph,
                structure,
                rounds,
                last,
            } => {
                self.trained[1] |= last;
                self.publish(2, version, structure, &weights)?;
                self.status.versions[2] = graph;
                self.status.round = rounds;
                self.newest[1] = weights;
            }
            News::Settled => {
                self.settled = true;
                self.checkpoint()?;
            }
            News::Failed(error) => return Err(error),
        }
        Ok(())
    }

    fn publish(
        &mut self,
        module: usize,
        version: u64,
        structure: u64,
        weights: &[f32],
    ) -> anyhow::Result<()> {
        if let Some(at) = weights.iter().position(|value| !value.is_finite()) {
            let module = ["encoder", "low level", "high level"][module];
            return Err(Diverged { module, at }.into());
        }
        self.versions[module] = version;
        self.publishers[module].publish(version, structure, weights)?;
        Ok(())
    }

    fn checkpoint(&self) -> anyhow::Result<()> {
        for (name, weights, version) in [
            ("low", &self.newest[0], self.versions[1]),
            ("high", &self.newest[1], self.versions[2]),
        ] {
            if !weights.is_empty() {
                save::module(self.folder, name, self.config, version, weights)?;
            }
        }
        Ok(())
    }

    fn pulse(&mut self) {
        let share = |[done, total]: [u64; 2]| 100 * done / total.max(1);
        let [encoder, low, high] = self.progress.map(share);
        let text = if self.encoder.is_none() {
            format!("encoder {encoder}%")
        } else if self.graph.is_none() {
            "waits for the graph".to_owned()
        } else {
            format!("low {low}%, high {high}%")
        };
        // Of both levels the one that has more before it.
        let further = [self.progress[1], self.progress[2]]
            .into_iter()
            .filter(|[_, total]| *total > 0)
            .min_by_key(|progress| share(*progress));
        let s = &mut self.status;
        s.progress = match further {
            Some(progress) if self.encoder.is_some() => progress,
            _ => self.progress[0],
        };
        s.set_text(&text);
        let trained = self.trained == [true; 2];
        // A low level that goes on from a state may come after a high level that had settled.
        s.state = if self.settled && trained {
            State::Settled
        } else if trained {
            State::Trained
        } else {
            State::Working
        } as u32;
        // Between stages it waits for others.
        if self.encoder.is_some() && self.graph.is_none() {
            s.state = State::Waiting as u32;
        }
        self.receiver.report(s);
        s.refused += self.graphs.refused() + self.directives.refused();
        s.versions[..2].copy_from_slice(&self.versions[1..]);
        self.reporter.status(s);
        let lag = std::mem::take(&mut self.lag);
        self.lag.stale = lag.stale;
        if lag.trajectories > 0 {
            let mean = lag.sum as f64 / lag.trajectories as f64;
            for (name, value) in [
                ("rollout/policy_lag", mean),
                ("rollout/policy_lag_max", lag.most as f64),
                ("rollout/stale_trajectories", lag.stale as f64),
            ] {
                let metric = Metric::new(Role::Learner, 0, name, self.versions[2], value);
                self.reporter.metric(&metric);
            }
        }
    }

    fn finish(&mut self) {
        self.pulse();
        self.status.state = State::Finished as u32;
        self.reporter.status(&self.status);
    }
}
