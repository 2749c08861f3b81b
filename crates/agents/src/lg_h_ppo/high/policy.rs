//! The shapes of the high level's networks.

use nets::{Activation, Mlp, Workspace};

/// Frequencies of the Fourier features of a latent.
const FREQUENCIES: [f32; 4] = [1.0, 2.0, 4.0, 8.0];

/// The shapes of policy and critic over a graph's nodes. Those who act have the weights of both in
/// one: the policy's, then the critic's.
#[derive(Debug, Clone)]
pub struct Policy {
    pub(super) mlp: Mlp,
    pub(super) critic: Mlp,
    latent: usize,
}

fn input_width(latent: usize) -> usize {
    let embedding = latent * (1 + 2 * FREQUENCIES.len());
    2 * embedding + latent
}

impl Policy {
    /// A policy with `nodes` logits over latents of this width.
    #[must_use]
    pub fn new(latent: usize, nodes: usize, hidden: &[usize]) -> Self {
        let network = |outputs: usize| {
            let sizes = [&[input_width(latent)], hidden, &[outputs]].concat();
            Mlp::new(&sizes, Activation::Gelu, false)
        };
        Self {
            mlp: network(nodes),
            critic: network(1),
            latent,
        }
    }

    /// The policy's network.
    #[must_use]
    pub fn mlp(&self) -> &Mlp {
        &self.mlp
    }

    /// Number of weights, the critic's included.
    #[must_use]
    pub fn weights(&self) -> usize {
        self.mlp.parameters() + self.critic.parameters()
    }

    /// Room to act in.
    #[must_use]
    pub fn workspaces(&self) -> [Workspace; 2] {
        [self.mlp.workspace(1), self.critic.workspace(1)]
    }

    /// Appends the input of a node's latent and the goal's latent.
    pub fn input(&self, node: &[f32], goal: &[f32], input: &mut Vec<f32>) {
        embed(node, goal, self.latent, input);
    }

    /// Logits `[nodes]` for one input; only those of neighbours mean anything.
    pub fn logits<'w>(
        &self,
        weights: &[f32],
        input: &[f32],
        [workspace, _]: &'w mut [Workspace; 2],
    ) -> &'w [f32] {
        let weights = &weights[..self.mlp.parameters()];
        self.mlp.infer(weights, input, 1, workspace)
    }

    /// The critic's value of one input: the sum of discounted rewards to come.
    pub fn value(
        &self,
        weights: &[f32],
        input: &[f32],
        [_, workspace]: &mut [Workspace; 2],
    ) -> f32 {
        let weights = &weights[self.mlp.parameters()..];
        self.critic.infer(weights, input, 1, workspace)[0]
    }
}

fn embed(node: &[f32], goal: &[f32], latent: usize, input: &mut Vec<f32>) {
    for z in [node, goal] {
        input.extend_from_slice(&z[..latent]);
        for frequency in FREQUENCIES {
            for value in &z[..latent] {
                let (sin, cos) = (value * frequency * std::f32::consts::FRAC_PI_4).sin_cos();
                input.extend([sin, cos]);
            }
        }
    }
    input.extend(node.iter().zip(goal).map(|(a, b)| b - a).take(latent));
}
