//! Formica's own messages. Tags are for ever: old traces are read by them.

mod schema;

use prost::Message;
use prost_types::Timestamp;

/// `formica.Start`, the message of `/start`: with it and the actions the episode can be simulated
/// again.
#[derive(Clone, PartialEq, Message)]
pub struct Start {
    /// Start of the episode.
    #[prost(message, optional, tag = "1")]
    pub timestamp: Option<Timestamp>,
    /// In traces without [`simulator_state`](Self::simulator_state), which are older and of the ant:
    /// positions and velocities that it was set to, 29 values, the quaternion not normalised.
    #[prost(float, repeated, tag = "2")]
    pub state: Vec<f32>,
    /// In such traces, seed of the choice of teleports' outlets.
    #[prost(uint64, tag = "3")]
    pub exits: u64,
    /// The simulator's state, as it restores it; empty if it could not be saved.
    #[prost(bytes = "vec", tag = "4")]
    pub simulator_state: Vec<u8>,
    /// Names of the versions that the episode is played with.
    #[prost(string, repeated, tag = "5")]
    pub version_names: Vec<String>,
    /// The versions themselves.
    #[prost(uint64, repeated, tag = "6")]
    pub versions: Vec<u64>,
}

/// `formica.Graph`, the message of `/graph/structure`.
#[derive(Clone, PartialEq, Message)]
pub struct Graph {
    /// Start of the episode.
    #[prost(message, optional, tag = "1")]
    pub timestamp: Option<Timestamp>,
    /// Places of the nodes: x (m).
    #[prost(float, repeated, tag = "2")]
    pub x: Vec<f32>,
    /// And y (m).
    #[prost(float, repeated, tag = "3")]
    pub y: Vec<f32>,
    /// Edges: the node that each leads from.
    #[prost(uint32, repeated, tag = "4")]
    pub from: Vec<u32>,
    /// And to.
    #[prost(uint32, repeated, tag = "5")]
    pub to: Vec<u32>,
}

/// `formica.Step`, the message of `/step`: the state before the action, and what came of it.
#[derive(Clone, PartialEq, Message)]
pub struct Step {
    /// Start of the episode plus simulated time.
    #[prost(message, optional, tag = "1")]
    pub timestamp: Option<Timestamp>,
    /// Control step in the episode.
    #[prost(uint32, tag = "2")]
    pub step: u32,
    /// Reward after the action.
    #[prost(float, tag = "3")]
    pub reward: f32,
    /// Undiscounted sum of the rewards so far, this one included; `return` in the file.
    #[prost(float, tag = "4")]
    pub return_so_far: f32,
    /// Value of the last choice's node towards the goal, by the high level's critic; NaN before
    /// the first choice and where there is no critic.
    #[prost(float, tag = "5")]
    pub value: f32,
    /// Distance of the body to the goal (m).
    #[prost(float, tag = "6")]
    pub goal_distance: f32,
    /// Distance of the body to the subgoal (m); NaN without one.
    #[prost(float, tag = "7")]
    pub subgoal_distance: f32,
    /// The node that the body is at, -1 for none.
    #[prost(int32, tag = "8")]
    pub node: i32,
    /// The node moved towards, -1 for none.
    #[prost(int32, tag = "9")]
    pub subgoal_node: i32,
    // Tags 10 to 12 were versions of weights and graph, which are in the metadata now.
    /// The observation before the action, where it is floats.
    #[prost(float, repeated, tag = "13")]
    pub observation: Vec<f32>,
    /// The action.
    #[prost(float, repeated, tag = "14")]
    pub action: Vec<f32>,
    /// The observation before the action, where it is bytes, as of an image; its shape is that of
    /// `spaces` in the metadata.
    #[prost(bytes = "vec", tag = "15")]
    pub observation_bytes: Vec<u8>,
}

/// `formica.Choice`, the message of `/choice`: the high level at work.
#[derive(Clone, PartialEq, Message)]
pub struct Choice {
    /// Start of the episode plus simulated time.
    #[prost(message, optional, tag = "1")]
    pub timestamp: Option<Timestamp>,
    /// Control step in the episode.
    #[prost(uint32, tag = "2")]
    pub step: u32,
    /// Node of the choice.
    #[prost(int32, tag = "3")]
    pub node: i32,
    /// The goal's node.
    #[prost(int32, tag = "4")]
    pub goal_node: i32,
    /// The node moved towards: the chosen neighbour, or one further along the plan.
    #[prost(int32, tag = "5")]
    pub subgoal_node: i32,
    /// Value of the node towards the goal, by the high level's critic; NaN without one.
    #[prost(float, tag = "6")]
    pub value: f32,
    /// Neighbours of the node that were open.
    #[prost(uint32, repeated, tag = "7")]
    pub neighbours: Vec<u32>,
    /// Their probabilities.
    #[prost(float, repeated, tag = "8")]
    pub probabilities: Vec<f32>,
}

/// `formica.EdgeOutcome`, the message of `/outcome`: what became of a choice.
#[derive(Clone, PartialEq, Message)]
pub struct EdgeOutcome {
    /// Start of the episode plus simulated time.
    #[prost(message, optional, tag = "1")]
    pub timestamp: Option<Timestamp>,
    /// Control step in the episode.
    #[prost(uint32, tag = "2")]
    pub step: u32,
    /// Node of the choice.
    #[prost(int32, tag = "3")]
    pub node: i32,
    /// The node moved towards.
    #[prost(int32, tag = "4")]
    pub subgoal_node: i32,
    /// Whether it was reached, or else given up.
    #[prost(bool, tag = "5")]
    pub reached: bool,
    /// Control steps since the choice.
    #[prost(uint32, tag = "6")]
    pub steps: u32,
}

/// `formica.End`, the message of `/end`.
#[derive(Clone, PartialEq, Message)]
pub struct End {
    /// Start of the episode plus simulated time.
    #[prost(message, optional, tag = "1")]
    pub timestamp: Option<Timestamp>,
    /// Control steps of the episode.
    #[prost(uint32, tag = "2")]
    pub steps: u32,
    /// Whether the goal was reached.
    #[prost(bool, tag = "3")]
    pub success: bool,
    /// Whether the body has fallen.
    #[prost(bool, tag = "4")]
    pub fell: bool,
    /// The observation after the last action, where it is floats.
    #[prost(float, repeated, tag = "5")]
    pub observation: Vec<f32>,
    /// The observation after the last action, where it is bytes.
    #[prost(bytes = "vec", tag = "6")]
    pub observation_bytes: Vec<u8>,
}

/// A time (ns since 1970) as protobuf has it.
pub(crate) fn timestamp(time: u64) -> Timestamp {
    let second = 1_000_000_000;
    Timestamp {
        seconds: (time / second) as i64,
        nanos: (time % second) as i32,
    }
}
