//! MCAP traces: one episode a file, in protobuf with its whole descriptor set, the one encoding
//! that Foxglove, Lichtblick, Rerun, PlotJuggler and the mcap tool all read. The only crate that
//! names mcap.
//!
//! | topic | schema | when |
//! |---|---|---|
//! | /scene/maze | foxglove.SceneUpdate: walls, goal | once |
//! | /scene/ant | foxglove.SceneUpdate, locked to the bodies' frames | once |
//! | /graph | foxglove.SceneUpdate: nodes, edges | once |
//! | /graph/nodes | foxglove.PosesInFrame | once |
//! | /tf | foxglove.FrameTransforms of the nine bodies | each step |
//! | /goal, /subgoal | foxglove.PoseInFrame | each step |
//! | /step | formica.Step: [`Step`] | each step |
//! | /path | foxglove.PosesInFrame: last ten seconds, at the end all | each second |
//! | /log | foxglove.Log: start, changes of subgoal, end | as it happens |
//!
//! A message's log time is the wall clock at the start plus simulated time, so that a trace plays
//! at the speed of the simulated world. Attachments: `config.toml`, `layout.json` (a layout for
//! Foxglove and Lichtblick). Metadata record: [`METADATA`].

mod meta;
mod read;
mod scene;
mod step;
mod write;

pub use meta::{EpisodeMeta, Outcome};
pub use read::{Summary, steps, summary};
pub use scene::Scene;
pub use step::{Step, StepMessage, StepRecord};
pub use write::EpisodeWriter;

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
