//! The topics of a trace.

use foxglove::messages::{
    FrameTransforms, Log, PointCloud, PoseInFrame, PosesInFrame, SceneUpdate,
};
use foxglove::{Encode, Schema};

use crate::message::{self, Choice, EdgeOutcome, End, Start, Step};

/// What a message is about.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Topic {
    Maze,
    Ant,
    ChoiceScene,
    Graph,
    Nodes,
    Structure,
    WallPoints,
    AntPoints,
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
        Self::Ant,
        Self::ChoiceScene,
        Self::Graph,
        Self::Nodes,
        Self::Structure,
        Self::WallPoints,
        Self::AntPoints,
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
            Self::Ant => "/scene/ant",
            Self::ChoiceScene => "/scene/choice",
            Self::Graph => "/graph",
            Self::Nodes => "/graph/nodes",
            Self::Structure => "/graph/structure",
            Self::WallPoints => "/points/walls",
            Self::AntPoints => "/points/ant",
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

    pub(crate) fn schema(self) -> Option<Schema> {
        match self {
            Self::Maze | Self::Ant | Self::ChoiceScene | Self::Graph => SceneUpdate::get_schema(),
            Self::Nodes | Self::Path => PosesInFrame::get_schema(),
            Self::Structure => Some(message::Graph::schema()),
            Self::WallPoints | Self::AntPoints => PointCloud::get_schema(),
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
}
