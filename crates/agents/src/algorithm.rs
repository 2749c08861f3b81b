//! What an algorithm is to the processes that run it.
//!
//! The learner trains its [stages](Stage), the graph-builder works by its [`GraphRule`], actors act by
//! its [`Policy`]. None of them knows which algorithm it is.

use std::sync::Arc;

use config::{Config, Document, Settings};
use dataset::Needs;
use maze::Layout;
use nets::file::Tensor;
use simulator::{Body, Simulator};

use crate::graph_rule::GraphRule;
use crate::parts::{Parts, Versions};
use crate::policy::Policy;
use crate::stage::{Inputs, Stage, StageError, StageSpec};
use crate::summary::{Label, Lookup, Summary};

/// Rows of a trajectory: 128 steps and the final row.
const TRAJECTORY_ROWS: usize = 129;

/// One algorithm: its settings, and the plan that they make.
pub trait Algorithm: Sync {
    /// Its name, as in `algorithm = "lg-h-ppo"`.
    fn name(&self) -> &'static str;

    /// Whether it learns from a data set and is scored in an evaluation. Others learn from rollouts
    /// alone.
    fn is_offline(&self) -> bool {
        true
    }

    /// Reads its tables of the run file.
    fn settings(&self, document: &mut Document<'_>) -> Settings;

    /// What a run of a config trains, and how. `None` for settings of another algorithm.
    fn plan(&self, config: &Config, body: &'static dyn Body) -> Option<Box<dyn Plan>>;

    /// How its metrics are called in charts and in the live view, the most telling first.
    fn labels(&self) -> &'static [Label];

    /// What each stage of a run came to. `setting` gives values of its config by `table.key`, as
    /// TOML; `metric` the newest values by name.
    fn summary(&self, setting: Lookup<'_, String>, metric: Lookup<'_, f64>) -> Vec<Summary>;
}

/// A network, whose weights the learner publishes.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Network {
    /// Its name: lower-case letters, digits and hyphens.
    pub name: &'static str,
    /// What messages call it, as `low level`.
    pub title: &'static str,
    /// Number of its weights.
    pub weights: usize,
    /// Whether it is over the nodes of a graph: then its weights name the
    /// [structure](graph::Graph::structure) that they are of.
    pub over_graph: bool,
    /// Whether it may have fewer weights, as over a graph that grows.
    pub grows: bool,
}

/// How a network's weights are saved.
#[derive(Debug, Clone, PartialEq)]
pub struct Checkpoint<'w> {
    /// Tensors by name.
    pub tensors: Vec<Tensor<'w>>,
    /// What else is to be known.
    pub metadata: Vec<(String, String)>,
    /// Where it is written besides the run's folder, at the end of the training.
    pub copy: Option<String>,
}

/// What an actor steps.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Environments {
    /// Environments of an actor, stepped in turns.
    pub number: usize,
    /// Rows of a trajectory, its final row included.
    pub trajectory_rows: usize,
    /// Control steps of an episode at most; those of the evaluation without.
    pub episode_steps: Option<usize>,
    /// Whether newer weights act from the next trajectory on; else from the next episode on.
    pub renewed: bool,
}

/// What a run trains, and how.
pub trait Plan: Send + Sync {
    /// Its networks, fewer than [`PARTS`](crate::PARTS).
    fn networks(&self) -> Vec<Network>;

    /// What it needs of a data set; `None` where it is not [offline](Algorithm::is_offline).
    fn needs(&self) -> Option<Needs>;

    /// Its stages, each a thread of the learner.
    fn stages(&self) -> Vec<StageSpec>;

    /// Begins a stage, by its number. `saved` is what [`Stage::save`] gave before.
    ///
    /// # Errors
    /// Inputs that there is nothing to learn from, files that cannot be read.
    fn start(
        &self,
        stage: usize,
        inputs: &Inputs<'_>,
        saved: Option<&[u8]>,
    ) -> Result<Box<dyn Stage>, StageError>;

    /// How its graph is made; `None` where it has none, and no graph-builder is started.
    fn graph(&self) -> Option<Arc<dyn GraphRule>>;

    /// A policy of the newest parts that fit each other, or of exactly those of `wanted`, and their
    /// versions. `None` until all are there.
    fn policy(
        &self,
        parts: &Parts,
        wanted: Option<&Versions>,
    ) -> Option<(Box<dyn Policy>, Versions)>;

    /// The network whose age in versions a rollout's policy lag is; `None` where nothing learns from
    /// rollouts.
    fn on_policy(&self) -> Option<usize>;

    /// Words that the choices of a trajectory take at most, 0 for none.
    fn choice_words(&self) -> usize;

    /// What an actor steps.
    fn environments(&self) -> Environments {
        Environments {
            number: 1,
            trajectory_rows: TRAJECTORY_ROWS,
            episode_steps: None,
            renewed: false,
        }
    }

    /// A simulator of its own for an actor's environment, in the place of the run's.
    fn simulator(&self, _layout: &Layout, _number: usize) -> Option<Box<dyn Simulator>> {
        None
    }

    /// How the weights of a network, by number, are saved.
    fn checkpoint<'w>(&self, _network: usize, weights: &'w [f32]) -> Checkpoint<'w> {
        Checkpoint {
            tensors: vec![("weights".to_owned(), vec![weights.len()], weights)],
            metadata: vec![],
            copy: None,
        }
    }
}
