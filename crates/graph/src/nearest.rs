//! The nearest node of each row of a data set, computed once.

use crate::{Graph, kmeans};

/// The nearest node of each row, and the squared distance to it.
#[derive(Debug, Clone, PartialEq)]
pub struct Nearest {
    /// Index of the nearest node, by row.
    pub nodes: Vec<u32>,
    /// Squared distance to it, by row.
    pub distances: Vec<f32>,
    /// Number of nodes.
    of: usize,
}

impl Nearest {
    /// For rows with latents `[n, dim]` and nodes with latents `[k, dim]`.
    #[must_use]
    pub fn of(latents: &[f32], dim: usize, nodes: &[f32]) -> Self {
        let n = latents.len() / dim.max(1);
        let mut nearest = Self {
            nodes: vec![0; n],
            distances: vec![0.0; n],
            of: nodes.len() / dim.max(1),
        };
        let (numbers, distances) = (&mut nearest.nodes, &mut nearest.distances);
        kmeans::assign(latents, dim, nodes, numbers, distances);
        nearest
    }

    /// The nearest of a graph's nodes to each row, if this was computed for the pool that the graph
    /// is from. Only rows whose nearest node is not in the graph are searched again; the result is
    /// the same as if all were.
    #[must_use]
    pub fn within(&self, latents: &[f32], graph: &Graph) -> Vec<u32> {
        let dim = graph.latent_dim;
        let mut number = vec![u32::MAX; self.of];
        for (node, id) in graph.ids.iter().enumerate() {
            match number.get_mut(*id as usize) {
                Some(slot) => *slot = node as u32,
                // A node that was added later may be nearest to any row.
                None => return Self::of(latents, dim, &graph.latents).nodes,
            }
        }
        let held = |id: &u32| number.get(*id as usize).copied().unwrap_or(u32::MAX);
        let mut nodes: Vec<u32> = self.nodes.iter().map(held).collect();
        let rows = (0..nodes.len()).filter(|row| nodes[*row] == u32::MAX);
        let left: Vec<usize> = rows.collect();
        let of = |row: &usize| latents.get(row * dim..(row + 1) * dim).unwrap_or_default();
        let points: Vec<f32> = left.iter().flat_map(of).copied().collect();
        let again = Self::of(&points, dim, &graph.latents);
        for (row, node) in left.into_iter().zip(again.nodes) {
            nodes[row] = node;
        }
        nodes
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::paths::tests::ring;

    fn graph(ids: Vec<u32>, latents: Vec<f32>) -> Graph {
        Graph {
            ids,
            latents,
            latent_dim: 2,
            ..ring(3)
        }
    }

    proptest! {
        #[test]
        fn within_a_graph_equals_a_full_search(
            rows in prop::collection::vec(-4.0_f32..4.0, 2..300),
            nodes in prop::collection::vec(-4.0_f32..4.0, 2..60),
            keep in prop::collection::vec(any::<bool>(), 30),
        ) {
            let (rows, nodes) = (&rows[..rows.len() / 2 * 2], &nodes[..nodes.len() / 2 * 2]);
            let mut ids: Vec<u32> = (0..nodes.len() as u32 / 2).filter(|id| keep[*id as usize]).collect();
            if ids.is_empty() {
                ids.push(0);
            }
            let of = |id: &u32| &nodes[2 * *id as usize..2 * *id as usize + 2];
            let latents: Vec<f32> = ids.iter().flat_map(of).copied().collect();
            let nearest = Nearest::of(rows, 2, nodes);
            prop_assert_eq!(nearest.nodes.len(), rows.len() / 2);
            let found = nearest.within(rows, &graph(ids.clone(), latents.clone()));
            prop_assert_eq!(&found, &Nearest::of(rows, 2, &latents).nodes);
            // With a node that was added later.
            let (ids, latents) = ([ids, vec![99]].concat(), [latents, vec![0.5, 0.5]].concat());
            let found = nearest.within(rows, &graph(ids, latents.clone()));
            prop_assert_eq!(&found, &Nearest::of(rows, 2, &latents).nodes);
        }
    }

    #[test]
    fn empty_inputs_do_not_panic() {
        let none = Nearest::of(&[], 2, &[0.0, 0.0]);
        assert!(none.within(&[], &graph(vec![0], vec![0.0, 0.0])).is_empty());
        let none = Nearest::of(&[1.0, 1.0], 2, &[]);
        assert_eq!((none.nodes, none.distances), (vec![0], vec![f32::INFINITY]));
    }
}
