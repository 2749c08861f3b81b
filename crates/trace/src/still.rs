//! What stands still, encoded once for many episodes: for a graph of thousands of edges that is as
//! much work as all steps of one.

use foxglove::messages::PosesInFrame;
use prost::Message;

use crate::message;
use crate::scene::{Scene, WORLD};
use crate::topic::Topic;

/// A scene and its messages.
#[derive(Debug)]
pub struct Still {
    pub(crate) scene: Scene,
    /// Each lacks what differs between episodes: time, goal. Fields may follow in any order in
    /// protobuf, and repeated ones add up, so that it is put behind.
    messages: Vec<(Topic, Vec<u8>)>,
}

impl Still {
    /// Encodes a scene.
    #[must_use]
    pub fn new(scene: Scene) -> Self {
        let nodes = PosesInFrame {
            frame_id: WORLD.to_owned(),
            poses: scene.node_poses(),
            ..PosesInFrame::default()
        };
        let structure = message::Graph {
            timestamp: None,
            x: scene.nodes.iter().map(|[x, _]| *x).collect(),
            y: scene.nodes.iter().map(|[_, y]| *y).collect(),
            from: scene.edges.iter().map(|(from, _)| *from).collect(),
            to: scene.edges.iter().map(|(_, to)| *to).collect(),
        };
        let mut messages = vec![
            (Topic::Maze, scene.maze().encode_to_vec()),
            (Topic::Body, scene.body().encode_to_vec()),
            (Topic::Graph, scene.graph().encode_to_vec()),
            (Topic::Nodes, nodes.encode_to_vec()),
            (Topic::Structure, structure.encode_to_vec()),
            (Topic::WallPoints, scene.wall_points().encode_to_vec()),
            (Topic::BodyPoints, scene.body_points().encode_to_vec()),
        ];
        messages.retain(|(topic, _)| scene.has(*topic));
        Self { messages, scene }
    }

    pub(crate) fn messages(&self) -> impl Iterator<Item = (Topic, &[u8])> {
        self.messages
            .iter()
            .map(|(topic, bytes)| (*topic, &**bytes))
    }
}
