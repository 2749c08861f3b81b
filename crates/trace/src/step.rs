//! The numbers of a control step: what a caller gives, and the message of the file.

use std::borrow::Cow;

use foxglove::Schema;
use prost::Message;
use prost_types::field_descriptor_proto::{Label, Type};
use prost_types::{
    DescriptorProto, FieldDescriptorProto, FileDescriptorProto, FileDescriptorSet, Timestamp,
};

/// The numbers of one control step, as a caller gives them.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct StepMessage {
    /// Control step in the episode.
    pub step: u32,
    /// Reward after the action.
    pub reward: f32,
    /// Distance of the torso to the goal (m).
    pub goal_distance: f32,
    /// Distance of the torso to the subgoal (m).
    pub subgoal_distance: f32,
    /// The ant's node, -1 for none.
    pub node: i32,
    /// The chosen node, -1 for none or the goal itself.
    pub subgoal_node: i32,
    /// Version of the low-level weights.
    pub low_version: u64,
    /// Version of the high-level weights.
    pub high_version: u64,
    /// Version of the graph.
    pub graph_version: u64,
    /// The observation before the action, 29 values.
    pub observation: Vec<f32>,
    /// The action, 8 values.
    pub action: Vec<f32>,
    /// Neighbours of the node that the last choice was made at.
    pub neighbours: Vec<u32>,
    /// Their probabilities.
    pub probabilities: Vec<f32>,
}

/// One step: its numbers, where the bodies are, and where the ant is to go.
#[derive(Debug, Clone, Default)]
pub struct StepRecord {
    /// The numbers.
    pub message: StepMessage,
    /// Poses of the nine bodies: x, y, z (m), quaternion w, x, y, z.
    pub bodies: [[f32; 7]; 9],
    /// The goal (m).
    pub goal: [f32; 2],
    /// The subgoal (m).
    pub subgoal: [f32; 2],
}

/// `formica.Step`, the message of `/step`. Tags are for ever: old traces are read by them.
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
    /// Value of the state as last told to the writer, NaN before.
    #[prost(float, tag = "5")]
    pub value: f32,
    /// Distance of the torso to the goal (m).
    #[prost(float, tag = "6")]
    pub goal_distance: f32,
    /// Distance of the torso to the subgoal (m).
    #[prost(float, tag = "7")]
    pub subgoal_distance: f32,
    /// The ant's node, -1 for none.
    #[prost(int32, tag = "8")]
    pub node: i32,
    /// The chosen node, -1 for none or the goal itself.
    #[prost(int32, tag = "9")]
    pub subgoal_node: i32,
    /// Version of the low-level weights.
    #[prost(uint64, tag = "10")]
    pub low_version: u64,
    /// Version of the high-level weights.
    #[prost(uint64, tag = "11")]
    pub high_version: u64,
    /// Version of the graph.
    #[prost(uint64, tag = "12")]
    pub graph_version: u64,
    /// The observation before the action, 29 values.
    #[prost(float, repeated, tag = "13")]
    pub observation: Vec<f32>,
    /// The action, 8 values.
    #[prost(float, repeated, tag = "14")]
    pub action: Vec<f32>,
    /// Neighbours of the node that the last choice was made at.
    #[prost(uint32, repeated, tag = "15")]
    pub neighbours: Vec<u32>,
    /// Their probabilities.
    #[prost(float, repeated, tag = "16")]
    pub probabilities: Vec<f32>,
    /// The goal: x, y (m).
    #[prost(float, repeated, tag = "17")]
    pub goal: Vec<f32>,
    /// The subgoal: x, y (m).
    #[prost(float, repeated, tag = "18")]
    pub subgoal: Vec<f32>,
}

/// Names and types of the scalar and repeated fields with tags 2 and on.
const FIELDS: [(&str, Type, Label); 17] = [
    ("step", Type::Uint32, Label::Optional),
    ("reward", Type::Float, Label::Optional),
    ("return", Type::Float, Label::Optional),
    ("value", Type::Float, Label::Optional),
    ("goal_distance", Type::Float, Label::Optional),
    ("subgoal_distance", Type::Float, Label::Optional),
    ("node", Type::Int32, Label::Optional),
    ("subgoal_node", Type::Int32, Label::Optional),
    ("low_version", Type::Uint64, Label::Optional),
    ("high_version", Type::Uint64, Label::Optional),
    ("graph_version", Type::Uint64, Label::Optional),
    ("observation", Type::Float, Label::Repeated),
    ("action", Type::Float, Label::Repeated),
    ("neighbours", Type::Uint32, Label::Repeated),
    ("probabilities", Type::Float, Label::Repeated),
    ("goal", Type::Float, Label::Repeated),
    ("subgoal", Type::Float, Label::Repeated),
];

fn field(name: &str, tag: i32, kind: Type, label: Label) -> FieldDescriptorProto {
    FieldDescriptorProto {
        name: Some(name.to_owned()),
        number: Some(tag),
        r#type: Some(kind as i32),
        label: Some(label as i32),
        ..FieldDescriptorProto::default()
    }
}

fn file(
    name: &str,
    package: &str,
    message: &str,
    fields: Vec<FieldDescriptorProto>,
) -> FileDescriptorProto {
    FileDescriptorProto {
        name: Some(name.to_owned()),
        package: Some(package.to_owned()),
        message_type: vec![DescriptorProto {
            name: Some(message.to_owned()),
            field: fields,
            ..DescriptorProto::default()
        }],
        syntax: Some("proto3".to_owned()),
        ..FileDescriptorProto::default()
    }
}

impl Step {
    /// The schema of `/step`: a whole descriptor set, its import included, as readers need it.
    pub(crate) fn schema() -> Schema {
        const TIMESTAMP: &str = "google/protobuf/timestamp.proto";
        let timestamp = file(
            TIMESTAMP,
            "google.protobuf",
            "Timestamp",
            vec![
                field("seconds", 1, Type::Int64, Label::Optional),
                field("nanos", 2, Type::Int32, Label::Optional),
            ],
        );
        let mut first = field("timestamp", 1, Type::Message, Label::Optional);
        first.type_name = Some(".google.protobuf.Timestamp".to_owned());
        let rest = (2..)
            .zip(FIELDS)
            .map(|(tag, (name, kind, label))| field(name, tag, kind, label));
        let fields = std::iter::once(first).chain(rest).collect();
        let mut step = file("formica/step.proto", "formica", "Step", fields);
        step.dependency.push(TIMESTAMP.to_owned());
        let set = FileDescriptorSet {
            file: vec![timestamp, step],
        };
        Schema {
            name: "formica.Step".to_owned(),
            encoding: "protobuf".to_owned(),
            data: Cow::Owned(set.encode_to_vec()),
        }
    }

    pub(crate) fn new(record: &StepRecord, time: u64, return_so_far: f32, value: f32) -> Self {
        let second = 1_000_000_000;
        let m = record.message.clone();
        Self {
            timestamp: Some(Timestamp {
                seconds: (time / second) as i64,
                nanos: (time % second) as i32,
            }),
            step: m.step,
            reward: m.reward,
            return_so_far,
            value,
            goal_distance: m.goal_distance,
            subgoal_distance: m.subgoal_distance,
            node: m.node,
            subgoal_node: m.subgoal_node,
            low_version: m.low_version,
            high_version: m.high_version,
            graph_version: m.graph_version,
            observation: m.observation,
            action: m.action,
            neighbours: m.neighbours,
            probabilities: m.probabilities,
            goal: record.goal.to_vec(),
            subgoal: record.subgoal.to_vec(),
        }
    }
}
