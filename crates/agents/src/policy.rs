//! What an actor runs.

use graph::Graph;
use rand_pcg::Pcg64Mcg;
use simulator::Values;

/// What an episode is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Mode {
    /// To learn from: the policy's distributions are sampled.
    Explore,
    /// For a score: the most likely actions and choices.
    Exploit,
}

/// How a choice on the graph ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Outcome {
    /// Node of the choice.
    pub from: u32,
    /// Chosen node.
    pub to: u32,
    /// Whether it was reached, or else given up.
    pub reached: bool,
}

/// A choice just made on the graph, to be traced.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Choosing {
    /// Value of the node towards the goal; NaN where nobody estimates it.
    pub value: f32,
    /// The nodes chosen among, and their probabilities.
    pub probabilities: Vec<(u32, f32)>,
}

/// What a policy does in one step. An actor uses one for all steps, so that buffers are kept.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Act {
    /// The action, to be clipped by the simulator.
    pub action: Vec<f32>,
    /// Its log-probability; 0 where the policy is not sampled.
    pub log_prob: f32,
    /// Records of the choices that ended at this step, see [`push_record`](crate::push_record).
    pub choices: Vec<u32>,
    /// The place headed for (m).
    pub target: Option<[f32; 2]>,
    /// The graph's node that the body is at.
    pub node: Option<u32>,
    /// The node headed for; none where it is the goal itself.
    pub subgoal: Option<u32>,
    /// The goal's node.
    pub goal_node: Option<u32>,
    /// How a choice on the graph ended at this step.
    pub outcome: Option<Outcome>,
    /// Whether a choice was made at this step; [`Policy::choosing`] tells more.
    pub chosen: bool,
}

impl Act {
    /// Forgets a step and keeps the buffers.
    pub fn clear(&mut self) {
        self.action.clear();
        self.choices.clear();
        *self = Self {
            action: std::mem::take(&mut self.action),
            choices: std::mem::take(&mut self.choices),
            ..Self::default()
        };
    }
}

/// A policy of some versions of an algorithm's parts.
pub trait Policy: Send {
    /// Begins an episode.
    fn begin(&mut self, goal: &[f32], mode: Mode);

    /// Takes another goal within an episode, where the task changes it.
    fn aim(&mut self, _goal: &[f32]) {}

    /// Decides on an action. `act` is clear.
    fn act(&mut self, observation: Values<'_>, rng: &mut Pcg64Mcg, act: &mut Act);

    /// Ends an episode after its last action: appends the record of a choice that ended with it.
    fn end(&mut self, _success: bool, _choices: &mut Vec<u32>) {}

    /// The graph acted on.
    fn graph(&self) -> Option<&Graph> {
        None
    }

    /// More of the last choice, to be traced.
    fn choosing(&mut self) -> Choosing {
        Choosing::default()
    }
}
