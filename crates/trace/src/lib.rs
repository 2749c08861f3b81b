//! MCAP traces: one episode a file, in protobuf with its whole descriptor set, the one encoding
//! that Foxglove, Lichtblick, Rerun, PlotJuggler and the mcap tool all read. The only crate that
//! names mcap.
//!
//! | topic | schema | when |
//! |---|---|---|
//! | /scene | foxglove.SceneUpdate: walls, graph, goal | once |
//! | /ant | foxglove.SceneUpdate, locked to the bodies' frames | once |
//! | /tf | foxglove.FrameTransforms of the nine bodies | each step |
//! | /goal, /subgoal | foxglove.PoseInFrame | each step |
//! | /step | [`StepMessage`] | each step |

mod read;
mod scene;
mod write;

pub use read::{Summary, summary};
pub use scene::Scene;
pub use write::{EpisodeWriter, StepMessage, StepRecord};

/// Name of the metadata record of an episode.
pub const METADATA: &str = "formica.episode";

/// Why a trace could not be written or read.
#[derive(Debug, thiserror::Error)]
pub enum TraceError {
    /// The system refused.
    #[error("{path}: {source}")]
    Io {
        /// The file.
        path: String,
        /// What the system said.
        source: std::io::Error,
    },
    /// What mcap refused, or damage that it found.
    #[error("{path}: {reason}")]
    Mcap {
        /// The file.
        path: String,
        /// What was wrong.
        reason: String,
    },
}
