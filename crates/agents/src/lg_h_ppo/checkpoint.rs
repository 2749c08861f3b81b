//! Weights of another run's checkpoint.

use std::path::Path;

use nets::file::ParameterFile;

use crate::stage::{Metrics, Progress, Publication, Stage, StageError};

/// Reads the flat weights of a checkpoint, of a network with so many.
///
/// # Errors
/// A file that is not there or holds other weights.
pub fn load(path: &str, weights: usize) -> Result<Vec<f32>, StageError> {
    let file = ParameterFile::load(Path::new(path));
    let tensor = file.and_then(|file| file.tensor("weights", &[weights]));
    tensor.map_err(|reason| StageError::Checkpoint {
        path: path.to_owned(),
        reason,
    })
}

/// A stage whose weights are known from the start.
pub(super) struct Given {
    /// The network, by number.
    pub(super) network: usize,
    /// Its weights.
    pub(super) weights: Vec<f32>,
}

impl Stage for Given {
    fn update(&mut self, _: &mut Metrics) -> bool {
        false
    }

    fn updates(&self) -> u64 {
        1
    }

    fn progress(&self) -> Progress {
        Progress::default()
    }

    fn is_done(&self) -> bool {
        true
    }

    fn publications(&self) -> Vec<Publication> {
        vec![Publication {
            network: self.network,
            version: 1,
            weights: self.weights.clone(),
            graph: None,
        }]
    }

    fn save(&self) -> Vec<u8> {
        vec![]
    }
}
