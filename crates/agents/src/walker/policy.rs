//! The walker's network, and its shipped weights.

use std::path::Path;
use std::sync::Arc;

use maze::{ACTION, EGOCENTRIC};
use nets::file::{FileError, ParameterFile};
use nets::{Activation, Mlp, Workspace};
use rand::Rng;
use rand_distr::{Distribution, StandardNormal};

use super::gaussian::LOG_TAU;

/// Shape of the walker's policy: features to mean action, and a free log standard deviation.
#[derive(Debug, Clone)]
pub struct Policy {
    mlp: Mlp,
}

impl Policy {
    /// A policy with these hidden layers.
    #[must_use]
    pub fn new(hidden: &[usize]) -> Self {
        let sizes = [&[EGOCENTRIC], hidden, &[ACTION]].concat();
        Self {
            mlp: Mlp::new(&sizes, Activation::Tanh, false),
        }
    }

    /// The network.
    #[must_use]
    pub fn mlp(&self) -> &Mlp {
        &self.mlp
    }

    /// Length of the flat weights: the network's, then 8 log standard deviations.
    #[must_use]
    pub fn weights(&self) -> usize {
        self.mlp.parameters() + ACTION
    }

    /// Fresh weights.
    pub fn init(&self, log_std: f32, rng: &mut impl Rng) -> Vec<f32> {
        let mut weights = self.mlp.init(rng, 0.01);
        weights.extend([log_std; ACTION]);
        weights
    }

    /// Mean actions `[batch, 8]` of features `[batch, 28]`, in each feature's own frame.
    pub fn mean<'w>(
        &self,
        weights: &[f32],
        features: &[f32],
        batch: usize,
        workspace: &'w mut Workspace,
    ) -> &'w [f32] {
        self.mlp.infer(
            &weights[..self.mlp.parameters()],
            features,
            batch,
            workspace,
        )
    }

    /// The log standard deviations within flat weights.
    #[must_use]
    pub fn log_std<'w>(&self, weights: &'w [f32]) -> &'w [f32] {
        &weights[self.mlp.parameters()..]
    }
}

/// Samples an action around `mean` and returns its log-probability.
pub(super) fn sample(mean: &[f32], log_std: &[f32], rng: &mut impl Rng, action: &mut [f32]) -> f32 {
    let mut log_prob = 0.0;
    for ((action, mean), log_std) in action.iter_mut().zip(mean).zip(log_std) {
        let noise: f32 = StandardNormal.sample(rng);
        *action = mean + log_std.exp() * noise;
        log_prob -= 0.5 * noise * noise + log_std + 0.5 * LOG_TAU;
    }
    log_prob
}

/// Trained by `formica launch configs/walker.toml`.
const SHIPPED: &[u8] = include_bytes!("../../../../assets/walker.safetensors");

/// Why there is no walker.
#[derive(Debug, thiserror::Error)]
pub enum WalkerError {
    /// No parameter file, or one of other shapes.
    #[error("{name}: {reason}")]
    File {
        /// The file.
        name: String,
        /// What is wrong with it.
        reason: FileError,
    },
    /// A parameter file of something else.
    #[error("{0}: is no walker: its metadata have no 'hidden' with the widths of its layers")]
    Other(String),
}

/// The walker of a file, or the one that is shipped: its shape and weights.
///
/// # Errors
/// A file that cannot be read or is no walker.
pub fn load(path: Option<&Path>) -> Result<(Policy, Vec<f32>), WalkerError> {
    let name = path.map_or("the shipped walker".to_owned(), |p| p.display().to_string());
    let failed = |reason| WalkerError::File {
        name: name.clone(),
        reason,
    };
    let file = match path {
        Some(path) => ParameterFile::load(path),
        None => ParameterFile::from_bytes(SHIPPED),
    };
    let file = file.map_err(failed)?;
    let widths = file.metadata().get("hidden").map(|text| {
        let widths = text.split(',').map(|width| width.parse().ok());
        let widths: Option<Vec<usize>> = widths.collect();
        widths.filter(|all| all.len() <= 8 && all.iter().all(|w| (1..=4096).contains(w)))
    });
    let Some(hidden) = widths.flatten() else {
        return Err(WalkerError::Other(name));
    };
    let policy = Policy::new(&hidden);
    let mut weights = policy.mlp().from_tensors("policy", &file).map_err(failed)?;
    weights.extend(file.tensor("log_std", &[ACTION]).map_err(failed)?);
    Ok((policy, weights))
}

/// The shipped walker. A build whose asset is no walker has one that stands still.
#[must_use]
pub fn shipped() -> (Policy, Arc<[f32]>) {
    let (policy, weights) = load(None).unwrap_or_else(|_| {
        let policy = Policy::new(&[1]);
        let weights = vec![0.0; policy.weights()];
        (policy, weights)
    });
    (policy, weights.into())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_shipped_walker_is_one() {
        let (policy, weights) = load(None).unwrap();
        assert_eq!(weights.len(), policy.weights());
        assert!(weights.iter().any(|weight| *weight != 0.0));
    }

    #[test]
    fn what_is_no_walker_is_refused_by_name() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("other.safetensors");
        nets::file::save(&path, &[], &Default::default()).unwrap();
        let message = load(Some(&path)).unwrap_err().to_string();
        assert!(
            message.contains("other.safetensors: is no walker"),
            "{message}"
        );
        let missing = load(Some(&folder.path().join("none"))).unwrap_err();
        assert!(matches!(missing, WalkerError::File { .. }));
    }
}
