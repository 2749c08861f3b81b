//! Schemas of Formica's own messages: whole descriptor sets, as readers need them.

use std::borrow::Cow;

use foxglove::Schema;
use prost::Message;
use prost_types::descriptor_proto::ReservedRange;
use prost_types::field_descriptor_proto::{Label, Type};
use prost_types::{DescriptorProto, FieldDescriptorProto, FileDescriptorProto, FileDescriptorSet};

use super::{Choice, EdgeOutcome, End, Graph, Start, Step};

/// A field after the timestamp: its tag, name and type, and whether it is repeated.
type Field = (i32, &'static str, Type, bool);

const START: &[Field] = &[
    (2, "state", Type::Float, true),
    (3, "exits", Type::Uint64, false),
    (4, "simulator_state", Type::Bytes, false),
    (5, "version_names", Type::String, true),
    (6, "versions", Type::Uint64, true),
];

const GRAPH: &[Field] = &[
    (2, "x", Type::Float, true),
    (3, "y", Type::Float, true),
    (4, "from", Type::Uint32, true),
    (5, "to", Type::Uint32, true),
];

const STEP: &[Field] = &[
    (2, "step", Type::Uint32, false),
    (3, "reward", Type::Float, false),
    (4, "return", Type::Float, false),
    (5, "value", Type::Float, false),
    (6, "goal_distance", Type::Float, false),
    (7, "subgoal_distance", Type::Float, false),
    (8, "node", Type::Int32, false),
    (9, "subgoal_node", Type::Int32, false),
    (13, "observation", Type::Float, true),
    (14, "action", Type::Float, true),
    (15, "observation_bytes", Type::Bytes, false),
];

const CHOICE: &[Field] = &[
    (2, "step", Type::Uint32, false),
    (3, "node", Type::Int32, false),
    (4, "goal_node", Type::Int32, false),
    (5, "subgoal_node", Type::Int32, false),
    (6, "value", Type::Float, false),
    (7, "neighbours", Type::Uint32, true),
    (8, "probabilities", Type::Float, true),
];

const OUTCOME: &[Field] = &[
    (2, "step", Type::Uint32, false),
    (3, "node", Type::Int32, false),
    (4, "subgoal_node", Type::Int32, false),
    (5, "reached", Type::Bool, false),
    (6, "steps", Type::Uint32, false),
];

const END: &[Field] = &[
    (2, "steps", Type::Uint32, false),
    (3, "success", Type::Bool, false),
    (4, "fell", Type::Bool, false),
    (5, "observation", Type::Float, true),
    (6, "observation_bytes", Type::Bytes, false),
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
    // Tags that are left out were those of older versions, and are for no other field.
    let tags = fields.iter().filter_map(|field| field.number);
    let reserved = tags
        .clone()
        .zip(tags.skip(1))
        .filter(|(tag, next)| tag + 1 < *next);
    let reserved = reserved.map(|(tag, next)| ReservedRange {
        start: Some(tag + 1),
        end: Some(next),
    });
    FileDescriptorProto {
        name: Some(name.to_owned()),
        package: Some(package.to_owned()),
        message_type: vec![DescriptorProto {
            name: Some(message.to_owned()),
            reserved_range: reserved.collect(),
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
    let rest = fields
        .iter()
        .map(|(tag, name, kind, repeated)| field(name, *tag, *kind, *repeated));
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

#[cfg(test)]
mod tests {
    use prost::encoding::{WireType, decode_key};

    use super::*;
    use crate::message::timestamp;

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

    fn described(fields: &[Field]) -> Vec<(u32, WireType)> {
        let first = std::iter::once((1, WireType::LengthDelimited));
        let rest = fields.iter().map(|(tag, _, kind, repeated)| {
            let kind = match kind {
                Type::Bytes => WireType::LengthDelimited,
                _ if *repeated => WireType::LengthDelimited,
                Type::Float => WireType::ThirtyTwoBit,
                _ => WireType::Varint,
            };
            (*tag as u32, kind)
        });
        first.chain(rest).collect()
    }

    #[test]
    fn tags_of_older_versions_are_reserved() {
        let set = FileDescriptorSet::decode(&*Step::schema().data).unwrap();
        let step = &set.file[1].message_type[0];
        let reserved = [ReservedRange {
            start: Some(10),
            end: Some(13),
        }];
        assert_eq!(step.reserved_range, reserved);
    }

    #[test]
    fn descriptors_describe_the_fields_as_they_are_encoded() {
        let timestamp = Some(timestamp(1));
        let start = Start {
            timestamp,
            state: vec![1.0],
            exits: 1,
            simulator_state: vec![1],
            version_names: vec!["low".to_owned()],
            versions: vec![1],
        };
        assert_eq!(keys(&start), described(START));
        let graph = Graph {
            timestamp,
            x: vec![1.0],
            y: vec![1.0],
            from: vec![1],
            to: vec![1],
        };
        assert_eq!(keys(&graph), described(GRAPH));
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
            observation: vec![1.0],
            action: vec![1.0],
            observation_bytes: vec![1],
        };
        assert_eq!(keys(&step), described(STEP));
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
        assert_eq!(keys(&choice), described(CHOICE));
        let outcome = EdgeOutcome {
            timestamp,
            step: 1,
            node: 1,
            subgoal_node: 1,
            reached: true,
            steps: 1,
        };
        assert_eq!(keys(&outcome), described(OUTCOME));
        let end = End {
            timestamp,
            steps: 1,
            success: true,
            fell: true,
            observation: vec![1.0],
            observation_bytes: vec![1],
        };
        assert_eq!(keys(&end), described(END));
    }
}
