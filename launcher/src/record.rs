//! What a run records: metrics, throughput, score.

pub(crate) mod metrics;
pub(crate) mod score;
mod tensorboard;
pub(crate) mod throughput;
