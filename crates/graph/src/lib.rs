//! The latent graph: nodes are centroids of latents, edges are segments seen in the data.
//!
//! LG-H-PPO (Han 2026), section on graph construction. The crate knows no processes; its only
//! I/O is the graph's file.

mod assign;
mod bytes;
mod components;
mod judge;
pub mod kmeans;
mod knowledge;
mod nearest;
mod paths;
mod pool;
mod states;
mod timeout;

pub use bytes::{GraphError, max_bytes};
pub use judge::Unusable;
pub use knowledge::Knowledge;
pub use nearest::Nearest;
pub use pool::{EdgeRule, Growth, Pool, Segments};
pub use states::{StateRule, select};
pub use timeout::EdgeTimeout;

/// Out-edges of a node are at most this many; the rarest go first.
pub const MAX_OUT_DEGREE: usize = 48;

/// A directed edge and what is known of it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Edge {
    /// The node it leads to.
    pub to: u32,
    /// Segments of the data that made it.
    pub count: u32,
    /// Mean control steps from entering the one node to entering the other.
    pub mean_steps: f32,
    /// The least that any segment took.
    pub least_steps: f32,
    /// Share of the data's walks from the one node towards the other that came to it.
    pub reachability: f32,
    /// Rollouts that tried it, of the newest ones.
    pub tried: f32,
    /// Of those, the ones that got to its end.
    pub reached: f32,
    /// Mean control steps that these took from the choice to its end.
    pub rollout_steps: f32,
}

/// Nodes with latents and places, and directed edges in rows by their origin.
#[derive(Debug, Clone, PartialEq)]
pub struct Graph {
    /// Counts the graph's versions from 1.
    pub version: u64,
    /// What each node is called through all versions of the graph.
    pub ids: Vec<u32>,
    /// Width of a latent.
    pub latent_dim: usize,
    /// Latents `[nodes, latent_dim]`.
    pub latents: Vec<f32>,
    /// Mean place of each node's states (m).
    pub places: Vec<[f32; 2]>,
    /// Edges of node `i` are `edges[offsets[i]..offsets[i + 1]]`.
    pub offsets: Vec<u32>,
    /// All edges.
    pub edges: Vec<Edge>,
    /// Mean control steps of all edges, in the data.
    pub mean_edge_steps: f32,
}

impl Graph {
    /// Number of nodes.
    #[must_use]
    pub fn len(&self) -> usize {
        self.places.len()
    }

    /// Whether there is no node.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.places.is_empty()
    }

    /// A node's latent; an empty slice for a node that is not there.
    #[must_use]
    pub fn latent(&self, node: u32) -> &[f32] {
        let start = node as usize * self.latent_dim;
        self.latents
            .get(start..start + self.latent_dim)
            .unwrap_or_default()
    }

    fn row(&self, node: u32) -> std::ops::Range<usize> {
        match (
            self.offsets.get(node as usize),
            self.offsets.get(node as usize + 1),
        ) {
            (Some(start), Some(end)) => *start as usize..*end as usize,
            _ => 0..0,
        }
    }

    /// Every edge as its two nodes, in the order of the first.
    #[must_use]
    pub fn pairs(&self) -> Vec<(u32, u32)> {
        let of = |node| {
            self.neighbours(node)
                .iter()
                .map(move |edge| (node, edge.to))
        };
        (0..self.len() as u32).flat_map(of).collect()
    }

    /// A node's out-edges.
    #[must_use]
    pub fn neighbours(&self, node: u32) -> &[Edge] {
        self.edges.get(self.row(node)).unwrap_or_default()
    }

    /// The edge between two nodes.
    #[must_use]
    pub fn edge(&self, from: u32, to: u32) -> Option<&Edge> {
        self.neighbours(from).iter().find(|edge| edge.to == to)
    }

    /// Place of a node's first edge in [`edges`](Self::edges).
    #[must_use]
    pub fn first_edge(&self, node: u32) -> usize {
        self.row(node).start
    }

    /// A hash of the nodes' ids (FNV-1a): versions of one structure have the same nodes in the
    /// same order, and a policy over the nodes of one serves the other.
    #[must_use]
    pub fn structure(&self) -> u64 {
        let bytes = self.ids.iter().flat_map(|id| id.to_le_bytes());
        bytes.fold(0xcbf2_9ce4_8422_2325, |hash: u64, byte| {
            (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3)
        })
    }

    /// The node whose latent is nearest.
    #[must_use]
    pub fn nearest(&self, latent: &[f32]) -> Option<u32> {
        (latent.len() == self.latent_dim && !self.is_empty())
            .then(|| kmeans::nearest(&self.latents, self.latent_dim, latent).0)
    }

    /// Share of places that have a node within `radius` (m).
    #[must_use]
    pub fn coverage(&self, places: &[[f32; 2]], radius: f32) -> f32 {
        let near = |place: &[f32; 2]| {
            self.places
                .iter()
                .any(|node| (node[0] - place[0]).hypot(node[1] - place[1]) <= radius)
        };
        places.iter().filter(|place| near(place)).count() as f32 / places.len().max(1) as f32
    }

    /// Edges whose straight line crosses a wall, looked at every 0.25 m.
    pub fn edges_through_walls(&self, is_wall: impl Fn([f32; 2]) -> bool) -> usize {
        let crosses = |from: [f32; 2], to: [f32; 2]| {
            let steps = ((to[0] - from[0]).hypot(to[1] - from[1]) / 0.25).ceil() as usize;
            (0..=steps).any(|i| {
                let share = i as f32 / steps.max(1) as f32;
                is_wall([0, 1].map(|axis| from[axis] + share * (to[axis] - from[axis])))
            })
        };
        (0..self.len() as u32)
            .flat_map(|node| {
                self.neighbours(node)
                    .iter()
                    .map(move |edge| (node, edge.to))
            })
            .filter(|&(from, to)| crosses(self.places[from as usize], self.places[to as usize]))
            .count()
    }

    /// Assembles rows of edges; the most frequent [`MAX_OUT_DEGREE`] of each node stay.
    fn assemble(
        latent_dim: usize,
        ids: Vec<u32>,
        latents: Vec<f32>,
        places: Vec<[f32; 2]>,
        mut rows: Vec<Vec<Edge>>,
    ) -> Self {
        let mut offsets = vec![0];
        let mut edges = vec![];
        for row in &mut rows {
            row.sort_by_key(|edge| (std::cmp::Reverse(edge.count), edge.to));
            row.truncate(MAX_OUT_DEGREE);
            row.sort_by_key(|edge| edge.to);
            edges.extend_from_slice(row);
            offsets.push(edges.len() as u32);
        }
        Self {
            version: 1,
            latent_dim,
            ids,
            latents,
            places,
            offsets,
            mean_edge_steps: mean_steps(&edges),
            edges,
        }
    }
}

fn mean_steps(edges: &[Edge]) -> f32 {
    let sum: f32 = edges.iter().map(|edge| edge.mean_steps).sum();
    sum / edges.len().max(1) as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_structure_is_that_of_the_nodes_alone() {
        let mut graph = paths::tests::ring(4);
        let before = graph.structure();
        graph.edges[0].tried = 9.0;
        graph.version = 7;
        assert_eq!(graph.structure(), before);
        graph.ids[2] = 9;
        assert_ne!(graph.structure(), before);
    }

    #[test]
    fn lines_through_walls_are_counted() {
        let mut graph = paths::tests::ring(4);
        graph.places = vec![[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [0.0, 4.0]];
        // A wall in the middle of the first edge's line.
        let wall = |p: [f32; 2]| (p[0] - 2.0).abs() < 0.5 && p[1] < 1.0;
        assert_eq!(graph.edges_through_walls(wall), 1);
        assert_eq!(graph.coverage(&[[0.1, 0.0], [2.0, 2.0]], 0.5), 0.5);
    }
}
