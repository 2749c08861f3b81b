//! A perfect planner for the walker: shortest paths over cells, as D4RL's data are made with.

use crate::layout::{Cell, Layout};

/// The way to one goal.
#[derive(Debug, Clone)]
pub struct Route {
    distances: Vec<Option<u32>>,
    goal: [f32; 2],
    goal_cell: Cell,
}

impl Route {
    /// The way to a goal (m) in a cell.
    #[must_use]
    pub fn new(layout: &Layout, goal: [f32; 2], goal_cell: Cell) -> Self {
        Self {
            distances: layout.distances(goal_cell),
            goal,
            goal_cell,
        }
    }

    /// The goal (m).
    #[must_use]
    pub fn goal(&self) -> [f32; 2] {
        self.goal
    }

    /// Where to walk from a place (m): the centre of the next cell, or the goal itself in its
    /// own cell; the nearest free cell's centre from within a wall.
    #[must_use]
    pub fn waypoint(&self, layout: &Layout, place: [f32; 2]) -> [f32; 2] {
        let cell = layout.cell_at(place).filter(|&cell| !layout.is_wall(cell));
        match cell {
            Some(cell) if cell == self.goal_cell => self.goal,
            Some(cell) => layout.centre(layout.next_cell(&self.distances, cell)),
            None => layout.centre(layout.nearest_free(place)),
        }
    }

    /// The direction to walk in from a place (m), not of unit length.
    #[must_use]
    pub fn direction(&self, layout: &Layout, place: [f32; 2]) -> [f32; 2] {
        let [x, y] = self.waypoint(layout, place);
        [x - place[0], y - place[1]]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn waypoints_lead_through_free_cells_to_the_goal() {
        let layout = Layout::named("large").unwrap();
        let cell = layout.goals()[0];
        let goal = [33.0, 25.0];
        let route = Route::new(&layout, goal, cell);
        let mut place = [0.0, 0.0];
        for _ in 0..200 {
            let [dx, dy] = route.direction(&layout, place);
            let length = dx.hypot(dy).max(1e-6);
            place = [place[0] + 0.4 * dx / length, place[1] + 0.4 * dy / length];
            assert!(!layout.is_wall_at(place));
        }
        assert!(
            (place[0] - goal[0]).hypot(place[1] - goal[1]) < 0.5,
            "{place:?}"
        );
    }
}
