//! `progress.json`, from which the launcher continues when a run is resumed.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use runs::times::Times;
use serde::{Deserialize, Serialize};
use wire::{EpisodeResult, Versions};

use super::delivery_audit::DeliveryAudit;

/// Time between two writes.
const EVERY: Duration = Duration::from_secs(2);

/// The progress of a run.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub(crate) struct RunProgress {
    /// Time that the run has taken (s).
    pub(crate) seconds: f64,
    /// Time of each part.
    pub(crate) times: Times,
    /// Whether training is complete.
    pub(crate) trained: bool,
    /// Time since the start of the current part (s).
    pub(crate) since: f64,
    /// Versions of weights and graph of the results.
    pub(crate) evaluated: Versions,
    /// Results of the evaluation.
    pub(crate) results: Vec<EpisodeResult>,
    /// Whether graph and weights are final, and only the evaluation is left.
    #[serde(default)]
    pub(crate) settled: bool,
    /// Whether the run is complete.
    #[serde(default)]
    pub(crate) finished: bool,
    /// Restarts of processes.
    pub(crate) restarts: usize,
    /// Deliveries of the actors.
    #[serde(rename = "accounts")]
    pub(crate) audit: DeliveryAudit,
}

/// Reads and writes `progress.json`.
pub(crate) struct ProgressFile {
    path: PathBuf,
    saved: Instant,
    failed: bool,
}

impl ProgressFile {
    pub(crate) fn new(folder: &Path) -> Self {
        Self {
            path: folder.join("progress.json"),
            saved: Instant::now(),
            failed: false,
        }
    }

    pub(crate) fn is_due(&self) -> bool {
        self.saved.elapsed() >= EVERY
    }

    /// Writes the file. Returns the first error; a full disk does not end the run.
    pub(crate) fn save(&mut self, progress: &RunProgress) -> Option<String> {
        self.saved = Instant::now();
        let written = serde_json::to_vec(progress)
            .map_err(std::io::Error::from)
            .and_then(|bytes| durable::write(&self.path, &bytes));
        let failed_before = std::mem::replace(&mut self.failed, written.is_err());
        let error = written.err().filter(|_| !failed_before)?;
        Some(format!("{} is not written: {error}", self.path.display()))
    }

    /// Reads what an earlier launcher of the run wrote.
    pub(crate) fn load(&self) -> Option<RunProgress> {
        let bytes = std::fs::read(&self.path).ok()?;
        match serde_json::from_slice(&bytes) {
            Ok(progress) => Some(progress),
            Err(error) => {
                log::warn!(
                    "{} is damaged ({error}); times and results begin anew",
                    self.path.display()
                );
                None
            }
        }
    }
}
