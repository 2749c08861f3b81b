//! Formica's own messages. Tags are for ever: old traces are read by them.

use std::borrow::Cow;

use foxglove::Schema;
use prost::Message;
use prost_types::field_descriptor_proto::{Label, Type};
use prost_types::{
    DescriptorProto, FieldDescriptorProto, FileDescriptorProto, FileDescriptorSet, Timestamp,
};

/// `formica.Start`, the message of `/start`: with it and the actions the episode can be simulated
/// again.
#[derive(Clone, PartialEq, Message)]
pub struct Start {
    /// Start of the episode.
    #[prost(message, optional, tag = "1")]
    pub timestamp: Option<Timestamp>,
    /// Positions and velocities that the ant was set to, 29 values; its quaternion is not
    /// normalised.
    #[prost(float, repeated, tag = "2")]
    pub state: Vec<f32>,
    /// Seed of the choice of teleports' outlets.
    #[prost(uint64, tag = "3")]
    pub exits: u64,
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
    /// Distance of the torso to the goal (m).
    #[prost(float, tag = "6")]
    pub goal_distance: f32,
    /// Distance of the torso to the subgoal (m).
    #[prost(float, tag = "7")]
    pub subgoal_distance: f32,
    /// The ant's node, -1 for none.
    #[prost(int32, tag = "8")]
    pub node: i32,
    /// The node walked to, -1 for the goal itself.
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
    /// The node walked to: the chosen neighbour, or one further along the plan.
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
    /// The node walked to.
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
    /// Whether the ant lies on its back.
    #[prost(bool, tag = "4")]
    pub fell: bool,
    /// The observation after the last action, 29 values.
    #[prost(float, repeated, tag = "5")]
    pub observation: Vec<f32>,
}

/// A field after the timestamp: its name and type, and whether it is repeated.
type Field = (&'static str, Type, bool);

const START: &[Field] = &[("state", Type::Float, true), ("exits", Type::Uint64, false)];

const GRAPH: &[Field] = &[
    ("x", Type::Float, true),
    ("y", Type::Float, true),
    ("from", Type::Uint32, true),
    ("to", Type::Uint32, true),
];

const STEP: &[Field] = &[
    ("step", Type::Uint32, false),
    ("reward", Type::Float, false),
    ("return", Type::Float, false),
    ("value", Type::Float, false),
    ("goal_distance", Type::Float, false),
    ("subgoal_distance", Type::Float, false),
    ("node", Type::Int32, false),
    ("subgoal_node", Type::Int32, false),
    ("low_version", Type::Uint64, false),
    ("high_version", Type::Uint64, false),
    ("graph_version", Type::Uint64, false),
    ("observation", Type::Float, true),
    ("action", Type::Float, true),
];

const CHOICE: &[Field] = &[
    ("step", Type::Uint32, false),
    ("node", Type::Int32, false),
    ("goal_node", Type::Int32, false),
    ("subgoal_node", Type::Int32, false),
    ("value", Type::Float, false),
    ("neighbours", Type::Uint32, true),
    ("probabilities", Type::Float, true),
];

const OUTCOME: &[Field] = &[
    ("step", Type::Uint32, false),
    ("node", Type::Int32, false),
    ("subgoal_node", Type::Int32, false),
    ("reached", Type::Bool, false),
    ("steps", Type::Uint32, false),
];

const END: &[Field] = &[
    ("steps", Type::Uint32, false),
    ("success", Type::Bool, false),
    ("fell", Type::Bool, false),
    ("observation", Type::Float, true),
];

fn field(name: &str, tag: i32, kind: Type, repeated: bool) -> FieldDescriptorProto {
    let label = if repeated {
        Label::Repeated
    } else {
        Label::Optional
    };
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

/// A schema as a whole descriptor set, its import included, as readers need it.
fn schema(message: &str, fields: &[Field]) -> Schema {
    const TIMESTAMP: &str = "google/protobuf/timestamp.proto";
    let timestamp = file(
        TIMESTAMP,
        "google.protobuf",
        "Timestamp",
        vec![
            field("seconds", 1, Type::Int64, false),
            field("nanos", 2, Type::Int32, false),
        ],
    );
    let mut first = field("timestamp", 1, Type::Message, false);
    first.type_name = Some(".google.protobuf.Timestamp".to_owned());
    let rest = (2..)
        .zip(fields)
        .map(|(tag, (name, kind, repeated))| field(name, tag, *kind, *repeated));
    let fields = std::iter::once(first).chain(rest).collect();
    let path = format!("formica/{message}.proto");
    let mut own = file(&path, "formica", message, fields);
    own.dependency.push(TIMESTAMP.to_owned());
    let set = FileDescriptorSet {
        file: vec![timestamp, own],
    };
    Schema {
        name: format!("formica.{message}"),
        encoding: "protobuf".to_owned(),
        data: Cow::Owned(set.encode_to_vec()),
    }
}

impl Start {
    pub(crate) fn schema() -> Schema {
        schema("Start", START)
    }
}

impl Graph {
    pub(crate) fn schema() -> Schema {
        schema("Graph", GRAPH)
    }
}

impl Step {
    pub(crate) fn schema() -> Schema {
        schema("Step", STEP)
    }
}

impl Choice {
    pub(crate) fn schema() -> Schema {
        schema("Choice", CHOICE)
    }
}

impl EdgeOutcome {
    pub(crate) fn schema() -> Schema {
        schema("EdgeOutcome", OUTCOME)
    }
}

impl End {
    pub(crate) fn schema() -> Schema {
        schema("End", END)
    }
}

/// A time (ns since 1970) as protobuf has it.
pub(crate) fn timestamp(time: u64) -> Timestamp {
    let second = 1_000_000_000;
    Timestamp {
        seconds: (time / second) as i64,
        nanos: (time % second) as i32,
    }
}

#[cfg(test)]
mod tests {
    use prost::encoding::{WireType, decode_key};

    use super::*;

    /// Tags and wire types of a message as it is encoded.
    fn keys(message: &impl Message) -> Vec<(u32, WireType)> {
        let bytes = message.encode_to_vec();
        let mut rest = &bytes[..];
        let mut keys = vec![];
        while !rest.is_empty() {
            let (tag, kind) = decode_key(&mut rest).unwrap();
            keys.push((tag, kind));
            let context = prost::encoding::DecodeContext::default();
            prost::encoding::skip_field(kind, tag, &mut rest, context).unwrap();
        }
        keys
    }

    fn told(fields: &[Field]) -> Vec<(u32, WireType)> {
        let first = std::iter::once((1, WireType::LengthDelimited));
        let rest = (2..).zip(fields).map(|(tag, (_, kind, repeated))| {
            let kind = match kind {
                _ if *repeated => WireType::LengthDelimited,
                Type::Float => WireType::ThirtyTwoBit,
                _ => WireType::Varint,
            };
            (tag, kind)
        });
        first.chain(rest).collect()
    }

    #[test]
    fn descriptors_tell_the_fields_as_they_are_encoded() {
        let timestamp = Some(timestamp(1));
        let start = Start {
            timestamp,
            state: vec![1.0],
            exits: 1,
        };
        assert_eq!(keys(&start), told(START));
        let graph = Graph {
            timestamp,
            x: vec![1.0],
            y: vec![1.0],
            from: vec![1],
            to: vec![1],
        };
        assert_eq!(keys(&graph), told(GRAPH));
        let step = Step {
            timestamp,
            step: 1,
            reward: 1.0,
            return_so_far: 1.0,
            value: 1.0,
            goal_distance: 1.0,
            subgoal_distance: 1.0,
            node: 1,
            subgoal_node: 1,
            low_version: 1,
            high_version: 1,
            graph_version: 1,
            observation: vec![1.0],
            action: vec![1.0],
        };
        assert_eq!(keys(&step), told(STEP));
        let choice = Choice {
            timestamp,
            step: 1,
            node: 1,
            goal_node: 1,
            subgoal_node: 1,
            value: 1.0,
            neighbours: vec![1],
            probabilities: vec![1.0],
        };
        assert_eq!(keys(&choice), told(CHOICE));
        let outcome = EdgeOutcome {
            timestamp,
            step: 1,
            node: 1,
            subgoal_node: 1,
            reached: true,
            steps: 1,
        };
        assert_eq!(keys(&outcome), told(OUTCOME));
        let end = End {
            timestamp,
            steps: 1,
            success: true,
            fell: true,
            observation: vec![1.0],
        };
        assert_eq!(keys(&end), told(END));
    }
}
