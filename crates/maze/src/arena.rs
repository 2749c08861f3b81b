//! What all bodies share: a maze, a goal in it, and when the goal is reached.

use rand::Rng;
use simulator::{Step, Task, Tasks};

use crate::{Layout, Style, evaluation_task, random_task};

/// A maze with the goal of the episode.
#[derive(Debug, Clone)]
pub(crate) struct Arena {
    pub(crate) layout: Layout,
    success_radius: f32,
    /// NaN, which is never reached, before the first episode.
    goal: [f32; 2],
}

impl Arena {
    pub(crate) fn new(layout: &Layout, success_radius: f32) -> Self {
        Self {
            layout: layout.clone(),
            success_radius,
            goal: [f32::NAN; 2],
        }
    }

    pub(crate) fn draw(&self, tasks: Tasks, rng: &mut dyn Rng) -> Task {
        match tasks {
            Tasks::Evaluation => evaluation_task(&self.layout, rng),
            Tasks::Training => random_task(&self.layout, Style::Diverse, rng),
        }
        .into()
    }

    /// Sets the goal; one that is not two coordinates is never reached.
    pub(crate) fn set_goal(&mut self, goal: &[f32]) {
        self.goal = goal.try_into().unwrap_or([f32::NAN; 2]);
    }

    pub(crate) fn goal(&self) -> &[f32; 2] {
        &self.goal
    }

    /// What came of an action that led to a place (m).
    pub(crate) fn step(&self, [x, y]: [f32; 2], fell: bool) -> Step {
        let success = (self.goal[0] - x).hypot(self.goal[1] - y) <= self.success_radius;
        Step {
            reward: f32::from(u8::from(success)),
            success,
            terminated: success,
            fell,
        }
    }
}
