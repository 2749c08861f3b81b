//! The topics of a trace.

use std::collections::BTreeMap;

use foxglove::messages::{
    FrameTransforms, Log, PointCloud, PoseInFrame, PosesInFrame, SceneUpdate,
};
use foxglove::{Encode, Schema};
use mcap::records::Channel;
use prost::Message;

use crate::message::{self, Choice, EdgeOutcome, End, Start, Step};
use crate::scan;

/// Names of topics in traces of older versions, and their names now.
const OLD_NAMES: [(&str, &str); 2] = [
    ("/scene/ant", "/scene/body"),
    ("/points/ant", "/points/body"),
];

/// What a message is about.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Topic {
    Maze,
    Body,
    ChoiceScene,
    Graph,
    Nodes,
    Structure,
    WallPoints,
    BodyPoints,
    Transforms,
    Goal,
    Subgoal,
    Path,
    Start,
    Step,
    Choice,
    Outcome,
    End,
    Log,
}

impl Topic {
    pub(crate) const ALL: [Self; 18] = [
        Self::Maze,
        Self::Body,
        Self::ChoiceScene,
        Self::Graph,
        Self::Nodes,
        Self::Structure,
        Self::WallPoints,
        Self::BodyPoints,
        Self::Transforms,
        Self::Goal,
        Self::Subgoal,
        Self::Path,
        Self::Start,
        Self::Step,
        Self::Choice,
        Self::Outcome,
        Self::End,
        Self::Log,
    ];

    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Maze => "/scene/maze",
            Self::Body => "/scene/body",
            Self::ChoiceScene => "/scene/choice",
            Self::Graph => "/graph",
            Self::Nodes => "/graph/nodes",
            Self::Structure => "/graph/structure",
            Self::WallPoints => "/points/walls",
            Self::BodyPoints => "/points/body",
            Self::Transforms => "/tf",
            Self::Goal => "/goal",
            Self::Subgoal => "/subgoal",
            Self::Path => "/path",
            Self::Start => "/start",
            Self::Step => "/step",
            Self::Choice => "/choice",
            Self::Outcome => "/outcome",
            Self::End => "/end",
            Self::Log => "/log",
        }
    }

    /// Whether it is about the graph.
    pub(crate) fn is_of_graph(self) -> bool {
        use Topic::{Choice, ChoiceScene, Graph, Nodes, Outcome, Structure};
        [Graph, Nodes, Structure, Choice, ChoiceScene, Outcome].contains(&self)
    }

    /// Whether it is about the body's parts.
    pub(crate) fn is_of_body(self) -> bool {
        [Self::Body, Self::BodyPoints, Self::Transforms].contains(&self)
    }

    pub(crate) fn schema(self) -> Option<Schema> {
        match self {
            Self::Maze | Self::Body | Self::ChoiceScene | Self::Graph => SceneUpdate::get_schema(),
            Self::Nodes | Self::Path => PosesInFrame::get_schema(),
            Self::Structure => Some(message::Graph::schema()),
            Self::WallPoints | Self::BodyPoints => PointCloud::get_schema(),
            Self::Transforms => FrameTransforms::get_schema(),
            Self::Goal | Self::Subgoal => PoseInFrame::get_schema(),
            Self::Start => Some(Start::schema()),
            Self::Step => Some(Step::schema()),
            Self::Choice => Some(Choice::schema()),
            Self::Outcome => Some(EdgeOutcome::schema()),
            Self::End => Some(End::schema()),
            Self::Log => Log::get_schema(),
        }
    }

    /// The topic of a channel; none of one that another program wrote, even under the same name.
    pub(crate) fn of(channel: &Channel, schemas: &BTreeMap<u16, scan::Schema>) -> Option<Self> {
        let old = OLD_NAMES.iter().find(|(old, _)| *old == channel.topic);
        let name = old.map_or(&*channel.topic, |(_, name)| name);
        let topic = Self::ALL.into_iter().find(|topic| topic.name() == name)?;
        let schema = schemas.get(&channel.schema_id);
        let same = |told: &scan::Schema| topic.schema().is_some_and(|own| own.name == told.name);
        let own = channel.message_encoding == "protobuf" && schema.is_none_or(same);
        own.then_some(topic)
    }

    /// Whether bytes are a message of the topic.
    pub(crate) fn decodes(self, data: &[u8]) -> bool {
        match self {
            Self::Maze | Self::Body | Self::ChoiceScene | Self::Graph => {
                SceneUpdate::decode(data).is_ok()
            }
            Self::Nodes | Self::Path => PosesInFrame::decode(data).is_ok(),
            Self::Structure => message::Graph::decode(data).is_ok(),
            Self::WallPoints | Self::BodyPoints => PointCloud::decode(data).is_ok(),
            Self::Transforms => FrameTransforms::decode(data).is_ok(),
            Self::Goal | Self::Subgoal => PoseInFrame::decode(data).is_ok(),
            Self::Start => Start::decode(data).is_ok(),
            Self::Step => Step::decode(data).is_ok(),
            Self::Choice => Choice::decode(data).is_ok(),
            Self::Outcome => EdgeOutcome::decode(data).is_ok(),
            Self::End => End::decode(data).is_ok(),
            Self::Log => Log::decode(data).is_ok(),
        }
    }
}
