//! What rollouts did on the graph: the edges that they tried, and the places that they were at.

use std::collections::VecDeque;
use std::sync::Arc;

use graph::{Graph, Pool, Segments};
use serde::{Deserialize, Serialize};
use simulator::Body;

use crate::lg_h_ppo::choice::{Choice, Ending};
use crate::lg_h_ppo::vae::Encoder;
use crate::rollout::Rollout;

/// Below this upright value a row counts for no edge.
pub(super) const UPRIGHT: f32 = 0.3;
/// Versions whose nodes are remembered: a trajectory counts nodes as its own version does.
const REMEMBERED: usize = 64;

/// What became of the edges that were tried since the last version.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Tally {
    /// Edges tried.
    pub tried: u64,
    /// Of those, the ones whose end was reached.
    pub reached: u64,
    /// Sum, over the reached ones, of their steps as a multiple of the data's least.
    pub over_best: f64,
}

/// Counts rollouts into the pool.
#[derive(Default)]
pub(super) struct Tries {
    versions: VecDeque<Arc<Graph>>,
    places: Vec<[f32; 2]>,
    latents: Vec<f32>,
    /// Since the last version, and before it.
    pub(super) recent: Tally,
    pub(super) total: Tally,
}

impl Tries {
    /// A new version was published.
    pub(super) fn publish(&mut self, graph: Arc<Graph>) {
        self.versions.push_front(graph);
        self.versions.truncate(REMEMBERED);
        self.recent = Tally::default();
    }

    /// The newest version.
    pub(super) fn newest(&self) -> Option<&Graph> {
        self.versions.front().map(Arc::as_ref)
    }

    /// Counts the edges that a rollout tried to their ends.
    pub(super) fn count(&mut self, pool: &mut Pool, rollout: &Rollout<'_>) {
        let version = rollout.graph_version;
        let Some(graph) = self.versions.iter().find(|g| g.version == version) else {
            return;
        };
        for choice in Choice::of(rollout) {
            let reached = match choice.ending {
                Ending::Reached => true,
                Ending::GivenUp => false,
                // Who reaches the goal on the way has not tried the edge to its end.
                Ending::Arrived => continue,
            };
            let id = |node: u32| graph.ids.get(node as usize).copied();
            let (Some(a), Some(b)) = (id(choice.node), id(choice.subgoal)) else {
                continue;
            };
            let steps = choice.steps as usize;
            if !pool.record(a, b, reached, steps) {
                continue;
            }
            let edge = graph.edge(choice.node, choice.subgoal);
            let best = edge.map_or(1.0, |edge| f64::from(edge.least_steps.max(1.0)));
            for tally in [&mut self.recent, &mut self.total] {
                tally.tried += 1;
                if reached {
                    tally.reached += 1;
                    tally.over_best += steps as f64 / best;
                }
            }
        }
    }

    /// Takes a rollout in as the data's episodes were.
    pub(super) fn explore(
        &mut self,
        pool: &mut Pool,
        encoder: &mut Encoder,
        body: &dyn Body,
        rollout: &Rollout<'_>,
    ) {
        let observation = |row: usize| {
            let values = rollout.rows.row(row).observation();
            values.floats().unwrap_or_default()
        };
        let rows = 0..rollout.rows.len();
        self.places.clear();
        self.places
            .extend(rows.clone().map(|row| body.place(observation(row))));
        self.latents.clear();
        encoder.encode(self.places.iter().copied(), &mut self.latents);
        // Names of rollouts are not those of the data's episodes, which count from 0.
        let name = (1 << 63) | rollout.episode;
        pool.add(&Segments {
            latents: &self.latents,
            places: &self.places,
            episodes: &[rows],
            names: &|_| name,
            usable: &|row| body.upright(observation(row)) >= UPRIGHT,
        });
    }
}

#[cfg(test)]
mod tests {
    use graph::EdgeRule;
    use simulator::{RowLayout, Space, Spaces};

    use super::*;

    #[test]
    fn edges_are_counted_under_the_version_that_was_acted_on() {
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
        tries.publish(Arc::new(pool.renew().0));
        let mut choices = vec![];
        for (node, subgoal, steps, ending) in [
            (0, 1, 3, Ending::Reached),
            (1, 0, 1, Ending::GivenUp),
            (0, 1, 2, Ending::Arrived),
            (7, 9, 2, Ending::Reached),
        ] {
            let choice = Choice {
                node,
                goal: 1,
                subgoal,
                log_prob: 0.0,
                steps,
                ending,
                next: 0,
                excluded: vec![],
            };
            choice.write(&mut choices);
        }
        let layout = RowLayout::new(&Spaces {
            observation: Space::vector(4),
            action: Space::vector(2),
            goal: 2,
            control_seconds: 0.1,
        });
        let mut rollout = Rollout {
            rows: layout.rows(&[]),
            choices: &choices,
            graph_version: 1,
            structure: 0,
            episode: 0,
        };
        tries.count(&mut pool, &rollout);
        let tally = Tally {
            tried: 2,
            reached: 1,
            over_best: 1.5,
        };
        assert_eq!(tries.recent, tally);
        rollout.graph_version = 9;
        tries.count(&mut pool, &rollout);
        assert_eq!(tries.total, tally, "a version that was never published");
        let graph = pool.renew().0;
        let edge = graph.edge(0, 1).unwrap();
        assert_eq!((edge.tried, edge.rollout_steps), (1.0, 3.0));
        tries.publish(Arc::new(graph));
        assert_eq!((tries.recent, tries.total), (Tally::default(), tally));
    }
}
