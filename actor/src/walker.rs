//! The trained walker: a policy of the observation and a direction.

use std::path::Path;

use agents::walker::{Policy, WalkerError, load};
use maze::{Action, Egocentric};
use nets::Workspace;
use simulator::Body;

/// A walker and the buffers of one ant.
#[derive(Clone)]
pub(crate) struct Walker {
    policy: Policy,
    weights: Vec<f32>,
    workspace: Workspace,
}

impl Walker {
    /// The walker of a file, or the one that is shipped.
    ///
    /// # Errors
    /// A file that cannot be read or is no walker.
    pub(crate) fn load(path: Option<&Path>) -> Result<Self, WalkerError> {
        let (policy, weights) = load(path)?;
        let workspace = policy.mlp().workspace(1);
        Ok(Self {
            policy,
            weights,
            workspace,
        })
    }

    /// Whether its network reads what a body views and gives that body's actions.
    pub(crate) fn fits(&self, body: &dyn Body) -> bool {
        let mlp = self.policy.mlp();
        (mlp.inputs(), mlp.outputs()) == (body.features(), body.spaces().action.len())
    }

    /// A hash of the weights (FNV-1a, 16 hexadecimal digits).
    pub(crate) fn hash(&self) -> String {
        let bytes = self.weights.iter().flat_map(|value| value.to_le_bytes());
        let hash = bytes.fold(0xcbf2_9ce4_8422_2325_u64, |hash, byte| {
            (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3)
        });
        format!("{hash:016x}")
    }

    /// The mean action in an observation (29 values) towards a world direction.
    pub(crate) fn act(&mut self, observation: &[f32], direction: [f32; 2]) -> Action {
        let frame = Egocentric::new(observation, direction);
        let mean = self
            .policy
            .mean(&self.weights, &frame.features, 1, &mut self.workspace);
        frame.to_actuators(mean)
    }
}
