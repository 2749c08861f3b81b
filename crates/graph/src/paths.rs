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

    /// An edge to node 0 of so many steps that was never tried.
    pub(crate) fn edge(mean_steps: f32) -> Edge {
        Edge {
            to: 0,
            count: 1,
            mean_steps,
            least_steps: mean_steps,
            reachability: 1.0,
            tried: 0.0,
            reached: 0.0,
            rollout_steps: 0.0,
        }
    }

    pub(crate) fn ring(n: u32) -> Graph {
        let to = |to| Edge { to, ..edge(3.0) };
        let rows = (0..n).map(|i| vec![to((i + 1) % n)]).collect();
        Graph::assemble(
            2,
            (0..n).collect(),
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
                    rows[from].push(Edge { to: to as u32, ..edge(cost as f32) });
                }
            }
            let graph = Graph::assemble(1, (0..8).collect(), vec![0.0; 8], vec![[0.0; 2]; 8], rows);
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
                }
            }
        }
    }
}
