//! Walks on the graph, to learn from and to measure.

use graph::{Edge, Graph};
use nets::categorical::Masked;
use rand::{Rng, RngExt};

use super::High;
use super::batch::{Step, duration, reward};
use super::walk::{Walk, new_walk};
use crate::ppo::End;

impl High {
    pub(super) fn walk(&mut self, graph: &Graph, rng: &mut impl Rng) {
        let (walks, horizon) = (self.walks.len(), self.settings.horizon);
        let nodes = graph.len();
        // Step-major while walking, one record a walk afterwards.
        let mut choices: Vec<Vec<Step>> = vec![Vec::with_capacity(horizon); walks];
        let mut input = vec![];
        let mut allowed = vec![];
        for _ in 0..horizon {
            input.clear();
            for walk in &self.walks {
                let (node, goal) = (graph.latent(walk.node), graph.latent(walk.goal));
                self.policy.input(node, goal, &mut input);
            }
            let logits = self.networks.outputs(&input, walks);
            for (i, walk) in self.walks.iter_mut().enumerate() {
                let edges = graph.neighbours(walk.node);
                allowed.clear();
                allowed.extend(edges.iter().map(|edge| edge.to as usize));
                let row = &logits[i * nodes..(i + 1) * nodes];
                let Some(masked) = Masked::new(row, &allowed) else {
                    continue;
                };
                let picked = masked.sample(rng);
                let edge = &edges[picked];
                let knowledge = self.edges.knowledge;
                let passed = rng.random::<f32>() < graph.reliability(edge, knowledge);
                let mut steps = graph.steps(edge, knowledge);
                if !passed {
                    steps = self.edges.timeout.limit(steps) as f32;
                }
                let next = if passed { edge.to } else { walk.node };
                let arrived = next == walk.goal;
                let out_of_time = walk.edges + 1 >= self.settings.max_edges;
                let choice = Step {
                    node: walk.node,
                    goal: walk.goal,
                    subgoal: edge.to,
                    log_prob: masked.log_prob(picked),
                    reward: reward(&self.settings, graph, steps, arrived),
                    duration: duration(graph, steps),
                    end: if arrived {
                        End::Terminal
                    } else if out_of_time {
                        End::Truncated
                    } else {
                        End::Not
                    },
                    excluded: vec![],
                };
                let (ended, reward) = (choice.end != End::Not, choice.reward);
                choices[i].push(choice);
                walk.node = next;
                walk.edges += 1;
                walk.rewards += reward;
                if ended {
                    self.ended.0 += u64::from(arrived);
                    self.ended.1 += 1;
                    self.ended.2 += f64::from(walk.rewards);
                    self.batch.records.push(choices[i].len());
                    self.batch.steps.append(&mut choices[i]);
                    self.batch.finals.push((next, walk.goal));
                    *walk = new_walk(nodes, rng);
                }
            }
            self.steps += walks as u64;
        }
        for (walk, mut record) in self.walks.iter().zip(choices) {
            if let Some(last) = record.last_mut() {
                last.end = End::Truncated;
                self.batch.records.push(record.len());
                self.batch.steps.append(&mut record);
                self.batch.finals.push((walk.node, walk.goal));
            }
        }
    }

    /// Share of all (start, goal) pairs, thinned to at most `pairs`, that the most likely choices
    /// lead from start to goal, and what their paths cost over what the cheapest ones do.
    pub fn quality(&mut self, graph: &Graph, pairs: usize, rng: &mut impl Rng) -> (f32, f32) {
        let nodes = graph.len();
        let (mut arrived, mut ratio) = (0_u32, 0.0);
        let mut input = vec![];
        let cost = |edge: &Edge| graph.cost(edge, self.edges.knowledge);
        for _ in 0..pairs {
            let Walk {
                node: start, goal, ..
            } = new_walk(nodes, rng);
            let cheapest = graph.distances_to(goal, cost)[start as usize];
            let (mut node, mut spent) = (start, 0.0);
            for _ in 0..self.settings.max_edges {
                input.clear();
                self.policy
                    .input(graph.latent(node), graph.latent(goal), &mut input);
                let logits = self.networks.outputs(&input, 1);
                let best = graph
                    .neighbours(node)
                    .iter()
                    .max_by(|a, b| logits[a.to as usize].total_cmp(&logits[b.to as usize]));
                let Some(edge) = best else { break };
                node = edge.to;
                spent += cost(edge);
                if node == goal {
                    arrived += 1;
                    ratio += spent / cheapest.max(1.0);
                    break;
                }
            }
        }
        (
            arrived as f32 / pairs.max(1) as f32,
            ratio / arrived.max(1) as f32,
        )
    }
}
