//! Both levels at work: which subgoal, for how long, and the action towards it.
//!
//! A subgoal stands until its node is reached or its time is over. Near the goal the goal itself
//! is the subgoal, since a node is wider than the tolerance.

use graph::Graph;
use maze::{Action, EGOCENTRIC};
use nets::Workspace;
use nets::categorical::Masked;
use rand::Rng;

use crate::low::Subgoal;
use crate::vae::Encoder;
use crate::{high, low};

/// Settings of execution.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// A node is reached within this distance of its place (m).
    pub reached_radius: f32,
    /// Within this distance the goal itself is the subgoal (m).
    pub goal_radius: f32,
    /// Nodes that the subgoal may lie ahead, when the most likely ones are chosen.
    pub look_ahead: usize,
    /// An edge is given up after this many times its mean steps.
    pub timeout_factor: f32,
    /// And after this many steps at most.
    pub max_edge_steps: usize,
}

/// How neighbours are chosen.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Choosing {
    /// By their probabilities, to learn.
    Sampled,
    /// The most likely one, to score.
    Greedy,
}

/// A choice under way.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Edge {
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
    low: (low::Policy, Vec<f32>),
    high: (high::Policy, Vec<f32>),
    low_workspace: Workspace,
    high_workspace: Workspace,
    input: Vec<f32>,
    latent: Vec<f32>,
    goal: [f32; 2],
    goal_latent: Vec<f32>,
    goal_node: u32,
    edge: Option<Edge>,
    /// Edges given up in this episode.
    given_up: Vec<(u32, u32)>,
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
        low: (low::Policy, Vec<f32>),
        high: (high::Policy, Vec<f32>),
    ) -> Option<Self> {
        let fits = low.1.len() == low.0.mlp().parameters()
            && high.1.len() == high.0.mlp().parameters()
            && high.0.mlp().outputs() == graph.len()
            && graph.latent_dim == encoder.latent()
            && low.0.mlp().inputs() == EGOCENTRIC + 1 + encoder.latent()
            && !graph.is_empty();
        fits.then(|| Self {
            low_workspace: low.0.mlp().workspace(1),
            high_workspace: high.0.mlp().workspace(1),
            goal_latent: vec![0.0; encoder.latent()],
            settings,
            encoder,
            graph,
            low,
            high,
            input: vec![],
            latent: vec![],
            goal: [0.0; 2],
            goal_node: 0,
            edge: None,
            given_up: vec![],
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

    /// Begins an episode towards a goal (m).
    pub fn begin(&mut self, goal: [f32; 2]) {
        self.goal = goal;
        self.goal_latent = self.encoder.encode_one(goal).to_vec();
        self.goal_node = self.graph.nearest(&self.goal_latent).unwrap_or(0);
        self.edge = None;
        self.given_up.clear();
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
            self.edge = None;
        }
        let to_goal = (self.goal[0] - place[0]).hypot(self.goal[1] - place[1]);
        let at_goal = node == self.goal_node || to_goal <= self.settings.goal_radius;
        let mut chosen = None;
        if at_goal {
            self.edge = None;
        } else if self.edge.is_none() {
            chosen = self.choose(node, choosing, rng);
        } else if let Some(edge) = &mut self.edge {
            edge.steps += 1;
        }
        let subgoal = if at_goal {
            None
        } else {
            self.edge.map(|edge| edge.to)
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
        self.input.clear();
        let (policy, weights) = &self.low;
        let frame = policy.input(observation, &self.latent, target, &mut self.input);
        let mean = policy.act(weights, &self.input, 1, &mut self.low_workspace);
        let action = frame.to_actuators(mean);
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
        let edge = self.edge?;
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
        let steps = self
            .graph
            .edge(node, to)
            .map_or(1.0, |edge| edge.mean_steps);
        let limit = (self.settings.timeout_factor * steps).ceil() as usize;
        // Short edges too need the time to turn round.
        let limit = limit.max(15).min(self.settings.max_edge_steps);
        self.edge = Some(Edge {
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
        self.input.clear();
        let (policy, weights) = &self.high;
        policy.input(self.graph.latent(node), &self.goal_latent, &mut self.input);
        let logits = policy.logits(weights, &self.input, 1, &mut self.high_workspace);
        let masked = Masked::new(logits, &self.allowed)?;
        let picked = match choosing {
            Choosing::Sampled => masked.sample(rng),
            Choosing::Greedy => masked.best(),
        };
        let nodes = self.allowed.iter().map(|to| *to as u32);
        let probabilities = nodes.zip(masked.probabilities()).collect();
        Some((
            self.allowed[picked] as u32,
            masked.log_prob(picked),
            probabilities,
        ))
    }
}
