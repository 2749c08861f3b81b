//! Both levels at work: which subgoal, for how long, and the action towards it.
//!
//! A subgoal stands until its node is reached or its time is over. Near the goal the goal itself
//! is the subgoal, since a node is wider than the tolerance.

use std::sync::Arc;

use graph::{Edge, Graph, Knowledge};
use nets::categorical::Masked;
use nets::{Mlp, Workspace};
use rand::RngExt;
use rand_pcg::Pcg64Mcg;
use simulator::{Body, Values};

use super::choice::{Choice, Ending};
use super::low::Subgoal;
use super::vae::Encoder;
use super::{execution, high, low};
use crate::policy::{Act, Choosing, Mode, Outcome, Policy};
use crate::walker;

/// What finds the way over the graph.
#[derive(Debug, Clone)]
pub enum Planner {
    /// The learned policy and its weights.
    Learned(high::Policy, Arc<[f32]>),
    /// Dijkstra's search over the edges' costs, as in GAS: the ablation of the learned policy.
    Search,
}

/// What walks to a subgoal.
#[derive(Clone)]
pub enum Controller {
    /// The learned low level and its weights.
    Learned(low::Policy, Arc<[f32]>),
    /// The walker that made the data and its weights: the oracle of the low level.
    Walker(walker::Policy, Arc<[f32]>),
}

impl Controller {
    fn mlp(&self) -> &Mlp {
        match self {
            Self::Learned(policy, _) => policy.mlp(),
            Self::Walker(policy, _) => policy.mlp(),
        }
    }
}

/// Share of choices that a search makes at random where it explores.
const SEARCH_EXPLORES: f32 = 0.2;

/// The way over an edge under way.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Attempt {
    from: u32,
    to: u32,
    steps: usize,
    limit: usize,
}

/// A neighbour that was picked.
struct Picked {
    node: u32,
    log_prob: f32,
}

/// Weights and graph that decide.
#[derive(Clone)]
pub struct Navigator {
    body: &'static dyn Body,
    settings: execution::Settings,
    knowledge: Knowledge,
    encoder: Encoder,
    graph: Arc<Graph>,
    controller: Controller,
    planner: Planner,
    controller_workspace: Workspace,
    planner_workspaces: [Workspace; 2],
    /// Cost of the way from each node to the goal's; for a search alone.
    costs: Vec<f32>,
    input: Vec<f32>,
    latent: Vec<f32>,
    goal: [f32; 2],
    goal_latent: Vec<f32>,
    goal_node: u32,
    mode: Mode,
    attempt: Option<Attempt>,
    /// The choice whose end is still to come; it outlives its attempt near the goal.
    open: Option<Choice>,
    /// Edges given up in this episode.
    given_up: Vec<(u32, u32)>,
    /// Nodes that choices were made at in this episode.
    visited: Vec<u32>,
    allowed: Vec<usize>,
    /// Probabilities of the allowed neighbours.
    picked: Vec<f32>,
    /// Neighbours and their probabilities at the last choice, and its node.
    probabilities: Vec<(u32, f32)>,
    chosen_at: u32,
}

impl Navigator {
    /// `None` when sizes of weights, graph and shapes do not fit each other.
    #[must_use]
    pub fn new(
        body: &'static dyn Body,
        (settings, knowledge): (execution::Settings, Knowledge),
        (encoder, graph): (Encoder, Arc<Graph>),
        controller: Controller,
        planner: Planner,
    ) -> Option<Self> {
        let controller_fits = match &controller {
            Controller::Learned(policy, weights) => {
                weights.len() == policy.mlp().parameters()
                    && policy.mlp().inputs() == body.features() + 1 + encoder.latent()
            }
            Controller::Walker(policy, weights) => weights.len() == policy.weights(),
        };
        let (planner_fits, planner_workspaces) = match &planner {
            Planner::Learned(policy, weights) => (
                weights.len() == policy.weights() && policy.mlp().outputs() == graph.len(),
                policy.workspaces(),
            ),
            Planner::Search => (true, Default::default()),
        };
        let fits = planner_fits
            && controller_fits
            && graph.latent_dim == encoder.latent()
            && !graph.is_empty();
        fits.then(|| Self {
            controller_workspace: controller.mlp().workspace(1),
            planner_workspaces,
            costs: vec![],
            goal_latent: vec![0.0; encoder.latent()],
            body,
            settings,
            knowledge,
            encoder,
            graph,
            controller,
            planner,
            input: vec![],
            latent: vec![],
            goal: [0.0; 2],
            goal_node: 0,
            mode: Mode::Explore,
            attempt: None,
            open: None,
            given_up: vec![],
            visited: vec![],
            allowed: vec![],
            picked: vec![],
            probabilities: vec![],
            chosen_at: 0,
        })
    }

    /// What is still to come on the way from a node to the goal: by the learned policy's critic,
    /// or less the cost of the way that a search goes.
    fn value(&mut self, node: u32) -> f32 {
        match &self.planner {
            Planner::Learned(policy, weights) => {
                self.input.clear();
                policy.input(self.graph.latent(node), &self.goal_latent, &mut self.input);
                policy.value(weights, &self.input, &mut self.planner_workspaces)
            }
            Planner::Search => self.costs.get(node as usize).map_or(f32::NAN, |cost| -cost),
        }
    }

    /// Writes the action towards the subgoal, or the goal itself.
    fn control(&mut self, observation: &[f32], subgoal: Option<u32>, act: &mut Act) {
        let target = match subgoal {
            Some(to) => Subgoal {
                place: self.graph.places[to as usize],
                latent: self.graph.latent(to),
            },
            None => Subgoal {
                place: self.goal,
                latent: &self.goal_latent,
            },
        };
        act.target = Some(target.place);
        self.input.clear();
        let workspace = &mut self.controller_workspace;
        let (frame, own) = match &self.controller {
            Controller::Learned(policy, weights) => {
                let frame = policy.input(observation, &self.latent, target, &mut self.input);
                (frame, policy.act(weights, &self.input, 1, workspace))
            }
            Controller::Walker(policy, weights) => {
                let [x, y] = self.body.place(observation);
                let towards = [target.place[0] - x, target.place[1] - y];
                let frame = self.body.view(observation, towards, &mut self.input);
                (frame, policy.mean(weights, &self.input, 1, workspace))
            }
        };
        act.action.resize(own.len(), 0.0);
        self.body.to_actuators(frame, own, &mut act.action);
    }

    /// Ends the open choice at a node, and appends its record.
    fn end_choice(&mut self, ending: Ending, next: u32, choices: &mut Vec<u32>) {
        if let Some(mut choice) = self.open.take() {
            choice.ending = ending;
            choice.next = next;
            choice.write(choices);
        }
    }

    /// How the attempt under way ended, if it did.
    fn outcome(&mut self, node: u32, place: [f32; 2]) -> Option<Outcome> {
        let edge = self.attempt?;
        let target = self.graph.places[edge.to as usize];
        let distance = (target[0] - place[0]).hypot(target[1] - place[1]);
        let reached = node == edge.to || distance <= self.settings.reached_radius;
        if !reached && edge.steps < edge.limit {
            return None;
        }
        if !reached {
            self.given_up.push((edge.from, edge.to));
        }
        Some(Outcome {
            from: edge.from,
            to: edge.to,
            reached,
        })
    }

    /// Chooses a neighbour of a node. Returns whether there is one.
    fn choose(&mut self, node: u32, rng: &mut Pcg64Mcg) -> bool {
        // The most likely choices may lead round in a circle: where they led back to, the policy is
        // sampled instead.
        let mode = if self.visited.contains(&node) {
            Mode::Explore
        } else {
            self.visited.push(node);
            self.mode
        };
        let mut excluded = self.excluded(node);
        let first = self.pick(node, &excluded, mode, rng);
        let picked = match first {
            Some(picked) => Some(picked),
            None => {
                // Every edge from here was given up: they are all worth another try.
                self.given_up.retain(|(from, _)| *from != node);
                excluded.clear();
                self.pick(node, &[], Mode::Explore, rng)
            }
        };
        let Some(Picked { node: to, log_prob }) = picked else {
            return false;
        };
        self.remember(node);
        let subgoal = match mode {
            Mode::Explore => to,
            Mode::Exploit => self.look_ahead(node, to, rng),
        };
        let steps = self
            .graph
            .edge(node, subgoal)
            .map_or(1.0, |edge| self.graph.steps(edge, self.knowledge));
        self.attempt = Some(Attempt {
            from: node,
            to: subgoal,
            steps: 0,
            limit: self.settings.timeout.limit(steps),
        });
        self.open = Some(Choice {
            node,
            goal: self.goal_node,
            subgoal,
            log_prob,
            steps: 0,
            ending: Ending::GivenUp,
            next: node,
            excluded,
        });
        true
    }

    /// Neighbours of a node that were given up.
    fn excluded(&self, node: u32) -> Vec<u32> {
        let edges = self.graph.neighbours(node).iter();
        let excluded = edges.filter(|edge| self.given_up.contains(&(node, edge.to)));
        excluded.map(|edge| edge.to).collect()
    }

    /// A node further along the plan, but only where the data went in one segment.
    fn look_ahead(&mut self, node: u32, first: u32, rng: &mut Pcg64Mcg) -> u32 {
        let mut to = first;
        for _ in 1..self.settings.look_ahead {
            let next = self.pick(to, &[], Mode::Exploit, rng);
            let next = next.map(|picked| picked.node).filter(|next| {
                *next != node
                    && self.graph.edge(node, *next).is_some()
                    && !self.given_up.contains(&(node, *next))
            });
            match next {
                Some(next) if to != self.goal_node => to = next,
                _ => break,
            }
        }
        to
    }

    /// A neighbour of `node` that is not excluded, and its log-probability among those. Their
    /// probabilities are left in `picked`.
    fn pick(
        &mut self,
        node: u32,
        excluded: &[u32],
        mode: Mode,
        rng: &mut Pcg64Mcg,
    ) -> Option<Picked> {
        self.allowed.clear();
        let edges = self.graph.neighbours(node).iter();
        let open = edges.filter(|edge| !excluded.contains(&edge.to));
        self.allowed.extend(open.map(|edge| edge.to as usize));
        self.picked.clear();
        let (picked, log_prob) = match &self.planner {
            Planner::Learned(policy, weights) => {
                self.input.clear();
                policy.input(self.graph.latent(node), &self.goal_latent, &mut self.input);
                let logits = policy.logits(weights, &self.input, &mut self.planner_workspaces);
                let masked = Masked::new(logits, &self.allowed)?;
                let picked = match mode {
                    Mode::Explore => masked.sample(rng),
                    Mode::Exploit => masked.best(),
                };
                self.picked.extend(masked.probabilities());
                (picked, masked.log_prob(picked))
            }
            Planner::Search => {
                if self.allowed.is_empty() {
                    return None;
                }
                let explores = mode == Mode::Explore && rng.random::<f32>() < SEARCH_EXPLORES;
                let picked = if explores {
                    rng.random_range(0..self.allowed.len())
                } else {
                    self.cheapest(node)
                };
                self.picked.resize(self.allowed.len(), 0.0);
                self.picked[picked] = 1.0;
                (picked, 0.0)
            }
        };
        Some(Picked {
            node: self.allowed[picked] as u32,
            log_prob,
        })
    }

    /// Keeps the probabilities of the last pick, made at a node, for traces.
    fn remember(&mut self, node: u32) {
        let nodes = self.allowed.iter().map(|to| *to as u32);
        self.probabilities.clear();
        self.probabilities
            .extend(nodes.zip(self.picked.iter().copied()));
        self.chosen_at = node;
    }

    /// Position of the allowed neighbour that the cheapest way goes over.
    fn cheapest(&self, node: u32) -> usize {
        let through = |to: &usize| {
            let edge = self.graph.edge(node, *to as u32);
            edge.map_or(f32::INFINITY, |edge| {
                self.graph.cost(edge, self.knowledge) + self.costs[*to]
            })
        };
        let positions = 0..self.allowed.len();
        let best = positions
            .min_by(|a, b| through(&self.allowed[*a]).total_cmp(&through(&self.allowed[*b])));
        best.unwrap_or(0)
    }
}

impl Policy for Navigator {
    fn begin(&mut self, goal: &[f32], mode: Mode) {
        self.goal = [goal[0], goal[1]];
        self.mode = mode;
        self.goal_latent.clear();
        self.goal_latent
            .extend_from_slice(self.encoder.encode_one(self.goal));
        self.goal_node = self.graph.nearest(&self.goal_latent).unwrap_or(0);
        if matches!(self.planner, Planner::Search) {
            let cost = |edge: &Edge| self.graph.cost(edge, self.knowledge);
            self.costs = self.graph.distances_to(self.goal_node, cost);
        }
        self.attempt = None;
        self.open = None;
        self.given_up.clear();
        self.visited.clear();
        self.probabilities.clear();
    }

    fn act(&mut self, observation: Values<'_>, rng: &mut Pcg64Mcg, act: &mut Act) {
        let observation = observation.floats().unwrap_or_default();
        let place = self.body.place(observation);
        self.latent.clear();
        self.latent
            .extend_from_slice(self.encoder.encode_one(place));
        let node = self.graph.nearest(&self.latent).unwrap_or(0);
        if let Some(open) = &mut self.open {
            open.steps += 1;
        }
        act.outcome = self.outcome(node, place);
        if let Some(outcome) = act.outcome {
            self.attempt = None;
            let ending = if outcome.reached {
                Ending::Reached
            } else {
                Ending::GivenUp
            };
            self.end_choice(ending, node, &mut act.choices);
        }
        let to_goal = (self.goal[0] - place[0]).hypot(self.goal[1] - place[1]);
        if node == self.goal_node || to_goal <= self.settings.goal_radius {
            self.attempt = None;
        } else if let Some(edge) = &mut self.attempt {
            edge.steps += 1;
        } else {
            act.chosen = self.choose(node, rng);
        }
        let subgoal = self.attempt.map(|edge| edge.to);
        act.node = Some(node);
        act.subgoal = subgoal;
        act.goal_node = Some(self.goal_node);
        self.control(observation, subgoal, act);
    }

    fn end(&mut self, success: bool, choices: &mut Vec<u32>) {
        if let Some(open) = self.open.as_mut().filter(|_| success) {
            open.steps += 1;
            let goal = self.goal_node;
            self.end_choice(Ending::Arrived, goal, choices);
        }
    }

    fn graph(&self) -> Option<&Graph> {
        Some(&self.graph)
    }

    fn choosing(&mut self) -> Choosing {
        Choosing {
            value: self.value(self.chosen_at),
            probabilities: self.probabilities.clone(),
        }
    }
}

#[cfg(test)]
mod tests;
