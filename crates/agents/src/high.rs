//! Stage 3b: the high level, PPO over the neighbours of the latent graph's current node.
//!
//! LG-H-PPO (Han 2026), section on latent-graph planning: state (v_t, z_final), actions the K
//! nodes with non-neighbours masked, softmax, generalised advantages and the clipped surrogate.
//! Steps come from the graph itself (an edge succeeds with its measured reliability) and from
//! rollouts in the physics.

use std::collections::HashMap;

use graph::{Edge, Graph, Knowledge};
use nets::categorical::Masked;
use nets::{Activation, Mlp, Workspace};
use rand::{Rng, RngExt};

use serde::{Deserialize, Serialize};

use crate::actor_critic::{self, ActorCritic, Distribution, Samples};
use crate::navigator::Patience;
use crate::ppo::{self, End, Report};

/// Settings of the high level.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// Hidden layers of policy and value.
    pub hidden: Vec<usize>,
    /// Step size of Adam.
    pub learning_rate: f32,
    /// Walks on the graph that run side by side.
    pub environments: usize,
    /// Edges that each walk takes between updates.
    pub horizon: usize,
    /// PPO's own.
    pub ppo: ppo::Settings,
    /// Reward on arrival at the goal's node.
    pub arrival_reward: f32,
    /// Cost of an edge, in proportion to its mean steps.
    pub edge_cost: f32,
    /// Edges after which a walk is cut off.
    pub max_edges: usize,
    /// What walks on the graph know of its edges.
    pub knowledge: Knowledge,
    /// When an edge is given up, which is what a failure costs.
    pub patience: Patience,
}

/// Frequencies of the Fourier features of a latent.
const FREQUENCIES: [f32; 4] = [1.0, 2.0, 4.0, 8.0];

/// The shapes of policy and critic over a graph's nodes. Those who act have the weights of both in
/// one: the policy's, then the critic's.
#[derive(Debug, Clone)]
pub struct Policy {
    mlp: Mlp,
    critic: Mlp,
    latent: usize,
}

fn input_width(latent: usize) -> usize {
    let embedding = latent * (1 + 2 * FREQUENCIES.len());
    2 * embedding + latent
}

impl Policy {
    /// A policy with `nodes` logits over latents of this width.
    #[must_use]
    pub fn new(latent: usize, nodes: usize, hidden: &[usize]) -> Self {
        let network = |outputs: usize| {
            let sizes = [&[input_width(latent)], hidden, &[outputs]].concat();
            Mlp::new(&sizes, Activation::Gelu, false)
        };
        Self {
            mlp: network(nodes),
            critic: network(1),
            latent,
        }
    }

    /// The policy's network.
    #[must_use]
    pub fn mlp(&self) -> &Mlp {
        &self.mlp
    }

    /// Number of weights, the critic's included.
    #[must_use]
    pub fn weights(&self) -> usize {
        self.mlp.parameters() + self.critic.parameters()
    }

    /// Room to act in.
    #[must_use]
    pub fn workspaces(&self) -> [Workspace; 2] {
        [self.mlp.workspace(1), self.critic.workspace(1)]
    }

    /// Appends the input of a node's latent and the goal's latent.
    pub fn input(&self, node: &[f32], goal: &[f32], input: &mut Vec<f32>) {
        embed(node, goal, self.latent, input);
    }

    /// Logits `[nodes]` for one input; only those of neighbours mean anything.
    pub fn logits<'w>(
        &self,
        weights: &[f32],
        input: &[f32],
        [workspace, _]: &'w mut [Workspace; 2],
    ) -> &'w [f32] {
        let weights = &weights[..self.mlp.parameters()];
        self.mlp.infer(weights, input, 1, workspace)
    }

    /// The critic's value of one input: the sum of discounted rewards to come.
    pub fn value(
        &self,
        weights: &[f32],
        input: &[f32],
        [_, workspace]: &mut [Workspace; 2],
    ) -> f32 {
        let weights = &weights[self.mlp.parameters()..];
        self.critic.infer(weights, input, 1, workspace)[0]
    }
}

fn embed(node: &[f32], goal: &[f32], latent: usize, input: &mut Vec<f32>) {
    for z in [node, goal] {
        input.extend_from_slice(&z[..latent]);
        for frequency in FREQUENCIES {
            for value in &z[..latent] {
                let (sin, cos) = (value * frequency * std::f32::consts::FRAC_PI_4).sin_cos();
                input.extend([sin, cos]);
            }
        }
    }
    input.extend(node.iter().zip(goal).map(|(a, b)| b - a).take(latent));
}

/// One choice of a rollout in the physics, and what became of it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Settled {
    /// Node chosen at.
    pub node: u32,
    /// Goal's node.
    pub goal: u32,
    /// Neighbour chosen.
    pub subgoal: u32,
    /// Its log-probability when chosen.
    pub log_prob: f32,
    /// Control steps until the next choice.
    pub steps: u32,
    /// Whether that was the goal.
    pub arrived: bool,
}

/// One choice of a walk, in the physics or on the graph.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
struct Choice {
    node: u32,
    goal: u32,
    subgoal: u32,
    log_prob: f32,
    reward: f32,
    /// In edges of mean length: what takes longer is discounted by more, or else walks that
    /// dither on short edges would look cheap.
    duration: f32,
    end: End,
}

#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
struct Batch {
    choices: Vec<Choice>,
    records: Vec<usize>,
    /// Node after each record's last choice, and its goal.
    finals: Vec<(u32, u32)>,
}

/// One walk on the graph.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
struct Walk {
    node: u32,
    goal: u32,
    edges: usize,
    rewards: f32,
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
    pub fn new(graph: &Graph, settings: Settings, rng: &mut impl Rng) -> Self {
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
        let known = |c: &Choice| c.node < nodes && c.goal < nodes && c.subgoal < nodes;
        let last = |(node, goal): &(u32, u32)| *node < nodes && *goal < nodes;
        let Batch {
            choices,
            records,
            finals,
        } = &state.pending;
        let fits = self.networks.fits(&state.networks)
            && state.walks.len() == self.walks.len()
            && state.walks.iter().all(inside)
            && choices.iter().all(known)
            && finals.iter().all(last)
            && records.len() == finals.len()
            && records.iter().sum::<usize>() == choices.len();
        if !fits || !self.networks.restore(state.networks) {
            return false;
        }
        self.walks = state.walks;
        self.pending = state.pending;
        self.steps = state.steps;
        self.ended = state.ended;
        true
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

    /// Adds the choices of one rollout in the physics to the next update. Choices that the graph
    /// does not hold are left out.
    pub fn add_rollout(&mut self, graph: &Graph, choices: &[Settled], last: u32) {
        let nodes = graph.len() as u32;
        let known = |c: &Settled| {
            c.node < nodes && c.goal < nodes && graph.edge(c.node, c.subgoal).is_some()
        };
        let Some(end) = choices.last() else { return };
        if last >= nodes || !choices.iter().all(known) {
            return;
        }
        for (i, c) in choices.iter().enumerate() {
            self.pending.choices.push(Choice {
                node: c.node,
                goal: c.goal,
                subgoal: c.subgoal,
                log_prob: c.log_prob,
                reward: reward(&self.settings, graph, c.steps as f32, c.arrived),
                duration: duration(graph, c.steps as f32),
                end: if c.arrived {
                    End::Terminal
                } else if i + 1 == choices.len() {
                    End::Truncated
                } else {
                    End::Not
                },
            });
        }
        self.pending.records.push(choices.len());
        self.pending.finals.push((last, end.goal));
    }

    /// Choices of rollouts that wait for the next update.
    #[must_use]
    pub fn pending(&self) -> usize {
        self.pending.choices.len()
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
        let pending = std::mem::take(&mut self.pending);
        self.batch.choices.extend(pending.choices);
        self.batch.records.extend(pending.records);
        self.batch.finals.extend(pending.finals);

        let mut batch = std::mem::take(&mut self.batch);
        let estimate = self.estimate(graph, &batch);
        let log_probs: Vec<f32> = batch.choices.iter().map(|c| c.log_prob).collect();
        let choices = &batch.choices;
        let policy = &self.policy;
        let samples = Samples {
            input: |i: usize, input: &mut Vec<f32>| {
                let Choice { node, goal, .. } = choices[i];
                policy.input(graph.latent(node), graph.latent(goal), input);
            },
            log_probs: &log_probs,
            estimate: &estimate,
        };
        let open = |i: usize, allowed: &mut Vec<usize>| {
            let edges = graph.neighbours(choices[i].node);
            allowed.extend(edges.iter().map(|edge| edge.to as usize));
        };
        let mut distribution = Neighbours::new(open, |i| choices[i].subgoal as usize);
        let report = self
            .networks
            .update(samples, &mut distribution, |_| (), rng);
        batch.choices.clear();
        batch.records.clear();
        batch.finals.clear();
        self.batch = batch;
        report
    }

    /// Advantages and returns of a batch's choices.
    fn estimate(&mut self, graph: &Graph, batch: &Batch) -> ppo::Estimate {
        let pairs: Vec<(u32, u32)> = batch.choices.iter().map(|c| (c.node, c.goal)).collect();
        let values = self.values(graph, &pairs);
        let final_values = self.values(graph, &batch.finals);
        let rewards: Vec<f32> = batch.choices.iter().map(|c| c.reward).collect();
        let ends: Vec<End> = batch.choices.iter().map(|c| c.end).collect();
        let durations: Vec<f32> = batch.choices.iter().map(|c| c.duration).collect();
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

    fn walk(&mut self, graph: &Graph, rng: &mut impl Rng) {
        let (walks, horizon) = (self.walks.len(), self.settings.horizon);
        let nodes = graph.len();
        // Step-major while walking, one record a walk afterwards.
        let mut choices: Vec<Vec<Choice>> = vec![Vec::with_capacity(horizon); walks];
        let mut input = vec![];
        let mut allowed = vec![];
        for _ in 0..horizon {
            input.clear();
            for walk in &self.walks {
                let (node, goal) = (graph.latent(walk.node), graph.latent(walk.goal));
                self.policy.input(node, goal, &mut input);
            }
            let logits = self.networks.outputs(&input, walks);
            for (i, walk) in self.walks.iter_mut().enumerate() {
                let edges = graph.neighbours(walk.node);
                allowed.clear();
                allowed.extend(edges.iter().map(|edge| edge.to as usize));
                let row = &logits[i * nodes..(i + 1) * nodes];
                let Some(masked) = Masked::new(row, &allowed) else {
                    continue;
                };
                let picked = masked.sample(rng);
                let edge = &edges[picked];
                let knowledge = self.settings.knowledge;
                let passed = rng.random::<f32>() < graph.reliability(edge, knowledge);
                let mut steps = graph.steps(edge, knowledge);
                if !passed {
                    steps = self.settings.patience.limit(steps) as f32;
                }
                let next = if passed { edge.to } else { walk.node };
                let arrived = next == walk.goal;
                let out_of_time = walk.edges + 1 >= self.settings.max_edges;
                let choice = Choice {
                    node: walk.node,
                    goal: walk.goal,
                    subgoal: edge.to,
                    log_prob: masked.log_prob(picked),
                    reward: reward(&self.settings, graph, steps, arrived),
                    duration: duration(graph, steps),
                    end: if arrived {
                        End::Terminal
                    } else if out_of_time {
                        End::Truncated
                    } else {
                        End::Not
                    },
                };
                choices[i].push(choice);
                walk.node = next;
                walk.edges += 1;
                walk.rewards += choice.reward;
                if choice.end != End::Not {
                    self.ended.0 += u64::from(arrived);
                    self.ended.1 += 1;
                    self.ended.2 += f64::from(walk.rewards);
                    self.batch.records.push(choices[i].len());
                    self.batch.choices.append(&mut choices[i]);
                    self.batch.finals.push((next, walk.goal));
                    *walk = new_walk(nodes, rng);
                }
            }
            self.steps += walks as u64;
        }
        for (walk, mut record) in self.walks.iter().zip(choices) {
            if let Some(last) = record.last_mut() {
                last.end = End::Truncated;
                self.batch.records.push(record.len());
                self.batch.choices.append(&mut record);
                self.batch.finals.push((walk.node, walk.goal));
            }
        }
    }

    /// Share of all (start, goal) pairs, thinned to at most `pairs`, that the most likely choices
    /// lead from start to goal, and what their paths cost over what the cheapest ones do.
    pub fn quality(&mut self, graph: &Graph, pairs: usize, rng: &mut impl Rng) -> (f32, f32) {
        let nodes = graph.len();
        let (mut arrived, mut ratio) = (0_u32, 0.0);
        let mut input = vec![];
        let cost = |edge: &Edge| graph.cost(edge, self.settings.knowledge);
        for _ in 0..pairs {
            let Walk {
                node: start, goal, ..
            } = new_walk(nodes, rng);
            let cheapest = graph.distances_to(goal, cost)[start as usize];
            let (mut node, mut spent) = (start, 0.0);
            for _ in 0..self.settings.max_edges {
                input.clear();
                self.policy
                    .input(graph.latent(node), graph.latent(goal), &mut input);
                let logits = self.networks.outputs(&input, 1);
                let best = graph
                    .neighbours(node)
                    .iter()
                    .max_by(|a, b| logits[a.to as usize].total_cmp(&logits[b.to as usize]));
                let Some(edge) = best else { break };
                node = edge.to;
                spent += cost(edge);
                if node == goal {
                    arrived += 1;
                    ratio += spent / cheapest.max(1.0);
                    break;
                }
            }
        }
        (
            arrived as f32 / pairs.max(1) as f32,
            ratio / arrived.max(1) as f32,
        )
    }
}

/// The softmax over each choice's open neighbours; all other nodes are masked.
pub(crate) struct Neighbours<O, P> {
    open: O,
    picked: P,
    allowed: Vec<usize>,
}

impl<O: Fn(usize, &mut Vec<usize>), P: Fn(usize) -> usize> Neighbours<O, P> {
    /// `open` appends the nodes that sample `i` chose among, `picked` is the one that it chose.
    pub(crate) fn new(open: O, picked: P) -> Self {
        Self {
            open,
            picked,
            allowed: vec![],
        }
    }
}

impl<O: Fn(usize, &mut Vec<usize>), P: Fn(usize) -> usize> Distribution for Neighbours<O, P> {
    fn grade(
        &mut self,
        i: usize,
        outputs: &[f32],
        _free: &[f32],
        weigh: impl FnOnce(f32, f32) -> [f32; 2],
        output_gradient: &mut [f32],
        _free_gradient: &mut [f32],
    ) -> bool {
        self.allowed.clear();
        (self.open)(i, &mut self.allowed);
        let node = (self.picked)(i);
        let Some(picked) = self.allowed.iter().position(|&other| other == node) else {
            return false;
        };
        let Some(masked) = Masked::new(outputs, &self.allowed) else {
            return false;
        };
        let [log_weight, entropy_weight] = weigh(masked.log_prob(picked), masked.entropy());
        masked.add_gradient(picked, log_weight, entropy_weight, output_gradient);
        true
    }
}

/// Reward of one choice: the cost of its steps, as many as an edge's mean ones cost one edge, and
/// the arrival's gain.
fn reward(settings: &Settings, graph: &Graph, steps: f32, arrived: bool) -> f32 {
    let cost = settings.edge_cost * duration(graph, steps);
    if arrived {
        settings.arrival_reward - cost
    } else {
        -cost
    }
}

/// Control steps in edges of mean length.
fn duration(graph: &Graph, steps: f32) -> f32 {
    steps / graph.mean_edge_steps.max(1.0)
}

fn new_walk(nodes: usize, rng: &mut impl Rng) -> Walk {
    let node = rng.random_range(0..nodes.max(2));
    let mut goal = rng.random_range(0..nodes.max(2) - 1);
    if goal >= node {
        goal += 1;
    }
    Walk {
        node: node as u32,
        goal: goal as u32,
        edges: 0,
        rewards: 0.0,
    }
}
