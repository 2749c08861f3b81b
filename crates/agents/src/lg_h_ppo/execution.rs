//! `[execution]`: how both levels work together.

use config::{OnResume, Table};
use graph::EdgeTimeout;

/// `[execution]`
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// A node is reached within this distance of its place (m).
    pub reached_radius: f32,
    /// Within this distance the goal itself is the subgoal (m).
    pub goal_radius: f32,
    /// Nodes that the subgoal may lie ahead, when the most likely ones are chosen.
    pub look_ahead: usize,
    /// When an edge is given up: `timeout_factor` times its mean steps, `max_edge_steps` at most.
    pub timeout: EdgeTimeout,
}

impl Settings {
    /// Reads the table.
    pub fn read(t: &mut Table<'_, '_>) -> Self {
        let mut number = |key, default, range| {
            t.on_resume(OnResume::Protocol).number(key, default, range) as f32
        };
        let reached_radius = number("reached_radius", 0.75, [0.1, 10.0]);
        let goal_radius = number("goal_radius", 2.5, [0.0, 100.0]);
        let look_ahead = t
            .on_resume(OnResume::Protocol)
            .count("look_ahead", 2, [1, 16]);
        let factor = t
            .on_resume(OnResume::Protocol)
            .number("timeout_factor", 2.0, [1.0, 100.0]) as f32;
        let most = t
            .on_resume(OnResume::Protocol)
            .count("max_edge_steps", 40, [1, 10_000]);
        Self {
            reached_radius,
            goal_radius,
            look_ahead,
            timeout: EdgeTimeout { factor, most },
        }
    }
}
