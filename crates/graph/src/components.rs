//! Strongly connected components (Tarjan 1972, without recursion).

use crate::Graph;

/// Component of each node; numbers are dense from 0.
fn components(graph: &Graph) -> Vec<usize> {
    const UNSEEN: usize = usize::MAX;
    let n = graph.len();
    let (mut index, mut low) = (vec![UNSEEN; n], vec![0; n]);
    let mut component = vec![UNSEEN; n];
    let (mut stack, mut next, mut found) = (vec![], 0, 0);
    for root in 0..n {
        if index[root] != UNSEEN {
            continue;
        }
        // Node and how many of its edges were followed.
        let mut calls = vec![(root, 0)];
        while let Some((node, followed)) = calls.pop() {
            if index[node] == UNSEEN {
                index[node] = next;
                low[node] = next;
                next += 1;
                stack.push(node);
            }
            let edges = graph.neighbours(node as u32);
            let mut descend = None;
            for (i, edge) in edges.iter().enumerate().skip(followed) {
                let to = edge.to as usize;
                if index[to] == UNSEEN {
                    descend = Some((i, to));
                    break;
                }
                if component[to] == UNSEEN {
                    low[node] = low[node].min(low[to]);
                }
            }
            if let Some((i, to)) = descend {
                // On return the edge's end has been seen and the search goes on from there.
                calls.push((node, i));
                calls.push((to, 0));
                continue;
            }
            if low[node] == index[node] {
                while let Some(member) = stack.pop() {
                    component[member] = found;
                    if member == node {
                        break;
                    }
                }
                found += 1;
            }
            if let Some((parent, _)) = calls.last() {
                low[*parent] = low[*parent].min(low[node]);
            }
        }
    }
    component
}

impl Graph {
    /// The largest strongly connected part, its nodes renumbered in order. Edges among the kept
    /// nodes stay as they are.
    #[must_use]
    pub fn largest_component(&self) -> Self {
        let component = components(self);
        let mut sizes = vec![0_usize; self.len()];
        component.iter().for_each(|c| sizes[*c] += 1);
        let largest = (0..sizes.len()).rev().max_by_key(|c| sizes[*c]);
        let keep = |node: usize| Some(component[node]) == largest;
        let mut number = vec![None; self.len()];
        let mut kept = 0;
        for node in (0..self.len()).filter(|node| keep(*node)) {
            number[node] = Some(kept);
            kept += 1;
        }
        let (mut ids, mut latents, mut places, mut rows) = (vec![], vec![], vec![], vec![]);
        for node in (0..self.len()).filter(|node| keep(*node)) {
            ids.push(self.ids[node]);
            latents.extend_from_slice(self.latent(node as u32));
            places.push(self.places[node]);
            let edges = self.neighbours(node as u32).iter();
            rows.push(
                edges
                    .filter_map(|edge| {
                        number[edge.to as usize].map(|to| crate::Edge { to, ..*edge })
                    })
                    .collect(),
            );
        }
        Self {
            version: self.version,
            ..Self::assemble(self.latent_dim, ids, latents, places, rows)
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::Edge;
    use crate::paths::tests::edge;

    fn graph(n: usize, pairs: &[(usize, usize)]) -> Graph {
        let mut rows = vec![vec![]; n];
        for &(from, to) in pairs {
            if from != to && !rows[from].iter().any(|e: &Edge| e.to == to as u32) {
                rows[from].push(Edge {
                    to: to as u32,
                    ..edge(1.0)
                });
            }
        }
        Graph::assemble(
            1,
            (0..n as u32).collect(),
            vec![0.0; n],
            vec![[0.0; 2]; n],
            rows,
        )
    }

    #[test]
    fn the_larger_ring_stays() {
        let ring = [(0, 1), (1, 0), (1, 2), (2, 3), (3, 4), (4, 2)];
        let kept = graph(5, &ring).largest_component();
        assert_eq!((kept.len(), kept.edges.len()), (3, 3));
    }

    proptest! {
        /// Two nodes share a component exactly when each reaches the other.
        #[test]
        fn components_are_mutual_reachability(
            pairs in proptest::collection::vec((0..9_usize, 0..9_usize), 0..30)
        ) {
            let graph = graph(9, &pairs);
            let mut reach = [[false; 9]; 9];
            for i in 0..9 {
                reach[i][i] = true;
                for edge in graph.neighbours(i as u32) {
                    reach[i][edge.to as usize] = true;
                }
            }
            for k in 0..9 {
                for i in 0..9 {
                    for j in 0..9 {
                        reach[i][j] |= reach[i][k] && reach[k][j];
                    }
                }
            }
            let component = components(&graph);
            for i in 0..9 {
                for j in 0..9 {
                    let same = component[i] == component[j];
                    prop_assert_eq!(same, reach[i][j] && reach[j][i], "{} {}", i, j);
                }
            }
        }
    }
}
