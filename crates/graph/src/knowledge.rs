//! What the edges are known to be worth: time and reachability, from data and from rollouts.

use crate::{Edge, Graph};

/// How much of what edges carry is used.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Knowledge {
    /// None, as in the paper: every edge takes the same time and leads where it should.
    Nothing,
    /// Times and reachability of the data's segments.
    Data,
    /// These, and what became of each edge that a rollout tried.
    #[default]
    Rollouts,
}

/// Tries that the data's word counts as, once rollouts have theirs.
const PRIOR: f32 = 2.0;
/// Times that an edge is tried at most, when its cost is reckoned: below one try in fifty no edge
/// is worth its while, however near its end.
const LEAST_RELIABILITY: f32 = 0.02;

impl Graph {
    /// How likely an edge leads where it should. The data's reachability stands for [`PRIOR`]
    /// tries: the mean of a Beta posterior.
    #[must_use]
    pub fn reliability(&self, edge: &Edge, knowledge: Knowledge) -> f32 {
        match knowledge {
            Knowledge::Nothing => 1.0,
            Knowledge::Data => edge.reachability,
            Knowledge::Rollouts => {
                (edge.reached + PRIOR * edge.reachability) / (edge.tried + PRIOR)
            }
        }
    }

    /// Control steps that an edge takes when it leads where it should.
    #[must_use]
    pub fn steps(&self, edge: &Edge, knowledge: Knowledge) -> f32 {
        match knowledge {
            Knowledge::Nothing => self.mean_edge_steps,
            Knowledge::Data => edge.mean_steps,
            Knowledge::Rollouts => {
                (edge.rollout_steps * edge.reached + PRIOR * edge.mean_steps)
                    / (edge.reached + PRIOR)
            }
        }
    }

    /// Control steps that it takes to get to an edge's end, tries that fail included: each costs
    /// twice the edge's time, after which it is given up.
    #[must_use]
    pub fn cost(&self, edge: &Edge, knowledge: Knowledge) -> f32 {
        let p = self.reliability(edge, knowledge).max(LEAST_RELIABILITY);
        self.steps(edge, knowledge) * (1.0 + 2.0 * (1.0 - p) / p)
    }
}

#[cfg(test)]
mod tests {
    use crate::paths::tests::ring;

    use super::*;

    #[test]
    fn failures_cost_trust_and_time_where_rollouts_count() {
        let mut graph = ring(4);
        let before = graph.edges[0];
        assert_eq!(graph.reliability(&before, Knowledge::Rollouts), 1.0);
        graph.edges[0].tried = 2.0;
        let edge = graph.edges[0];
        assert_eq!(graph.reliability(&edge, Knowledge::Rollouts), 0.5);
        assert_eq!(graph.reliability(&edge, Knowledge::Data), 1.0);
        assert_eq!(
            graph.cost(&edge, Knowledge::Rollouts),
            3.0 * before.mean_steps
        );
        assert_eq!(graph.cost(&edge, Knowledge::Nothing), graph.mean_edge_steps);
    }

    #[test]
    fn times_move_from_the_datas_to_the_rollouts() {
        let mut graph = ring(4);
        let edge = &mut graph.edges[0];
        (edge.tried, edge.reached, edge.rollout_steps) = (2.0, 2.0, 9.0);
        let edge = graph.edges[0];
        assert_eq!(graph.steps(&edge, Knowledge::Rollouts), 6.0);
        assert_eq!(graph.steps(&edge, Knowledge::Data), 3.0);
    }
}
