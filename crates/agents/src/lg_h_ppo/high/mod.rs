//! Stage 3b: the high level, PPO over the neighbours of the latent graph's current node.
//!
//! LG-H-PPO (Han 2026), section on latent-graph planning: state (v_t, z_final), actions the K
//! nodes with non-neighbours masked, softmax, generalised advantages and the clipped surrogate.
//! Steps come from the graph itself (an edge succeeds with its measured reliability) and from
//! rollouts in the physics.

mod batch;
mod neighbours;
mod policy;
mod settings;
#[cfg(test)]
mod tests;
mod walk;
mod walking;

use std::collections::HashMap;

use graph::{EdgeTimeout, Graph, Knowledge};
use rand::Rng;
use serde::{Deserialize, Serialize};

use crate::actor_critic::{self, ActorCritic, Samples};
use crate::lg_h_ppo::choice::Choice;
use crate::ppo::{self, End, Report};
use batch::{Batch, Step};
use walk::{Walk, new_walk};

pub(crate) use neighbours::Neighbours;
pub use policy::Policy;
pub use settings::{Planner, Settings};
#[cfg(test)]
pub(crate) use tests::settings as made;

/// What is known of edges, for walks on the graph.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Edges {
    /// What of their times and reachability is used.
    pub knowledge: Knowledge,
    /// When one is given up, which is what a failure costs.
    pub timeout: EdgeTimeout,
}

/// All that an update changes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct State {
    networks: actor_critic::State,
    walks: Vec<Walk>,
    pending: Batch,
    steps: u64,
    ended: (u64, u64, f64),
}

/// Policy and value in training on one graph.
pub struct High {
    policy: Policy,
    settings: Settings,
    edges: Edges,
    networks: ActorCritic,
    walks: Vec<Walk>,
    batch: Batch,
    pending: Batch,
    /// Choices made on the graph so far.
    pub steps: u64,
    /// Walks that arrived and walks that ended since last asked, and the sum of their rewards.
    ended: (u64, u64, f64),
}

impl High {
    /// Fresh networks for a graph.
    pub fn new(graph: &Graph, settings: Settings, edges: Edges, rng: &mut impl Rng) -> Self {
        let nodes = graph.len();
        let policy = Policy::new(graph.latent_dim, nodes, &settings.hidden);
        let networks = ActorCritic::new(
            [policy.mlp.clone(), policy.critic.clone()],
            &[],
            settings.learning_rate,
            settings.ppo.clone(),
            settings.environments,
            rng,
        );
        let walks = (0..settings.environments)
            .map(|_| new_walk(nodes, rng))
            .collect();
        Self {
            policy,
            settings,
            edges,
            networks,
            walks,
            batch: Batch::default(),
            pending: Batch::default(),
            steps: 0,
            ended: (0, 0, 0.0),
        }
    }

    /// The weights of policy and critic, as actors use them.
    #[must_use]
    pub fn weights(&self) -> Vec<f32> {
        [&self.networks.weights[..], &self.networks.value_parameters].concat()
    }

    /// Where the training is.
    #[must_use]
    pub fn state(&self) -> State {
        State {
            networks: self.networks.state(),
            walks: self.walks.clone(),
            pending: self.pending.clone(),
            steps: self.steps,
            ended: self.ended,
        }
    }

    /// Goes on from a state of a training on a graph of as many nodes; false, and nothing is
    /// changed, where it is of another one.
    #[must_use]
    pub fn restore(&mut self, state: State) -> bool {
        let nodes = self.policy.mlp.outputs() as u32;
        let inside = |walk: &Walk| walk.node < nodes && walk.goal < nodes;
        let fits = self.networks.fits(&state.networks)
            && state.walks.len() == self.walks.len()
            && state.walks.iter().all(inside)
            && state.pending.is_sound(nodes);
        if !fits || !self.networks.restore(state.networks) {
            return false;
        }
        self.walks = state.walks;
        self.pending = state.pending;
        self.steps = state.steps;
        self.ended = state.ended;
        true
    }

    /// Moves the weights away from their start, where every action is as likely as any other.
    #[cfg(test)]
    pub(crate) fn shake(&mut self, rng: &mut impl Rng) {
        use rand::RngExt;
        for weight in &mut self.networks.weights {
            *weight += 0.3 * rng.random_range(-1.0..1.0_f32);
        }
    }

    /// The policy's shape.
    #[must_use]
    pub fn policy(&self) -> &Policy {
        &self.policy
    }

    /// Sets what is left of step size and entropy bonus, as shares of the settings'.
    pub fn anneal(&mut self, rate: f32, entropy: f32) {
        let rate = rate * self.settings.learning_rate;
        self.networks.set_learning_rate(rate);
        self.networks.entropy = entropy * self.settings.ppo.entropy;
    }

    /// Moves on to a version of the graph with other nodes: those that it shares with `old` keep
    /// their logits, each new one starts with those of the old node that is nearest. Rollouts and
    /// walks on the old nodes are left off.
    pub fn adopt(&mut self, old: &Graph, new: &Graph, rng: &mut impl Rng) {
        if old.structure() == new.structure() {
            return;
        }
        let place: HashMap<u32, usize> = old.ids.iter().copied().zip(0..).collect();
        let source = |node: u32| {
            let id = new.ids[node as usize];
            let nearest = || {
                old.nearest(new.latent(node))
                    .map_or(0, |node| node as usize)
            };
            place.get(&id).copied().unwrap_or_else(nearest)
        };
        let sources: Vec<usize> = (0..new.len() as u32).map(source).collect();
        self.networks.take_outputs(&sources);
        self.policy.mlp = self.policy.mlp.with_outputs(new.len());
        self.pending = Batch::default();
        for walk in &mut self.walks {
            *walk = new_walk(new.len(), rng);
        }
    }

    /// Adds the choices of one rollout in the physics to the next update. A rollout with a choice
    /// that the graph does not hold is left out.
    pub fn add_rollout(&mut self, graph: &Graph, choices: &[Choice]) {
        self.pending.add_rollout(&self.settings, graph, choices);
    }

    /// Choices of rollouts that wait for the next update.
    #[must_use]
    pub fn pending(&self) -> usize {
        self.pending.steps.len()
    }

    /// Share of the walks that arrived and their mean return, of those that ended since the last
    /// call.
    pub fn take_walks(&mut self) -> Option<(f32, f32)> {
        let (arrived, ended, rewards) = std::mem::take(&mut self.ended);
        let mean = |sum: f64| (sum / ended as f64) as f32;
        (ended > 0).then(|| (mean(arrived as f64), mean(rewards)))
    }

    /// Walks on the graph for `horizon` edges and updates policy and value on all that was seen.
    pub fn update(&mut self, graph: &Graph, rng: &mut impl Rng) -> Report {
        self.walk(graph, rng);
        self.batch.append(&mut self.pending);
        let mut batch = std::mem::take(&mut self.batch);
        let estimate = self.estimate(graph, &batch);
        let log_probs: Vec<f32> = batch.steps.iter().map(|c| c.log_prob).collect();
        let steps = &batch.steps;
        let policy = &self.policy;
        let samples = Samples {
            input: |i: usize, input: &mut Vec<f32>| {
                let Step { node, goal, .. } = steps[i];
                policy.input(graph.latent(node), graph.latent(goal), input);
            },
            log_probs: &log_probs,
            estimate: &estimate,
        };
        let open = |i: usize, allowed: &mut Vec<usize>| {
            let step = &steps[i];
            let edges = graph.neighbours(step.node).iter();
            let open = edges.filter(|edge| !step.excluded.contains(&edge.to));
            allowed.extend(open.map(|edge| edge.to as usize));
        };
        let mut distribution = Neighbours::new(open, |i| steps[i].subgoal as usize);
        let report = self
            .networks
            .update(samples, &mut distribution, |_| (), rng);
        batch.clear();
        self.batch = batch;
        report
    }

    /// Advantages and returns of a batch's choices.
    fn estimate(&mut self, graph: &Graph, batch: &Batch) -> ppo::Estimate {
        let pairs: Vec<(u32, u32)> = batch.steps.iter().map(|c| (c.node, c.goal)).collect();
        let values = self.values(graph, &pairs);
        let final_values = self.values(graph, &batch.finals);
        let rewards: Vec<f32> = batch.steps.iter().map(|c| c.reward).collect();
        let ends: Vec<End> = batch.steps.iter().map(|c| c.end).collect();
        let durations: Vec<f32> = batch.steps.iter().map(|c| c.duration).collect();
        let mut estimate = ppo::Estimate::default();
        ppo::estimate(
            &self.settings.ppo,
            &batch.records,
            (&values, &final_values),
            (&rewards, &ends, Some(&durations)),
            &mut estimate,
        );
        estimate
    }

    /// Values of (node, goal) pairs.
    fn values(&mut self, graph: &Graph, pairs: &[(u32, u32)]) -> Vec<f32> {
        let mut values = Vec::with_capacity(pairs.len());
        let policy = &self.policy;
        let input = |i: usize, input: &mut Vec<f32>| {
            let (node, goal) = pairs[i];
            policy.input(graph.latent(node), graph.latent(goal), input);
        };
        self.networks.values(pairs.len(), input, &mut values);
        values
    }
}
