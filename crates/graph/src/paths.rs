//! Shortest paths (Dijkstra 1959) over the edges.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use crate::{Edge, Graph};

impl Graph {
    /// Cost of the cheapest way from each node to `goal`; infinite where there is none. Costs
    /// below zero count as zero.
    #[must_use]
    pub fn distances_to(&self, goal: u32, cost: impl Fn(&Edge) -> f32) -> Vec<f32> {
        let n = self.len();
        let mut incoming: Vec<Vec<(u32, f32)>> = vec![vec![]; n];
        for from in 0..n as u32 {
            for edge in self.neighbours(from) {
                incoming[edge.to as usize].push((from, non_negative(cost(edge))));
            }
        }
        let mut distances = vec![f32::INFINITY; n];
        let Some(start) = distances.get_mut(goal as usize) else {
            return distances;
        };
        *start = 0.0;
        // Non-negative floats order like their bits.
        let mut queue = BinaryHeap::from([Reverse((0_u32, goal))]);
        while let Some(Reverse((bits, node))) = queue.pop() {
            let distance = f32::from_bits(bits);
            if distance > distances[node as usize] {
                continue;
            }
            for &(from, cost) in &incoming[node as usize] {
                let through = distance + cost;
                if through < distances[from as usize] {
                    distances[from as usize] = through;
                    queue.push(Reverse((through.to_bits(), from)));
                }
            }
        }
        distances
    }

    /// The out-edge that the cheapest way goes on by, given [`distances_to`](Self::distances_to)
    /// its goal and the same cost; none at the goal and where no way leads there.
    #[must_use]
    pub fn next_hop(
        &self,
        from: u32,
        distances: &[f32],
        cost: impl Fn(&Edge) -> f32,
    ) -> Option<&Edge> {
        if distances.get(from as usize).is_none_or(|d| *d <= 0.0) {
            return None;
        }
        let through = |edge: &Edge| {
            let rest = distances
                .get(edge.to as usize)
                .copied()
                .unwrap_or(f32::INFINITY);
            non_negative(cost(edge)) + rest
        };
        self.neighbours(from)
            .iter()
            .filter(|edge| through(edge).is_finite())
            .min_by(|a, b| through(a).total_cmp(&through(b)))
    }

    /// Nodes of the cheapest way, both ends among them; none where there is no way. Edges that
    /// cost nothing may make it stop short of a way that exists: let every edge cost something.
    #[must_use]
    pub fn path(&self, from: u32, to: u32, cost: impl Fn(&Edge) -> f32) -> Option<Vec<u32>> {
        let distances = self.distances_to(to, &cost);
        let mut path = vec![
            *distances
                .get(from as usize)
                .filter(|d| d.is_finite())
                .map(|_| &from)?,
        ];
        let mut node = from;
        while node != to {
            node = self.next_hop(node, &distances, &cost)?.to;
            path.push(node);
            if path.len() > self.len() {
                return None;
            }
        }
        Some(path)
    }
}

/// Costs below zero count as zero; what is no number is no way.
fn non_negative(cost: f32) -> f32 {
    if cost.is_nan() {
        f32::INFINITY
    } else {
        cost.max(0.0)
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use proptest::prelude::*;

    use super::*;

    pub(crate) fn ring(n: u32) -> Graph {
        let edge = |to| Edge {
            to,
            count: 1,
            mean_steps: 3.0,
            tried: 0,
            reached: 0,
        };
        let rows = (0..n).map(|i| vec![edge((i + 1) % n)]).collect();
        Graph::assemble(
            2,
            vec![0.5; 2 * n as usize],
            vec![[0.0; 2]; n as usize],
            rows,
        )
    }

    proptest! {
        #[test]
        fn equals_floyd_and_warshall(
            pairs in proptest::collection::vec((0..8_usize, 0..8_usize, 1..20_u32), 0..40)
        ) {
            let mut table = [[f32::INFINITY; 8]; 8];
            let mut rows = vec![vec![]; 8];
            for i in 0..8 {
                table[i][i] = 0.0;
            }
            for (from, to, cost) in pairs {
                if from != to && table[from][to].is_infinite() {
                    table[from][to] = cost as f32;
                    let mean_steps = cost as f32;
                    rows[from].push(
                        Edge { to: to as u32, count: 1, mean_steps, tried: 0, reached: 0 }
                    );
                }
            }
            let graph = Graph::assemble(1, vec![0.0; 8], vec![[0.0; 2]; 8], rows);
            for k in 0..8 {
                for i in 0..8 {
                    for j in 0..8 {
                        table[i][j] = table[i][j].min(table[i][k] + table[k][j]);
                    }
                }
            }
            for goal in 0..8 {
                let distances = graph.distances_to(goal as u32, |edge| edge.mean_steps);
                for from in 0..8 {
                    prop_assert_eq!(distances[from], table[from][goal]);
                    let path = graph.path(from as u32, goal as u32, |edge| edge.mean_steps);
                    prop_assert_eq!(path.is_some(), distances[from].is_finite());
                    if let Some(path) = path {
                        let steps = path
                            .windows(2)
                            .map(|pair| graph.edge(pair[0], pair[1]).unwrap().mean_steps);
                        prop_assert_eq!(steps.sum::<f32>(), distances[from]);
                    }
                }
            }
        }
    }
}
