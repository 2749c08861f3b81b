//! The trained walker: a policy of the observation and a direction.

use std::path::Path;

use agents::navigator::Controller;
use agents::walker::Policy;
use anyhow::Context;
use maze::{ACTION, Action, Egocentric};
use nets::Workspace;
use nets::file::ParameterFile;

/// Trained by `formica launch configs/walker.toml`.
const BUILT_IN: &[u8] = include_bytes!("../../assets/walker.safetensors");

/// A walker and the buffers of one ant.
#[derive(Clone)]
pub(crate) struct Walker {
    policy: Policy,
    weights: Vec<f32>,
    workspace: Workspace,
}

impl Walker {
    /// The walker of a file, or the one built in.
    ///
    /// # Errors
    /// A file that cannot be read or is no walker.
    pub(crate) fn load(path: Option<&Path>) -> anyhow::Result<Self> {
        let file = match path {
            Some(path) => ParameterFile::load(path),
            None => ParameterFile::from_bytes(BUILT_IN),
        };
        let name = path.map_or("the walker built in".to_owned(), |p| {
            p.display().to_string()
        });
        let file = file.with_context(|| name.clone())?;
        let hidden = file
            .metadata()
            .get("hidden")
            .context("no walker: it has no 'hidden'")?;
        let hidden: Vec<usize> = hidden
            .split(',')
            .map(|width| {
                width
                    .parse()
                    .ok()
                    .filter(|width| (1..=4096).contains(width))
            })
            .collect::<Option<_>>()
            .with_context(|| format!("{name}: 'hidden' is no list of widths"))?;
        let policy = Policy::new(&hidden);
        let mut weights = policy.mlp().from_tensors("policy", &file)?;
        weights.extend(file.tensor("log_std", &[ACTION])?);
        let workspace = policy.mlp().workspace(1);
        Ok(Self {
            policy,
            weights,
            workspace,
        })
    }

    /// A hash of the weights (FNV-1a, 16 hexadecimal digits).
    pub(crate) fn hash(&self) -> String {
        let bytes = self.weights.iter().flat_map(|value| value.to_le_bytes());
        let hash = bytes.fold(0xcbf2_9ce4_8422_2325_u64, |hash, byte| {
            (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3)
        });
        format!("{hash:016x}")
    }

    /// The walker as a low level.
    pub(crate) fn controller(&self) -> Controller {
        Controller::Walker(self.policy.clone(), self.weights.clone())
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
