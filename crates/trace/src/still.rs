//! What stands still, encoded once for many episodes: for a graph of thousands of edges that is as
//! much work as all steps of one.

use foxglove::Encode;
use foxglove::messages::PosesInFrame;
use prost::Message;

use crate::message;
use crate::scene::{self, Scene, WORLD};
use crate::topic::Topic;

/// A scene and its messages.
#[derive(Debug)]
pub struct Still {
    pub(crate) scene: Scene,
    /// Each lacks what differs between episodes: time, goal. Fields may follow in any order in
    /// protobuf, and repeated ones add up, so that it is put behind.
    messages: [(Topic, Vec<u8>); 7],
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
        Self {
            messages: [
                (Topic::Maze, encoded(&scene.maze())),
                (Topic::Ant, encoded(&scene::ant())),
                (Topic::Graph, encoded(&scene.graph())),
                (Topic::Nodes, encoded(&nodes)),
                (Topic::Structure, structure.encode_to_vec()),
                (Topic::WallPoints, encoded(&scene.wall_points())),
                (Topic::AntPoints, encoded(&scene::ant_points())),
            ],
            scene,
        }
    }

    pub(crate) fn messages(&self) -> impl Iterator<Item = (Topic, &[u8])> {
        self.messages
            .iter()
            .map(|(topic, bytes)| (*topic, &**bytes))
    }
}

fn encoded(message: &impl Encode) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(message.encoded_len().unwrap_or(0));
    // A vector grows; there is no other error.
    let _ = message.encode(&mut bytes);
    bytes
}
