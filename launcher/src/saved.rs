//! What the launcher itself goes on from when a run is resumed: `progress.json`.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use serde::{Deserialize, Serialize};
use wire::EpisodeResult;

use crate::accounts::Accounts;
use crate::stages::Times;

/// Time between two of them.
const EVERY: Duration = Duration::from_secs(2);

/// Where a run is.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub(crate) struct Saved {
    /// Time that the run has taken (s).
    pub(crate) seconds: f64,
    /// Of which its parts took.
    pub(crate) times: Times,
    /// Whether all weights are there.
    pub(crate) trained: bool,
    /// Time since the present part began (s).
    pub(crate) since: f64,
    /// Versions of low, high and graph that the results are of.
    pub(crate) evaluated: [u64; 3],
    /// Of the evaluation.
    pub(crate) results: Vec<EpisodeResult>,
    /// Whether the graph and the weights on it are final: only the evaluation is left.
    #[serde(default)]
    pub(crate) settled: bool,
    /// Whether all is done.
    #[serde(default)]
    pub(crate) finished: bool,
    /// Processes started again.
    pub(crate) restarts: usize,
    /// Of the actors.
    pub(crate) accounts: Accounts,
}

/// Writes it now and then.
pub(crate) struct Saver {
    path: PathBuf,
    saved: Instant,
    failed: bool,
}

impl Saver {
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

    /// A disk that is full costs this file, not the run: what went wrong, the first time.
    pub(crate) fn save(&mut self, saved: &Saved) -> Option<String> {
        self.saved = Instant::now();
        let written = serde_json::to_vec(saved)
            .map_err(std::io::Error::from)
            .and_then(|bytes| durable::write(&self.path, &bytes));
        let failed_before = std::mem::replace(&mut self.failed, written.is_err());
        let error = written.err().filter(|_| !failed_before)?;
        Some(format!("{} is not written: {error}", self.path.display()))
    }

    /// What an earlier launcher of the run wrote.
    pub(crate) fn load(&self) -> Option<Saved> {
        let bytes = std::fs::read(&self.path).ok()?;
        match serde_json::from_slice(&bytes) {
            Ok(saved) => Some(saved),
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
