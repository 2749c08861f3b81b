//! How long the parts of a run took.

use std::time::Duration;

use serde::{Deserialize, Serialize};

/// Wall-clock time of each part of a run.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Times {
    /// Collecting the data set; zero if it was already there.
    pub collect: Duration,
    /// From the first process to the last weights.
    pub train: Duration,
    /// Rollouts after that, or rounds.
    pub rollouts: Duration,
    /// Evaluation.
    pub evaluate: Duration,
}
