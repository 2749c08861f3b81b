//! Every message between the processes of a run, its service, size and limits, over iceoryx2.
//! The only crate that names iceoryx2.
//!
//! | service | from -> to | payload |
//! |---|---|---|
//! | trajectories | actors -> learner, graph-builder | [rows](simulator::Rows) and choices behind a [`TrajectoryHeader`] |
//! | acknowledgements | learner, graph-builder -> actors | next sequence number of each actor |
//! | weights-* | learner -> all | flat f32 of a [`Part`] |
//! | graph | graph-builder -> all | bytes of the graph file |
//! | directive | launcher -> all | [`Directive`], latest value |
//! | status, metrics, results | all -> launcher | [`Status`], [`Metric`], [`EpisodeResult`] |
//!
//! iceoryx2 alone does not promise that nothing is lost: a publisher drops what a reader that has
//! not yet connected should have got, and a blocking one hangs when a reader stalls. So an actor
//! says hello until every required reader has acknowledged it, and keeps no more trajectories
//! unacknowledged than a reader's buffer holds; sending then never blocks and never drops.

mod allowance;
mod bus;
mod cause;
mod directive;
mod domain;
mod latest;
mod ledger;
mod limits;
mod logging;
mod reader;
mod receiver;
mod records;
mod reports;
mod round;
mod sender;
mod status;
#[cfg(test)]
mod tests;

use std::hash::{BuildHasher, RandomState};
use std::path::PathBuf;
use std::sync::OnceLock;

pub use bus::{Bus, Claim, Waker};
pub use cause::Cause;
pub use directive::{Directive, MAX_EPISODES, Phase};
pub use domain::{
    Kept, Leftover, Liveness, RunDomain, SHARED_MEMORY, SOCKETS, Unseen, clear, clear_unseen,
    leftovers, shared_memory_available, shared_memory_is_in_memory, sockets_available,
};
pub use latest::{
    DirectivePublisher, DirectiveSubscriber, GraphPublisher, GraphSubscriber, Weights,
    WeightsPublisher, WeightsSubscriber,
};
pub use ledger::{Books, Counts, Source};
pub use limits::{Limits, Part};
pub use reader::Reader;
pub use receiver::{Trajectory, TrajectoryReceiver};
pub use records::{GRAPH, Kind, LAYOUT, MAX_ACTORS, PARTS, TrajectoryHeader, Versions};
pub use reports::{ReportReader, Reporter};
pub use round::{OwnedTrajectory, Rounds};
pub use sender::{Drained, TrajectorySender};
pub use status::{EpisodeResult, Metric, Role, State, Status};

/// A number for this process that no other of a run has. It is drawn: process ids come again, and
/// are the same in several PID namespaces; clocks are set back.
#[must_use]
pub fn incarnation() -> u32 {
    static NUMBER: OnceLock<u32> = OnceLock::new();
    *NUMBER.get_or_init(|| random() | 1)
}

/// A number that the system draws.
fn random() -> u32 {
    // The standard library's hasher has its key from the system, another one each time.
    (RandomState::new().hash_one(()) >> 32) as u32
}

/// Why a channel could not be used.
#[derive(Debug, thiserror::Error)]
pub enum WireError {
    /// The run's folder of channels could not be made or read.
    #[error("'{path}': {reason}")]
    Io {
        /// The file or folder.
        path: String,
        /// What the system said.
        reason: std::io::Error,
    },
    /// A place where channels lie is missing or closed.
    #[error("channels cannot lie in '{}': {fault}; {remedy}", .path.display())]
    Unfit {
        /// The place.
        path: PathBuf,
        /// What is wrong with it.
        fault: String,
        /// What to do.
        remedy: &'static str,
    },
    /// Something stands where this user's folder of channels should be.
    #[error(
        "{unseen}, where a folder of this user is needed; remove it or let its owner do so, \
             then launch again"
    )]
    Obstructed {
        /// The folder that is needed.
        folder: PathBuf,
        /// What stands there.
        unseen: Unseen,
    },
    /// No run of this id is alive.
    #[error("no run '{0}' is alive on this machine; see `formica doctor`")]
    NoSuchRun(String),
    /// A run's channels are not to be seen from here, wholly or in part.
    #[error(
        "the channels of run '{id}' are not visible from here: there is no '{}'; join it from where \
         it was launched, or from a container or service with the same /tmp and /dev/shm{removed}",
        .path.display()
    )]
    Hidden {
        /// The run's domain.
        id: String,
        /// What is not there.
        path: PathBuf,
        /// How else it may have gone, as the end of a sentence.
        removed: &'static str,
    },
    /// It cannot be told whether a run is alive.
    #[error("it cannot be told whether run '{id}' is alive: {unseen}")]
    Unseen {
        /// The run's domain.
        id: String,
        /// Why.
        unseen: Unseen,
    },
    /// Another version of formica hosts the run.
    #[error(
        "the run speaks channel layout {theirs}, this program {ours}; use one version for both"
    )]
    Layout {
        /// Layout of the run.
        theirs: u32,
        /// Layout of this program.
        ours: u32,
    },
    /// A process got no place on the channels.
    #[error("'{name}' cannot join the run's channels: {cause}")]
    Join {
        /// The process, as its node is called.
        name: String,
        /// Why, as far as it can be told.
        cause: Cause,
    },
    /// A service or port could not be made.
    #[error("channel '{service}' cannot {action}: {cause}")]
    Service {
        /// The service.
        service: String,
        /// What was tried.
        action: &'static str,
        /// Why, as far as it can be told.
        cause: Cause,
    },
    /// The system lets a process have less than the run can need.
    #[error(
        "a process may have {limit} {what} here, and one of this run can need {needed}; raise the \
         limit with `ulimit -{letter} {needed}`, {elsewhere}, or lower topology.max_actors"
    )]
    Limited {
        /// Of what.
        what: &'static str,
        /// Letter of the shell's `ulimit`.
        letter: char,
        /// What a process may have.
        limit: u64,
        /// What it can need.
        needed: u64,
        /// Where else the limit is set.
        elsewhere: &'static str,
    },
    /// The run's algorithm has no such network.
    #[error("the run has no network of number {0}; use one version of formica for all processes")]
    NoPart(usize),
    /// A required reader did not answer in time.
    #[error("{reader} did not answer actor {actor} within {seconds:.0} s")]
    NoAnswer {
        /// The reader.
        reader: &'static str,
        /// The actor.
        actor: u32,
        /// The deadline.
        seconds: f64,
    },
    /// Another process is this actor.
    #[error("the run has an actor {0} already")]
    Taken(u32),
    /// Every place for an attached actor is taken.
    #[error(
        "the run's {0} places for actors are taken; let one leave, or launch with a larger \
         topology.max_actors"
    )]
    Full(usize),
    /// A message longer than the run's limits allow.
    #[error("{what} of {got} values is beyond the run's limit of {limit}")]
    TooLong {
        /// What was to be sent.
        what: &'static str,
        /// Its length.
        got: usize,
        /// The limit.
        limit: usize,
    },
}
