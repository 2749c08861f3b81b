//! The parts of an algorithm as they are at the moment: weights and graph, each with a version.

use std::collections::VecDeque;
use std::sync::Arc;

use graph::Graph;

/// Parts that have versions: an algorithm's networks in their order, and at [`GRAPH`] its graph.
pub const PARTS: usize = 8;
/// The graph's place among the parts.
pub const GRAPH: usize = PARTS - 1;
/// A version of each part, 0 for none.
pub type Versions = [u64; PARTS];

/// Versions of the graph that are kept until weights for them are there.
const KEPT: usize = 4;

/// Weights of a network.
#[derive(Debug, Clone, PartialEq)]
pub struct Weights {
    /// Their version, from 1.
    pub version: u64,
    /// The [structure](Graph::structure) of the graph that they are over; 0 for none.
    pub structure: u64,
    /// The values.
    pub values: Arc<[f32]>,
}

/// The newest weights of each network, and the newest versions of the graph.
#[derive(Debug, Clone, Default)]
pub struct Parts {
    networks: Vec<Option<Weights>>,
    graphs: VecDeque<Arc<Graph>>,
}

impl Parts {
    /// Of so many networks, none of which is there.
    #[must_use]
    pub fn new(networks: usize) -> Self {
        Self {
            networks: vec![None; networks],
            graphs: VecDeque::with_capacity(KEPT),
        }
    }

    /// Takes newer weights of a network.
    pub fn set_weights(&mut self, network: usize, weights: Weights) {
        if let Some(slot) = self.networks.get_mut(network) {
            *slot = Some(weights);
        }
    }

    /// Takes a newer version of the graph.
    pub fn set_graph(&mut self, graph: Arc<Graph>) {
        self.graphs.truncate(KEPT - 1);
        self.graphs.push_front(graph);
    }

    /// The newest weights of a network.
    #[must_use]
    pub fn weights(&self, network: usize) -> Option<&Weights> {
        self.networks.get(network)?.as_ref()
    }

    /// The newest version of the graph.
    #[must_use]
    pub fn graph(&self) -> Option<&Arc<Graph>> {
        self.graphs.front()
    }

    /// The newest versions of the graph, the newest first.
    pub fn graphs(&self) -> impl Iterator<Item = &Arc<Graph>> {
        self.graphs.iter()
    }
}
