//! MCAP traces: one episode a file, in protobuf with its whole descriptor set, the one encoding
//! that Foxglove, Lichtblick, Rerun, PlotJuggler and the mcap tool all read. The only crate that
//! names mcap.
//!
//! | topic | schema | when |
//! |---|---|---|
//! | /scene/maze | foxglove.SceneUpdate: walls, goal | once |
//! | /scene/body | foxglove.SceneUpdate, locked to the parts' frames | once |
//! | /scene/choice | foxglove.SceneUpdate: from the node of the choice to the chosen one | each choice |
//! | /graph | foxglove.SceneUpdate: nodes, edges | once |
//! | /graph/nodes | foxglove.PosesInFrame | once |
//! | /graph/structure | formica.Graph: [`Graph`] | once |
//! | /points/walls, /points/body | foxglove.PointCloud, for viewers that draw no scene | once |
//! | /tf | foxglove.FrameTransforms of the body's parts | each step, and after the last |
//! | /goal | foxglove.PoseInFrame | once |
//! | /subgoal | foxglove.PoseInFrame | each change |
//! | /path | foxglove.PosesInFrame: last ten seconds, at the end all | each second |
//! | /start | formica.Start: [`Start`] | once |
//! | /step | formica.Step: [`Step`] | each step |
//! | /choice | formica.Choice: [`Choice`] | each choice |
//! | /outcome | formica.EdgeOutcome: [`EdgeOutcome`] | each choice reached or given up |
//! | /end | formica.End: [`End`] | once |
//! | /log | foxglove.Log: start, choices, what became of them, end | as it happens |
//!
//! /graph, /choice, /outcome and /scene/choice are in traces of algorithms with a graph, and what shows
//! the body in those of simulators that draw one. Older traces have /scene/ant and /points/ant instead
//! of /scene/body and /points/body.
//!
//! A message's log time is the wall clock at the start plus simulated time, so that a trace plays
//! at the speed of the simulated world. Attachments: `config.toml`, `layout.json` (a layout for
//! Foxglove and Lichtblick). Metadata records: [`METADATA`] first, [`OUTCOME`] last.
//!
//! Chunks are on disk each second, and a file is called `.part` until it is whole; [`recover`]
//! makes what is whole of one, or of a damaged one, into a trace.
//!
//! [`read`] takes any file that the format allows: messages in any order, chunks or none, any of the
//! format's compressions, topics and records of others, no index.

mod foreign;
mod lost;
mod message;
mod meta;
mod read;
mod record;
mod recorder;
mod recover;
mod scan;
mod scene;
#[cfg(feature = "live")]
mod serve;
mod still;
#[cfg(test)]
mod tests;
mod topic;
mod write;

pub use lost::Lost;
pub use message::{Choice, EdgeOutcome, End, Graph, Start, Step};
pub use meta::{EpisodeMeta, Outcome};
pub use read::{Trace, read, read_bytes, read_whole};
pub use record::{ChoiceRecord, EndRecord, OutcomeRecord, StateRecord, StepRecord};
pub use recorder::{Behind, Episode, Recorder};
pub use recover::{Recovered, recover, recover_bytes};
pub use scene::Scene;
#[cfg(feature = "live")]
pub use serve::Server;
pub use still::Still;
pub use write::EpisodeWriter;

/// Name of the metadata record of an episode, written at its start.
pub const METADATA: &str = "formica.episode";
/// Name of the metadata record of how it ended, written at its end.
pub const OUTCOME: &str = "formica.outcome";
/// Name of the metadata record of a trace that was recovered from a damaged one: what was lost.
pub const RECOVERED: &str = "formica.recovered";

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
    /// Nothing in a file is worth recovering.
    #[error("{path}: nothing can be recovered: {reason}")]
    Nothing {
        /// The file.
        path: String,
        /// Why.
        reason: String,
    },
    /// What is recovered cannot go where it should.
    #[error(transparent)]
    Output(#[from] durable::OutputError),
}
