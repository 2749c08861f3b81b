//! What the networks of the low level see.

use nets::{Activation, Mlp, Workspace};
use simulator::{Body, Frame};

/// A subgoal: a place and its latent.
#[derive(Debug, Clone, Copy)]
pub struct Subgoal<'a> {
    /// World x, y (m).
    pub place: [f32; 2],
    /// Its latent.
    pub latent: &'a [f32],
}

/// Distances are seen up to this one (m).
const FAR: f32 = 5.0;
/// Features of the values beyond the body's view: nearness, absolute places.
pub(super) const VALUE_EXTRA: usize = 3 + 4;

/// The policy's shape: the body's own view, distance, and the latent step to the subgoal.
#[derive(Clone)]
pub struct Policy {
    pub(super) mlp: Mlp,
    latent: usize,
    pub(super) body: &'static dyn Body,
}

impl Policy {
    /// A policy of a body for latents of this width.
    #[must_use]
    pub fn new(body: &'static dyn Body, latent: usize, hidden: &[usize]) -> Self {
        let (inputs, actions) = (body.features() + 1 + latent, body.spaces().action.len());
        let sizes = [&[inputs], hidden, &[actions]].concat();
        Self {
            mlp: Mlp::new(&sizes, Activation::Gelu, false),
            latent,
            body,
        }
    }

    /// The network; its parameters are the policy's weights.
    #[must_use]
    pub fn mlp(&self) -> &Mlp {
        &self.mlp
    }

    /// Appends the input of one state and subgoal to `input`; `latent` is the state's own.
    pub fn input(
        &self,
        observation: &[f32],
        latent: &[f32],
        subgoal: Subgoal<'_>,
        input: &mut Vec<f32>,
    ) -> Frame {
        let [x, y] = self.body.place(observation);
        let (dx, dy) = (subgoal.place[0] - x, subgoal.place[1] - y);
        let frame = self.body.view(observation, [dx, dy], input);
        input.push(dx.hypot(dy).min(FAR) / FAR);
        let step = || {
            subgoal
                .latent
                .iter()
                .zip(latent)
                .map(|(goal, here)| goal - here)
        };
        let scale = 1.0 / step().map(|d| d * d).sum::<f32>().sqrt().max(0.1);
        input.extend(step().map(|d| d * scale).take(self.latent));
        frame
    }

    /// Mean actions of inputs `[batch, inputs]`, each in its own frame, clipped by the simulator.
    pub fn act<'w>(
        &self,
        weights: &[f32],
        input: &[f32],
        batch: usize,
        workspace: &'w mut Workspace,
    ) -> &'w [f32] {
        self.mlp.infer(weights, input, batch, workspace)
    }
}

/// Appends the input of the values for a state and a goal (m).
pub(super) fn value_input(
    body: &dyn Body,
    observation: &[f32],
    goal: [f32; 2],
    input: &mut Vec<f32>,
) {
    let [x, y] = body.place(observation);
    let (dx, dy) = (goal[0] - x, goal[1] - y);
    let distance = dx.hypot(dy);
    body.view(observation, [dx, dy], input);
    input.extend([
        distance.min(FAR) / FAR,
        (-distance).exp(),
        0.3 * distance.ln_1p(),
    ]);
    input.extend([x / 10.0, y / 10.0, goal[0] / 10.0, goal[1] / 10.0]);
}
