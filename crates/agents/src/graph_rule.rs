//! How an algorithm makes its graph, and what rollouts change of it.

use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use dataset::Dataset;
use graph::{Graph, GraphError};

use crate::parts::Parts;
use crate::rollout::Rollout;

/// Why no graph can be made.
#[derive(Debug, thiserror::Error)]
pub enum BuildError {
    /// The weights that it is made with.
    #[error("the encoder's weights do not fit its shape")]
    Encoder,
    /// Too few states, or ones that are all alike.
    #[error("of {rows} rows, {moving} show the body under way: {reason}")]
    Cluster {
        /// Rows of the data set.
        rows: usize,
        /// Those that were clustered.
        moving: usize,
        /// What is wrong.
        reason: graph::kmeans::KMeansError,
    },
    /// A state that a graph-builder before kept.
    #[error("the graph that was kept: {0}")]
    Kept(#[from] GraphError),
    /// A graph that leads nowhere, or that its readers would refuse.
    #[error(transparent)]
    Unusable(#[from] graph::Unusable),
}

/// How a graph is made.
pub trait GraphRule: Send + Sync {
    /// Networks, by number, whose weights it is made with.
    fn after(&self) -> Vec<usize>;

    /// Bytes that a graph takes at most.
    fn max_bytes(&self) -> usize;

    /// Reads a graph's bytes.
    ///
    /// # Errors
    /// Bytes that are no graph of this run.
    fn read(&self, bytes: &[u8]) -> Result<Graph, GraphError>;

    /// Time between two versions while rollouts come in.
    fn refresh(&self) -> Duration;

    /// Builds the graph of a data set. It takes seconds. What is computed of all rows on the way is left
    /// in the run's `folder`, for stages to find.
    ///
    /// # Errors
    /// Data or weights that make no graph.
    fn build(
        &self,
        data: &Dataset,
        parts: &Parts,
        folder: &Path,
    ) -> Result<Box<dyn GraphWork>, BuildError>;

    /// Goes on from what [`GraphWork::save`] gave; with the version that was published last.
    ///
    /// # Errors
    /// A state that is not of this run.
    fn restore(
        &self,
        saved: &[u8],
        parts: &Parts,
    ) -> Result<(Box<dyn GraphWork>, Graph), BuildError>;
}

/// A graph that rollouts change.
pub trait GraphWork: Send {
    /// Counts what a rollout did on the graph.
    fn learn(&mut self, rollout: &Rollout<'_>);

    /// Whether rollouts have changed something since the last version.
    fn has_changed(&self) -> bool;

    /// The next version, of at most `limit` bytes. Its metrics are appended to `metrics`; the step
    /// of each is the graph's version.
    ///
    /// # Errors
    /// A first version that is unusable.
    fn renew(
        &mut self,
        limit: usize,
        metrics: &mut Vec<(&'static str, f64)>,
    ) -> Result<Arc<Graph>, BuildError>;

    /// Everything that its successor goes on from.
    fn save(&self) -> Vec<u8>;

    /// A line for the status.
    fn status(&self) -> String;
}
