//! A walk on the graph.

use rand::{Rng, RngExt};
use serde::{Deserialize, Serialize};

/// One walk on the graph.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(super) struct Walk {
    pub(super) node: u32,
    pub(super) goal: u32,
    pub(super) edges: usize,
    pub(super) rewards: f32,
}

pub(super) fn new_walk(nodes: usize, rng: &mut impl Rng) -> Walk {
    let node = rng.random_range(0..nodes.max(2));
    let mut goal = rng.random_range(0..nodes.max(2) - 1);
    if goal >= node {
        goal += 1;
    }
    Walk {
        node: node as u32,
        goal: goal as u32,
        edges: 0,
        rewards: 0.0,
    }
}
