//! Both levels at work: which subgoal, for how long, and the action towards it.
//!
//! A subgoal stands until its node is reached or its time is over. Near the goal the goal itself
//! is the subgoal, since a node is wider than the tolerance.

use graph::{Edge, Graph, Knowledge};
use maze::{Action, EGOCENTRIC, Egocentric};
use nets::categorical::Masked;
use nets::{Mlp, Workspace};
use rand::{Rng, RngExt};

use crate::low::Subgoal;
use crate::vae::Encoder;
use crate::{high, low, walker};

/// Settings of execution.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// A node is reached within this distance of its place (m).
    pub reached_radius: f32,
    /// Within this distance the goal itself is the subgoal (m).
    pub goal_radius: f32,
    /// Nodes that the subgoal may lie ahead, when the most likely ones are chosen.
    pub look_ahead: usize,
    /// When an edge is given up.
    pub patience: Patience,
    /// What is known of the edges' times, and what a search reckons with.
    pub knowledge: Knowledge,
}

/// When an edge is given up.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Patience {
    /// After this many times its steps,
    pub factor: f32,
    /// and after this many steps at most.
    pub most: usize,
}

/// Short edges too need the time to turn round.
const LEAST_PATIENCE: usize = 15;

impl Patience {
    /// Steps after which an edge that takes `steps` is given up.
    #[must_use]
    pub fn limit(&self, steps: f32) -> usize {
        let limit = (self.factor * steps).ceil() as usize;
        limit.max(LEAST_PATIENCE).min(self.most)
    }
}

/// What finds the way over the graph.
#[derive(Debug, Clone)]
pub enum Planner {
    /// The learned policy and its weights.
    Learned(high::Policy, Vec<f32>),
    /// Dijkstra's search over the edges' costs, as in GAS: the ablation of the learned policy.
    Search,
}

/// What walks to a subgoal.
#[derive(Debug, Clone)]
pub enum Controller {
    /// The learned low level and its weights.
    Learned(low::Policy, Vec<f32>),
    /// The walker that made the data and its weights: the oracle of the low level.
    Walker(walker::Policy, Vec<f32>),
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

/// How neighbours are chosen.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Choosing {
    /// By their probabilities, to learn.
    Sampled,
    /// The most likely one, to score; at nodes that the ant comes back to, by their probabilities.
    Greedy,
}

/// A choice under way.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Attempt {
    from: u32,
    to: u32,
    steps: usize,
    limit: usize,
}

/// How a choice ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Outcome {
    /// Node of the choice.
    pub from: u32,
    /// Chosen node.
    pub to: u32,
    /// Whether it was reached.
    pub reached: bool,
}

/// A new choice.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Chosen {
    /// The chosen node.
    pub subgoal: u32,
    /// Its log-probability.
    pub log_prob: f32,
}

/// What to do in one step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Decision {
    /// The action, to be clipped by the simulator.
    pub action: Action,
    /// The ant's node.
    pub node: u32,
    /// The node walked to; none when it is the goal itself.
    pub subgoal: Option<u32>,
    /// The place walked to (m).
    pub place: [f32; 2],
    /// How the choice before ended, if it ended at this step.
    pub outcome: Option<Outcome>,
    /// The choice made at this step, if one was.
    pub chosen: Option<Chosen>,
}

/// Weights and graph that decide.
#[derive(Clone)]
pub struct Navigator {
    settings: Settings,
    encoder: Encoder,
    graph: Graph,
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
    attempt: Option<Attempt>,
    /// Edges given up in this episode.
    given_up: Vec<(u32, u32)>,
    /// Nodes that choices were made at in this episode.
    visited: Vec<u32>,
    allowed: Vec<usize>,
    probabilities: Vec<(u32, f32)>,
}

impl Navigator {
    /// None when sizes of weights, graph and shapes do not fit each other.
    #[must_use]
    pub fn new(
        settings: Settings,
        encoder: Encoder,
        graph: Graph,
        controller: Controller,
        planner: Planner,
    ) -> Option<Self> {
        let controller_fits = match &controller {
            Controller::Learned(policy, weights) => {
                weights.len() == policy.mlp().parameters()
                    && policy.mlp().inputs() == EGOCENTRIC + 1 + encoder.latent()
            }
            Controller::Walker(policy, weights) => weights.len() == policy.weights(),
        };
        let planner_fits = match &planner {
            Planner::Learned(policy, weights) => {
                weights.len() == policy.weights() && policy.mlp().outputs() == graph.len()
            }
            Planner::Search => true,
        };
        let planner_workspaces = match &planner {
            Planner::Learned(policy, _) => policy.workspaces(),
            Planner::Search => Default::default(),
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
            settings,
            encoder,
            graph,
            controller,
            planner,
            input: vec![],
            latent: vec![],
            goal: [0.0; 2],
            goal_node: 0,
            attempt: None,
            given_up: vec![],
            visited: vec![],
            allowed: vec![],
            probabilities: vec![],
        })
    }

    /// The graph walked on.
    #[must_use]
    pub fn graph(&self) -> &Graph {
        &self.graph
    }

    /// The goal's node.
    #[must_use]
    pub fn goal_node(&self) -> u32 {
        self.goal_node
    }

    /// Neighbours and their probabilities at the last choice.
    #[must_use]
    pub fn probabilities(&self) -> &[(u32, f32)] {
        &self.probabilities
    }

    /// What is still to come on the way from a node to the goal: by the learned policy's critic,
    /// or less the cost of the way that a search goes.
    pub fn value(&mut self, node: u32) -> f32 {
        match &self.planner {
            Planner::Learned(policy, weights) => {
                self.input.clear();
                policy.input(self.graph.latent(node), &self.goal_latent, &mut self.input);
                policy.value(weights, &self.input, &mut self.planner_workspaces)
            }
            Planner::Search => self.costs.get(node as usize).map_or(f32::NAN, |cost| -cost),
        }
    }

    /// Begins an episode towards a goal (m).
    pub fn begin(&mut self, goal: [f32; 2]) {
        self.goal = goal;
        self.goal_latent = self.encoder.encode_one(goal).to_vec();
        self.goal_node = self.graph.nearest(&self.goal_latent).unwrap_or(0);
        if matches!(self.planner, Planner::Search) {
            let cost = |edge: &Edge| self.graph.cost(edge, self.settings.knowledge);
            self.costs = self.graph.distances_to(self.goal_node, cost);
        }
        self.attempt = None;
        self.given_up.clear();
        self.visited.clear();
    }

    /// Decides what to do at an observation (29 values).
    pub fn decide(
        &mut self,
        observation: &[f32],
        choosing: Choosing,
        rng: &mut impl Rng,
    ) -> Decision {
        let place = [observation[0], observation[1]];
        self.latent.clear();
        self.latent
            .extend_from_slice(self.encoder.encode_one(place));
        let node = self.graph.nearest(&self.latent).unwrap_or(0);

        let outcome = self.settle(node, place);
        if outcome.is_some() {
            self.attempt = None;
        }
        let to_goal = (self.goal[0] - place[0]).hypot(self.goal[1] - place[1]);
        let at_goal = node == self.goal_node || to_goal <= self.settings.goal_radius;
        let mut chosen = None;
        if at_goal {
            self.attempt = None;
        } else if self.attempt.is_none() {
            chosen = self.choose(node, choosing, rng);
        } else if let Some(edge) = &mut self.attempt {
            edge.steps += 1;
        }
        let subgoal = if at_goal {
            None
        } else {
            self.attempt.map(|edge| edge.to)
        };
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
        let place = target.place;
        let workspace = &mut self.controller_workspace;
        let action = match &self.controller {
            Controller::Learned(policy, weights) => {
                self.input.clear();
                let frame = policy.input(observation, &self.latent, target, &mut self.input);
                frame.to_actuators(policy.act(weights, &self.input, 1, workspace))
            }
            Controller::Walker(policy, weights) => {
                let towards = [place[0] - observation[0], place[1] - observation[1]];
                let frame = Egocentric::new(observation, towards);
                frame.to_actuators(policy.mean(weights, &frame.features, 1, workspace))
            }
        };
        Decision {
            action,
            node,
            subgoal,
            place,
            outcome,
            chosen,
        }
    }

    /// How the choice under way ended, if it did.
    fn settle(&mut self, node: u32, place: [f32; 2]) -> Option<Outcome> {
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

    fn choose(&mut self, node: u32, choosing: Choosing, rng: &mut impl Rng) -> Option<Chosen> {
        // The most likely choices may lead round in a circle: where they led back to, the policy is
        // taken at its word instead, which is a distribution.
        let choosing = if self.visited.contains(&node) {
            Choosing::Sampled
        } else {
            self.visited.push(node);
            choosing
        };
        let given_up = std::mem::take(&mut self.given_up);
        let first = self.pick(node, &given_up, choosing, rng);
        self.given_up = given_up;
        let (mut to, log_prob, probabilities) = match first {
            Some(picked) => picked,
            None => {
                // Every way from here was given up: they are all worth another try.
                self.given_up.retain(|(from, _)| *from != node);
                self.pick(node, &[], Choosing::Sampled, rng)?
            }
        };
        self.probabilities = probabilities;
        let chosen = Chosen {
            subgoal: to,
            log_prob,
        };
        if choosing == Choosing::Greedy {
            // Look further along the plan, but only where the data went in one segment.
            for _ in 1..self.settings.look_ahead {
                let next = self
                    .pick(to, &[], Choosing::Greedy, rng)
                    .map(|(next, ..)| next);
                let usable = |next: &u32| {
                    *next != node
                        && self.graph.edge(node, *next).is_some()
                        && !self.given_up.contains(&(node, *next))
                };
                match next.filter(usable) {
                    Some(next) if to != self.goal_node => to = next,
                    _ => break,
                }
            }
        }
        let knowledge = self.settings.knowledge;
        let steps = self
            .graph
            .edge(node, to)
            .map_or(1.0, |edge| self.graph.steps(edge, knowledge));
        let limit = self.settings.patience.limit(steps);
        self.attempt = Some(Attempt {
            from: node,
            to,
            steps: 0,
            limit,
        });
        Some(chosen)
    }

    /// A neighbour of `node`, its log-probability, and all neighbours' probabilities.
    fn pick(
        &mut self,
        node: u32,
        given_up: &[(u32, u32)],
        choosing: Choosing,
        rng: &mut impl Rng,
    ) -> Option<(u32, f32, Vec<(u32, f32)>)> {
        self.allowed.clear();
        let open = self.graph.neighbours(node).iter().map(|edge| edge.to);
        let open = open.filter(|to| !given_up.contains(&(node, *to)));
        self.allowed.extend(open.map(|to| to as usize));
        let (picked, log_prob, probabilities) = match &self.planner {
            Planner::Learned(policy, weights) => {
                self.input.clear();
                policy.input(self.graph.latent(node), &self.goal_latent, &mut self.input);
                let logits = policy.logits(weights, &self.input, &mut self.planner_workspaces);
                let masked = Masked::new(logits, &self.allowed)?;
                let picked = match choosing {
                    Choosing::Sampled => masked.sample(rng),
                    Choosing::Greedy => masked.best(),
                };
                let probabilities: Vec<f32> = masked.probabilities().collect();
                (picked, masked.log_prob(picked), probabilities)
            }
            Planner::Search => {
                if self.allowed.is_empty() {
                    return None;
                }
                let explores =
                    choosing == Choosing::Sampled && rng.random::<f32>() < SEARCH_EXPLORES;
                let picked = if explores {
                    rng.random_range(0..self.allowed.len())
                } else {
                    self.cheapest(node)
                };
                let mut probabilities = vec![0.0; self.allowed.len()];
                probabilities[picked] = 1.0;
                (picked, 0.0, probabilities)
            }
        };
        let nodes = self.allowed.iter().map(|to| *to as u32);
        Some((
            self.allowed[picked] as u32,
            log_prob,
            nodes.zip(probabilities).collect(),
        ))
    }

    /// Position of the allowed neighbour that the cheapest way goes over.
    fn cheapest(&self, node: u32) -> usize {
        let through = |to: &usize| {
            let edge = self.graph.edge(node, *to as u32);
            edge.map_or(f32::INFINITY, |edge| {
                self.graph.cost(edge, self.settings.knowledge) + self.costs[*to]
            })
        };
        let positions = 0..self.allowed.len();
        let best = positions
            .min_by(|a, b| through(&self.allowed[*a]).total_cmp(&through(&self.allowed[*b])));
        best.unwrap_or(0)
    }
}
