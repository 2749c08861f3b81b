//! Stage 3b in training: the high level, on the graph and from rollouts.

use std::sync::Arc;

use graph::Graph;
use rand_pcg::Pcg64Mcg;
use serde::{Deserialize, Serialize};

use super::choice::Choice;
use super::high::{self, Edges, High, Settings};
use crate::rollout::Rollout;
use crate::stage::{Inputs, Metrics, Progress, Publication, Stage, StageError};
use crate::stream;

/// Updates between two publications.
const PUBLISH: u64 = 10;
/// Pairs of nodes that the quality is measured over.
const PAIRS: usize = 400;
/// Updates with each new version of the graph, once the planned steps are done.
const REFRESH: usize = 4;
/// And where the version has other nodes: new ones have everything to learn.
const RELEARN: usize = 60;
/// Least share of the step size, and that on new nodes.
const LEAST_RATE: f32 = 0.1;
const RELEARN_RATE: f32 = 0.5;

/// How far the stage is.
#[derive(Debug, Clone, Copy, Default, Serialize, Deserialize)]
struct Counts {
    updates: u64,
    /// Updates that are left since the nodes changed.
    relearn: usize,
    /// Updates that are left once the planned ones are done.
    extra: usize,
    /// The planned updates are done.
    done: bool,
    rounds: u32,
    /// Choices of rollouts that were more than an update takes.
    surplus: u64,
}

/// What the training goes on from.
#[derive(Serialize, Deserialize)]
struct Saved {
    counts: Counts,
    rng: Pcg64Mcg,
    high: high::State,
    graph: Vec<u8>,
}

/// What the stage is made of.
#[derive(Clone)]
pub(super) struct Setup {
    pub(super) settings: Settings,
    pub(super) edges: Edges,
    pub(super) seed: u64,
    /// Number of the own network.
    pub(super) network: usize,
}

struct HighStage {
    setup: Setup,
    graph: Arc<Graph>,
    high: High,
    rng: Pcg64Mcg,
    /// Choices of rollouts that an update takes, at most.
    most: usize,
    counts: Counts,
}

/// Begins the stage.
pub(super) fn start(
    setup: Setup,
    inputs: &Inputs<'_>,
    saved: Option<&[u8]>,
) -> Result<Box<dyn Stage>, StageError> {
    let graph = inputs.parts.graph().ok_or(StageError::TooSmall(0))?;
    if graph.len() < 2 {
        return Err(StageError::TooSmall(graph.len()));
    }
    let h = &setup.settings;
    let batch = (h.environments * h.horizon) as f64;
    let most = (batch * h.physics_share / (1.0 - h.physics_share).max(0.01)) as usize;
    let fresh = |graph: &Graph, rng: &mut Pcg64Mcg| {
        High::new(graph, setup.settings.clone(), setup.edges, rng)
    };
    let mut rng = stream(setup.seed, "high", 0);
    let restored = saved.and_then(|saved| {
        let saved: Saved = postcard::from_bytes(saved).ok()?;
        let before = Graph::from_bytes(&saved.graph).ok()?;
        let mut high = fresh(&before, &mut stream(setup.seed, "high", 0));
        high.restore(saved.high)
            .then_some((high, Arc::new(before), saved.rng, saved.counts))
    });
    let Some((high, before, rng, counts)) = restored else {
        return Ok(Box::new(HighStage {
            high: fresh(graph, &mut rng),
            graph: Arc::clone(graph),
            setup,
            rng,
            most,
            counts: Counts::default(),
        }));
    };
    let mut stage = HighStage {
        setup,
        graph: before,
        high,
        rng,
        most,
        counts,
    };
    if !inputs.in_rounds {
        stage.adopt(graph);
    }
    Ok(Box::new(stage))
}

impl HighStage {
    /// Takes a newer graph. Returns the updates that it asks for.
    fn take(&mut self, newer: &Arc<Graph>) -> usize {
        if newer.len() < 2 || newer.version <= self.graph.version {
            return 0;
        }
        let changed = self.graph.structure() != newer.structure();
        self.high.adopt(&self.graph, newer, &mut self.rng);
        self.graph = Arc::clone(newer);
        if changed {
            self.counts.relearn = RELEARN;
            return RELEARN;
        }
        REFRESH
    }

    fn ppo_update(&mut self, metrics: &mut Metrics) {
        let left = 1.0 - self.high.steps as f32 / self.setup.settings.steps as f32;
        let least = if self.counts.relearn > 0 {
            RELEARN_RATE
        } else {
            LEAST_RATE
        };
        self.counts.relearn = self.counts.relearn.saturating_sub(1);
        // Without the bonus in the end, near ties are settled and the most likely choices lead on.
        self.high.anneal(left.max(least), left.max(0.0));
        let physical = self.high.pending();
        let report = self.high.update(&self.graph, &mut self.rng);
        self.counts.updates += 1;
        if !self.counts.updates.is_multiple_of(PUBLISH) {
            return;
        }
        let step = self.high.steps;
        metrics.add("high/entropy_nats", step, report.entropy);
        metrics.add("high/kl", step, report.kl);
        metrics.add("high/clip_fraction", step, report.clip_fraction);
        metrics.add("high/value_loss", step, report.value_loss);
        metrics.add("high/physical_choices", step, physical as f32);
        metrics.add("high/surplus_choices", step, self.counts.surplus as f32);
        if let Some((arrived, reward)) = self.high.take_walks() {
            metrics.add("high/walks_arrived", step, arrived);
            metrics.add("high/return", step, reward);
        }
    }
}

impl Stage for HighStage {
    fn update(&mut self, metrics: &mut Metrics) -> bool {
        self.counts.extra = self.counts.extra.saturating_sub(1);
        self.ppo_update(metrics);
        let finished = !self.counts.done && self.high.steps >= self.setup.settings.steps as u64;
        self.counts.done |= finished;
        self.counts.updates.is_multiple_of(PUBLISH) || finished || self.is_idle()
    }

    fn updates(&self) -> u64 {
        self.counts.updates
    }

    fn progress(&self) -> Progress {
        let total = self.setup.settings.steps as u64;
        Progress {
            done: self.high.steps.min(total),
            total,
        }
    }

    fn is_done(&self) -> bool {
        self.counts.done
    }

    fn is_idle(&self) -> bool {
        self.counts.done && self.counts.extra == 0
    }

    fn publications(&self) -> Vec<Publication> {
        vec![Publication {
            network: self.setup.network,
            version: self.counts.updates,
            weights: self.high.weights(),
            graph: Some((self.graph.version, self.graph.structure())),
        }]
    }

    fn learn(&mut self, rollout: &Rollout<'_>) {
        if rollout.is_test() || rollout.structure != self.graph.structure() {
            return;
        }
        let choices: Vec<Choice> = Choice::of(rollout).collect();
        if self.high.pending() < self.most {
            self.high.add_rollout(&self.graph, &choices);
        } else {
            self.counts.surplus += choices.len() as u64;
        }
    }

    fn adopt(&mut self, graph: &Arc<Graph>) {
        let updates = self.take(graph);
        if self.counts.done {
            self.counts.extra = self.counts.extra.max(updates);
        }
    }

    fn end_round(&mut self, graph: Option<&Arc<Graph>>, metrics: &mut Metrics) {
        self.ppo_update(metrics);
        let updates = graph.map_or(0, |graph| self.take(graph));
        (0..updates).for_each(|_| self.ppo_update(metrics));
        self.measure(metrics);
        self.counts.rounds += 1;
    }

    fn rounds(&self) -> u32 {
        self.counts.rounds
    }

    fn settle(&mut self, graph: Option<&Arc<Graph>>, metrics: &mut Metrics) {
        let updates = graph.map_or(0, |graph| self.take(graph));
        let updates = updates.max(self.counts.extra);
        (0..updates).for_each(|_| self.ppo_update(metrics));
        self.counts.extra = 0;
        self.measure(metrics);
    }

    /// How far the most likely choices lead, and how straight.
    fn measure(&mut self, metrics: &mut Metrics) {
        let (arrived, ratio) = self.high.quality(&self.graph, PAIRS, &mut self.rng);
        let step = self.high.steps;
        metrics.add("high/greedy_arrived", step, arrived);
        metrics.add("high/path_over_cheapest", step, ratio);
    }

    fn save(&self) -> Vec<u8> {
        let saved = Saved {
            counts: self.counts,
            rng: self.rng.clone(),
            high: self.high.state(),
            graph: self.graph.to_bytes(),
        };
        postcard::to_stdvec(&saved).unwrap_or_default()
    }
}
