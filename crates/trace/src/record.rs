//! What whoever plays an episode tells of it.

/// The state before an action, and what came of it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StepRecord {
    /// Control step in the episode.
    pub step: u32,
    /// The observation before the action.
    pub observation: [f32; 29],
    /// The action.
    pub action: [f32; 8],
    /// Reward after the action.
    pub reward: f32,
    /// The ant's node, -1 for none.
    pub node: i32,
    /// The node walked to, -1 for the goal itself.
    pub subgoal_node: i32,
    /// The place walked to (m).
    pub subgoal: [f32; 2],
    /// Poses of the nine bodies: x, y, z (m), quaternion w, x, y, z.
    pub bodies: [[f32; 7]; 9],
}

/// A choice of the high level, told before the step that it was made at.
#[derive(Debug, Clone, PartialEq)]
pub struct ChoiceRecord {
    /// Control step in the episode.
    pub step: u32,
    /// Node of the choice.
    pub node: i32,
    /// The goal's node.
    pub goal_node: i32,
    /// The node walked to.
    pub subgoal_node: i32,
    /// Value of the node towards the goal, NaN where nobody estimates it.
    pub value: f32,
    /// Open neighbours of the node.
    pub neighbours: Vec<u32>,
    /// Their probabilities.
    pub probabilities: Vec<f32>,
}

/// What became of a choice, told before the step that it ended at.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct OutcomeRecord {
    /// Control step in the episode.
    pub step: u32,
    /// Node of the choice.
    pub node: i32,
    /// The node walked to.
    pub subgoal_node: i32,
    /// Whether it was reached.
    pub reached: bool,
}

/// The start as it can be made again.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StartRecord {
    /// Positions and velocities that the ant was set to.
    pub state: [f32; 29],
    /// Seed of the choice of teleports' outlets.
    pub exits: u64,
}

/// The state after the last action.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EndRecord {
    /// Whether the goal was reached.
    pub success: bool,
    /// Whether the ant lies on its back.
    pub fell: bool,
    /// The observation.
    pub observation: [f32; 29],
    /// Poses of the nine bodies.
    pub bodies: [[f32; 7]; 9],
}
