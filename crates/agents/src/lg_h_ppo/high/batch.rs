//! Choices on their way into an update.

use graph::Graph;
use serde::{Deserialize, Serialize};

use super::Settings;
use crate::lg_h_ppo::choice::Choice;
use crate::ppo::End;

/// One choice of a walk, in the physics or on the graph.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Step {
    pub(super) node: u32,
    pub(super) goal: u32,
    pub(super) subgoal: u32,
    pub(super) log_prob: f32,
    pub(super) reward: f32,
    /// In edges of mean length: what takes longer is discounted by more, or else walks that
    /// dither on short edges would look cheap.
    pub(super) duration: f32,
    pub(super) end: End,
    /// Neighbours that the choice could not fall on.
    pub(super) excluded: Vec<u32>,
}

#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Batch {
    pub(super) steps: Vec<Step>,
    pub(super) records: Vec<usize>,
    /// Node after each record's last choice, and its goal.
    pub(super) finals: Vec<(u32, u32)>,
}

impl Batch {
    /// Appends the choices of one rollout in the physics. A rollout with a choice that the graph
    /// does not hold is left out.
    pub(super) fn add_rollout(&mut self, settings: &Settings, graph: &Graph, choices: &[Choice]) {
        let nodes = graph.len() as u32;
        let known = |c: &Choice| {
            let open = !c.excluded.contains(&c.subgoal) && graph.edge(c.node, c.subgoal).is_some();
            c.node < nodes && c.goal < nodes && c.next < nodes && open
        };
        // What follows the goal's node belongs to no walk there.
        let end = choices.iter().position(Choice::arrived);
        let choices = &choices[..end.map_or(choices.len(), |end| end + 1)];
        let Some(last) = choices.last().filter(|_| choices.iter().all(known)) else {
            return;
        };
        for (i, c) in choices.iter().enumerate() {
            let steps = c.steps as f32;
            self.steps.push(Step {
                node: c.node,
                goal: c.goal,
                subgoal: c.subgoal,
                log_prob: c.log_prob,
                reward: reward(settings, graph, steps, c.arrived()),
                duration: duration(graph, steps),
                end: if c.arrived() {
                    End::Terminal
                } else if i + 1 == choices.len() {
                    End::Truncated
                } else {
                    End::Not
                },
                excluded: c.excluded.clone(),
            });
        }
        self.records.push(choices.len());
        self.finals.push((last.next, last.goal));
    }

    /// Appends another batch and empties it.
    pub(super) fn append(&mut self, other: &mut Self) {
        self.steps.append(&mut other.steps);
        self.records.append(&mut other.records);
        self.finals.append(&mut other.finals);
    }

    /// Forgets all and keeps the memory.
    pub(super) fn clear(&mut self) {
        self.steps.clear();
        self.records.clear();
        self.finals.clear();
    }

    /// Whether it is whole, and of a graph of so many nodes.
    pub(super) fn is_sound(&self, nodes: u32) -> bool {
        let known = |c: &Step| c.node < nodes && c.goal < nodes && c.subgoal < nodes;
        let last = |(node, goal): &(u32, u32)| *node < nodes && *goal < nodes;
        self.steps.iter().all(known)
            && self.finals.iter().all(last)
            && self.records.len() == self.finals.len()
            && self.records.iter().sum::<usize>() == self.steps.len()
    }
}

/// Reward of one choice: the cost of its steps, as many as an edge's mean ones cost one edge, and
/// the arrival's gain.
pub(super) fn reward(settings: &Settings, graph: &Graph, steps: f32, arrived: bool) -> f32 {
    let cost = settings.edge_cost * duration(graph, steps);
    if arrived {
        settings.arrival_reward - cost
    } else {
        -cost
    }
}

/// Control steps in edges of mean length.
pub(super) fn duration(graph: &Graph, steps: f32) -> f32 {
    steps / graph.mean_edge_steps.max(1.0)
}
