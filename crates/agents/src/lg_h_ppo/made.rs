//! Graphs made up for tests.

use graph::{Edge, Graph};

/// A graph of nodes at places, which are their latents, with edges of 10 steps.
pub(super) fn graph(places: &[[f32; 2]], pairs: &[(u32, u32)]) -> Graph {
    let mut offsets = vec![0];
    let mut edges = vec![];
    for node in 0..places.len() as u32 {
        for (_, to) in pairs.iter().filter(|(from, _)| *from == node) {
            edges.push(Edge {
                to: *to,
                count: 5,
                mean_steps: 10.0,
                least_steps: 8.0,
                reachability: 1.0,
                tried: 0.0,
                reached: 0.0,
                rollout_steps: 0.0,
            });
        }
        offsets.push(edges.len() as u32);
    }
    Graph {
        version: 1,
        ids: (0..places.len() as u32).collect(),
        latent_dim: 2,
        latents: places.as_flattened().to_vec(),
        places: places.to_vec(),
        offsets,
        edges,
        mean_edge_steps: 10.0,
    }
}

/// Nodes on a circle of 4 m, each with edges to the one before and the one after.
pub(super) fn ring(nodes: u32) -> Graph {
    let places: Vec<[f32; 2]> = (0..nodes)
        .map(|node| {
            let angle = std::f32::consts::TAU * node as f32 / nodes as f32;
            [4.0 * angle.cos(), 4.0 * angle.sin()]
        })
        .collect();
    let around = |node: u32| {
        [
            (node, (node + 1) % nodes),
            (node, (node + nodes - 1) % nodes),
        ]
    };
    let pairs: Vec<(u32, u32)> = (0..nodes).flat_map(around).collect();
    graph(&places, &pairs)
}
