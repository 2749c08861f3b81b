//! Edges from segments of the data.

use std::collections::HashMap;
use std::ops::Range;

use crate::{Edge, Graph, kmeans};

/// When segments make an edge.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct EdgeRule {
    /// Control steps of a segment (c).
    pub lag: usize,
    /// Segments needed.
    pub min_count: usize,
    /// Trajectories needed.
    pub min_trajectories: usize,
}

/// The data that edges come from.
pub struct Segments<'a> {
    /// Latent of each row, `[n, dim]`.
    pub latents: &'a [f32],
    /// Place of each row (m).
    pub places: &'a [[f32; 2]],
    /// Rows of each episode.
    pub episodes: &'a [Range<usize>],
    /// Rows that count: where the ant is upright.
    pub usable: &'a dyn Fn(usize) -> bool,
}

#[derive(Default)]
struct Tally {
    count: u32,
    steps: f64,
    last_episode: Option<usize>,
    trajectories: usize,
}

/// Nodes from centroids, edges from every segment (s_t .. s_{t+lag}) within an episode whose two
/// ends lie in different nodes; then the largest strongly connected part, renumbered, so that
/// every node can be left and every other one reached.
#[must_use]
pub fn build(data: &Segments<'_>, dim: usize, centroids: &[f32], rule: &EdgeRule) -> Graph {
    if dim == 0 || centroids.len() < dim {
        return Graph::assemble(dim, vec![], vec![], vec![]);
    }
    let n = data.places.len().min(data.latents.len() / dim);
    let k = centroids.len() / dim;
    let (mut nodes, mut distance) = (vec![0_u32; n], vec![0.0; n]);
    kmeans::assign(data.latents, dim, centroids, &mut nodes, &mut distance);

    let (mut places, mut members) = (vec![[0.0_f64; 2]; k], vec![0_u32; k]);
    let mut tallies: HashMap<(u32, u32), Tally> = HashMap::new();
    for (number, episode) in data.episodes.iter().enumerate() {
        // An episode that says it is longer than the data ends with them.
        let episode = episode.start..episode.end.min(n);
        for t in episode.clone().filter(|&t| (data.usable)(t)) {
            let node = nodes[t] as usize;
            members[node] += 1;
            for axis in 0..2 {
                places[node][axis] += f64::from(data.places[t][axis]);
            }
        }
        for t in episode.start..episode.end.saturating_sub(rule.lag) {
            let (from, to) = (nodes[t], nodes[t + rule.lag]);
            if from == to || !(data.usable)(t) || !(data.usable)(t + rule.lag) {
                continue;
            }
            // From the last row in the one node to the first in the other.
            let segment = &nodes[t..=t + rule.lag];
            let entered = segment
                .iter()
                .position(|node| *node == to)
                .unwrap_or(rule.lag);
            let left = segment[..entered]
                .iter()
                .rposition(|node| *node == from)
                .unwrap_or(0);
            let tally = tallies.entry((from, to)).or_default();
            tally.count += 1;
            tally.steps += (entered - left) as f64;
            if tally.last_episode != Some(number) {
                tally.last_episode = Some(number);
                tally.trajectories += 1;
            }
        }
    }
    let mut rows = vec![vec![]; k];
    for ((from, to), tally) in tallies {
        if tally.count as usize >= rule.min_count && tally.trajectories >= rule.min_trajectories {
            rows[from as usize].push(Edge {
                to,
                count: tally.count,
                mean_steps: (tally.steps / f64::from(tally.count)) as f32,
                tried: 0,
                reached: 0,
            });
        }
    }
    let places = places
        .iter()
        .zip(&members)
        .map(|(sum, count)| sum.map(|axis| (axis / f64::from((*count).max(1))) as f32))
        .collect();
    Graph::assemble(dim, centroids.to_vec(), places, rows).largest_component()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// Rows on a line, one latent per metre.
    fn line(xs: &[f32]) -> (Vec<f32>, Vec<[f32; 2]>) {
        (xs.to_vec(), xs.iter().map(|x| [*x, 0.0]).collect())
    }

    #[test]
    fn a_walk_there_and_back_links_its_nodes() {
        let xs: Vec<f32> = (0..21)
            .chain((0..20).rev())
            .map(|i| i as f32 * 0.1)
            .collect();
        let (latents, places) = line(&xs);
        let data = Segments {
            latents: &latents,
            places: &places,
            episodes: &[0..41],
            usable: &|_| true,
        };
        let rule = EdgeRule {
            lag: 5,
            min_count: 1,
            min_trajectories: 1,
        };
        let graph = build(&data, 1, &[0.0, 1.0, 2.0], &rule);
        assert_eq!(graph.len(), 3);
        assert!(graph.edge(0, 1).is_some() && graph.edge(1, 0).is_some());
        assert!(graph.edge(0, 2).is_none(), "too far for a segment");
        assert_eq!(graph.edge(0, 1).unwrap().mean_steps, 1.0);
        assert!((graph.places[1][0] - 1.0).abs() < 0.1);
    }

    #[test]
    fn segments_never_cross_an_episodes_end() {
        let (latents, places) = line(&[0.0, 0.0, 1.0, 1.0, 0.0, 0.0]);
        let rule = EdgeRule {
            lag: 1,
            min_count: 1,
            min_trajectories: 1,
        };
        let of = |episodes: &[Range<usize>]| {
            let data = Segments {
                latents: &latents,
                places: &places,
                episodes,
                usable: &|_| true,
            };
            build(&data, 1, &[0.0, 1.0], &rule)
        };
        assert_eq!(of(&[0..6]).edges.len(), 2);
        assert_eq!(of(&[0..2, 2..4, 4..6]).edges.len(), 0);
    }

    proptest! {
        #[test]
        fn every_node_of_a_built_graph_reaches_every_other(
            xs in proptest::collection::vec(0.0_f32..6.0, 30..120), cut in 5..25_usize,
        ) {
            let (latents, places) = line(&xs);
            let episodes = [0..cut, cut..xs.len()];
            let data = Segments {
                latents: &latents, places: &places, episodes: &episodes, usable: &|_| true,
            };
            let rule = EdgeRule { lag: 2, min_count: 1, min_trajectories: 1 };
            let graph = build(&data, 1, &[0.5, 1.5, 2.5, 3.5, 4.5, 5.5], &rule);
            prop_assert_eq!(graph.offsets.len(), graph.len() + 1);
            prop_assert_eq!(graph.offsets[graph.len()] as usize, graph.edges.len());
            for goal in 0..graph.len() as u32 {
                let distances = graph.distances_to(goal, |_| 1.0);
                prop_assert!(distances.iter().all(|d| d.is_finite()));
            }
        }
    }
}
