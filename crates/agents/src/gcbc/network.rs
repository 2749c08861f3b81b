//! The policy's network.

use nets::{Activation, Mlp};
use simulator::{Body, Frame};

/// Distances are seen up to this one (m).
const FAR: f32 = 5.0;
/// Absolute places are divided by this (m).
const SCALE: f32 = 10.0;
/// Inputs beyond the body's view: distance, places of body and goal.
const EXTRA: usize = 2 + 4;

/// The body's own view towards the goal, and where both are, to the mean action.
#[derive(Clone)]
pub(super) struct Shape {
    mlp: Mlp,
    body: &'static dyn Body,
}

impl Shape {
    pub(super) fn new(body: &'static dyn Body, hidden: &[usize]) -> Self {
        let (inputs, actions) = (body.features() + EXTRA, body.spaces().action.len());
        let sizes = [&[inputs], hidden, &[actions]].concat();
        Self {
            mlp: Mlp::new(&sizes, Activation::Gelu, false),
            body,
        }
    }

    pub(super) fn mlp(&self) -> &Mlp {
        &self.mlp
    }

    pub(super) fn body(&self) -> &'static dyn Body {
        self.body
    }

    /// Appends the input of a state and a goal (m). Actions are in the frame that is returned.
    pub(super) fn input(&self, observation: &[f32], goal: [f32; 2], input: &mut Vec<f32>) -> Frame {
        let [x, y] = self.body.place(observation);
        let (dx, dy) = (goal[0] - x, goal[1] - y);
        let distance = dx.hypot(dy);
        let frame = self.body.view(observation, [dx, dy], input);
        input.extend([distance.min(FAR) / FAR, (-distance).exp()]);
        input.extend([x, y, goal[0], goal[1]].map(|value| value / SCALE));
        frame
    }
}
