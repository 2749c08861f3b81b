//! What rollouts tell of the graph: the edges that they tried, and the places that they were at.

use std::collections::VecDeque;

use graph::{Graph, Pool, Segments};
use maze::upright;
use serde::{Deserialize, Serialize};
use wire::{TrajectoryHeader, Transition, flags};

use crate::build::UPRIGHT;

/// Versions whose nodes are remembered: a trajectory counts nodes as its own version does.
const REMEMBERED: usize = 64;

/// What became of the edges that were tried since the last version.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Tally {
    pub(crate) tried: u64,
    pub(crate) reached: u64,
    /// Sum, over the reached ones, of their steps as a multiple of the data's least.
    pub(crate) over_best: f64,
}

/// Books trajectories into the pool.
#[derive(Default)]
pub(crate) struct Tries {
    versions: VecDeque<Graph>,
    latents: Vec<f32>,
    /// Since the last version, and before it.
    pub(crate) recent: Tally,
    pub(crate) total: Tally,
}

impl Tries {
    /// A new version was published.
    pub(crate) fn publish(&mut self, graph: Graph) {
        self.versions.push_front(graph);
        self.versions.truncate(REMEMBERED);
        self.recent = Tally::default();
    }

    /// The newest version.
    pub(crate) fn newest(&self) -> Option<&Graph> {
        self.versions.front()
    }

    /// Books the edges that a trajectory settled.
    pub(crate) fn book(
        &mut self,
        pool: &mut Pool,
        header: &TrajectoryHeader,
        record: &[Transition],
    ) {
        let version = header.graph_version;
        let Some(graph) = self.versions.iter().find(|g| g.version == version) else {
            return;
        };
        for (at, t) in wire::settled(record) {
            let (start, end) = (&record[at], &record[t]);
            let (from, to) = (start.node.max(0) as u32, start.subgoal.max(0) as u32);
            let reached = end.has(flags::REACHED);
            // Who arrives at the goal on the way there has not tried the edge to its end.
            let tried = reached || end.has(flags::FAILED);
            let id = |node: u32| graph.ids.get(node as usize).copied();
            let (Some(a), Some(b)) = (id(from), id(to)) else {
                continue;
            };
            if !tried || !pool.record(a, b, reached, t - at) {
                continue;
            }
            let edge = graph.edge(from, to);
            let best = edge.map_or(1.0, |edge| f64::from(edge.least_steps.max(1.0)));
            for tally in [&mut self.recent, &mut self.total] {
                tally.tried += 1;
                if reached {
                    tally.reached += 1;
                    tally.over_best += (t - at) as f64 / best;
                }
            }
        }
    }

    /// Takes a trajectory in as the data's were.
    pub(crate) fn explore(
        &mut self,
        pool: &mut Pool,
        encoder: &mut agents::vae::Encoder,
        header: &TrajectoryHeader,
        record: &[Transition],
    ) {
        let places: Vec<[f32; 2]> = record
            .iter()
            .map(|step| [step.observation[0], step.observation[1]])
            .collect();
        self.latents.clear();
        encoder.encode(places.iter().copied(), &mut self.latents);
        // Names of rollouts are not those of the data's episodes, which count from 0. An episode of
        // a round is the same whoever plays it.
        let name = (1 << 63)
            | match header.round {
                0 => {
                    u64::from(header.incarnation) << 31
                        ^ u64::from(header.actor) << 24
                        ^ header.episode
                }
                round => u64::from(round) << 32 | header.episode,
            };
        pool.add(&Segments {
            latents: &self.latents,
            places: &places,
            episodes: &[0..record.len()],
            names: &|_| name,
            usable: &|row| upright(&record[row].observation) >= UPRIGHT,
        });
    }
}

#[cfg(test)]
mod tests {
    use graph::EdgeRule;

    use super::*;

    fn step(node: i32, subgoal: i32, flags: u32) -> Transition {
        Transition {
            node,
            subgoal,
            flags,
            ..Transition::default()
        }
    }

    #[test]
    fn edges_are_booked_under_the_version_that_was_walked() {
        let rule = EdgeRule {
            lag: 2,
            min_count: 1,
            min_trajectories: 1,
            least_success: 0.0,
        };
        let mut pool = Pool::new(1, vec![0.0, 1.0], rule);
        let xs = [0.0, 0.0, 1.0, 1.0, 0.0, 0.0];
        pool.add(&Segments {
            latents: &xs,
            places: &xs.map(|x| [x, 0.0]),
            episodes: &[0..6],
            names: &|_| 0,
            usable: &|_| true,
        });
        let mut tries = Tries::default();
        tries.publish(pool.renew().0);
        let record = [
            step(0, 1, flags::CHOICE),
            step(0, 1, 0),
            step(0, 1, 0),
            step(1, 0, flags::REACHED | flags::CHOICE),
            step(1, 1, flags::FAILED | flags::FINAL),
        ];
        let mut header = TrajectoryHeader {
            graph_version: 1,
            ..TrajectoryHeader::default()
        };
        tries.book(&mut pool, &header, &record);
        let tally = Tally {
            tried: 2,
            reached: 1,
            over_best: 1.5,
        };
        assert_eq!(tries.recent, tally);
        header.graph_version = 9;
        tries.book(&mut pool, &header, &record);
        assert_eq!(tries.total, tally, "a version that was never published");
        let graph = pool.renew().0;
        let edge = graph.edge(0, 1).unwrap();
        assert_eq!((edge.tried, edge.rollout_steps), (1.0, 3.0));
        tries.publish(graph);
        assert_eq!((tries.recent, tries.total), (Tally::default(), tally));
    }
}
