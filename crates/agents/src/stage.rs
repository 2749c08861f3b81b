//! A stage of an algorithm: one training thread of the learner.

use std::path::Path;
use std::sync::Arc;

use dataset::Dataset;
use graph::Graph;

use crate::parts::Parts;
use crate::rollout::Rollout;

/// What a stage is, and what it needs to begin.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct StageSpec {
    /// Its name, which is its checkpoint's.
    pub name: &'static str,
    /// The metric of its time (s).
    pub time: &'static str,
    /// Networks, by number, whose weights must be there.
    pub after: Vec<usize>,
    /// Whether a graph must be there.
    pub needs_graph: bool,
    /// Whether it goes on learning from rollouts and from newer graphs until the run settles; others
    /// end with their planned updates.
    pub online: bool,
}

/// What a stage begins with.
#[derive(Clone, Copy)]
pub struct Inputs<'a> {
    /// The data set; empty where the algorithm [needs](crate::Plan::needs) none.
    pub data: &'a Arc<Dataset>,
    /// The run's folder, where a graph rule leaves what it computed of all rows.
    pub folder: &'a Path,
    /// Weights and graph, as the stage's [`StageSpec`] asks for them.
    pub parts: &'a Parts,
    /// Whether rollouts come in rounds: then a newer graph goes with its rollouts, and is not
    /// adopted before.
    pub in_rounds: bool,
}

/// Why a stage cannot begin.
#[derive(Debug, thiserror::Error)]
pub enum StageError {
    /// Weights of another run's checkpoint.
    #[error("{path}: {reason}")]
    Checkpoint {
        /// The file.
        path: String,
        /// What is wrong with it.
        reason: nets::file::FileError,
    },
    /// Weights of a walker to start from.
    #[error(transparent)]
    Walker(#[from] crate::walker::WalkerError),
    /// Weights that do not fit the config's shapes.
    #[error("the weights of the {0} do not fit its shape; do not change its layers on resume")]
    Shape(&'static str),
    /// A data set without a row to learn from.
    #[error("no episode of the data set is longer than {key} = {steps} steps; lower {key}")]
    TooShort {
        /// The key that asks for so many steps.
        key: &'static str,
        /// The steps.
        steps: usize,
    },
    /// A graph without a choice.
    #[error(
        "the graph's largest connected part has {0} nodes; give more data or lower graph.nodes"
    )]
    TooSmall(usize),
}

/// Done and to do.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Progress {
    /// Done.
    pub done: u64,
    /// In all.
    pub total: u64,
}

/// Values of metrics: name, step, value.
#[derive(Debug, Default)]
pub struct Metrics(pub Vec<(&'static str, u64, f32)>);

impl Metrics {
    /// Adds a value at a step.
    pub fn add(&mut self, name: &'static str, step: u64, value: f32) {
        self.0.push((name, step, value));
    }
}

/// Weights to publish.
#[derive(Debug, Clone, PartialEq)]
pub struct Publication {
    /// The network, by number.
    pub network: usize,
    /// Version of the weights.
    pub version: u64,
    /// The weights.
    pub weights: Vec<f32>,
    /// Version and [structure](Graph::structure) of the graph that they are over.
    pub graph: Option<(u64, u64)>,
}

/// A stage in training. All of it is done on one thread.
pub trait Stage: Send {
    /// One update. Returns whether the weights are to be published now.
    fn update(&mut self, metrics: &mut Metrics) -> bool;

    /// Updates done: the number of a checkpoint.
    fn updates(&self) -> u64;

    /// How far the planned work is, in the unit that its metrics count.
    fn progress(&self) -> Progress;

    /// Whether the planned updates are done.
    fn is_done(&self) -> bool;

    /// Whether there is nothing to do until a rollout or a graph comes.
    fn is_idle(&self) -> bool {
        self.is_done()
    }

    /// Weights as they are.
    fn publications(&self) -> Vec<Publication>;

    /// Keeps what a rollout holds for the next update.
    fn learn(&mut self, _rollout: &Rollout<'_>) {}

    /// Goes on with a newer version of the graph.
    fn adopt(&mut self, _graph: &Arc<Graph>) {}

    /// Learns from a round of a deterministic run whose rollouts were [learned](Self::learn), and
    /// goes on with the graph after it.
    fn end_round(&mut self, _graph: Option<&Arc<Graph>>, _metrics: &mut Metrics) {}

    /// Rounds learned from.
    fn rounds(&self) -> u32 {
        0
    }

    /// Ends the training on the final graph.
    fn settle(&mut self, _graph: Option<&Arc<Graph>>, _metrics: &mut Metrics) {}

    /// Metrics of the whole stage, once its planned updates are done.
    fn measure(&mut self, _metrics: &mut Metrics) {}

    /// Everything that the training goes on from, see [`Plan::start`](crate::Plan::start).
    fn save(&self) -> Vec<u8>;
}
