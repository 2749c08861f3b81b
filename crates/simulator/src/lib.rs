//! What an actor steps, and what an algorithm knows of it.
//!
//! A [`Simulator`] is one environment. Its [`Body`] is what is known without one: spaces, and how an
//! observation is read. Neither knows an algorithm, a process or a file.

mod body;
mod rows;
mod space;

use rand::Rng;

pub use body::{Body, Columns, Frame, Part, Shape};
pub use rows::{Row, RowBuffer, RowLayout, RowValues, Rows, flags};
pub use space::{Dtype, Space, Spaces, SpacesError, Values};

/// Which tasks an episode is drawn from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Tasks {
    /// The benchmark's own, for a score.
    Evaluation,
    /// Any start and goal, to learn from.
    Training,
}

/// Where an episode starts and what it is to reach.
#[derive(Debug, Clone, PartialEq)]
pub struct Task {
    /// The place of the start, before reset noise (m).
    pub start: [f32; 2],
    /// The goal, as wide as the [`Spaces::goal`].
    pub goal: Vec<f32>,
}

/// What came of an action.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Step {
    /// Reward.
    pub reward: f32,
    /// Whether the goal is reached.
    pub success: bool,
    /// Whether the episode ended for good: nothing follows.
    pub terminated: bool,
    /// Whether the body cannot go on, as an ant on its back.
    pub fell: bool,
}

/// Bytes that are no state of this simulator.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("the state is not one of this simulator; replay it with the version that recorded it")]
pub struct StateError;

/// One environment, stepped by an actor.
pub trait Simulator: Send {
    /// What is known of it without an instance.
    fn body(&self) -> &'static dyn Body;

    /// Draws a task.
    fn draw(&self, tasks: Tasks, rng: &mut dyn Rng) -> Task;

    /// Begins an episode, with the benchmark's reset noise.
    fn reset(&mut self, task: &Task, rng: &mut dyn Rng);

    /// Takes a control step. Values beyond the bounds are clipped; those that are not finite or
    /// missing count as 0.
    fn step(&mut self, action: &[f32]) -> Step;

    /// The observation after the last step or reset.
    fn observation(&self) -> Values<'_>;

    /// The goal at the moment: that of the task, which some tasks change as they go on.
    fn goal(&self) -> &[f32];

    /// The goal that an observation reaches, appended to `goal`.
    fn goal_of(&self, observation: Values<'_>, goal: &mut Vec<f32>);

    /// The state as bytes, the goal included, from which [`restore`](Self::restore) continues bit by
    /// bit. `None` if the simulator cannot save its current state; some can only at an episode's start.
    fn state(&self) -> Option<Vec<u8>>;

    /// Continues from a state.
    ///
    /// # Errors
    /// [`StateError`] for bytes that are no state of it; nothing is changed then.
    fn restore(&mut self, state: &[u8]) -> Result<(), StateError>;

    /// Appends the pose of each of the body's [`parts`](Body::parts), to draw: x, y, z (m),
    /// quaternion w, x, y, z.
    fn poses(&self, poses: &mut Vec<[f32; 7]>);
}
