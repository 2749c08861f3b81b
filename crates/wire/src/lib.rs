//! Every message between the processes of a run, its service, size and limits, over iceoryx2.
//! The only crate that names iceoryx2.
//!
//! | service | from -> to | payload |
//! |---|---|---|
//! | trajectories | actors -> learner, graph-builder | [`Transition`]s behind a [`TrajectoryHeader`] |
//! | acknowledgements | learner, graph-builder -> actors | next sequence number of each actor |
//! | weights-* | learner -> all | flat f32 of a [`Module`] |
//! | graph | graph-builder -> all | bytes of the graph file |
//! | directive | launcher -> all | [`Directive`], latest value |
//! | status, metrics, results | all -> launcher | [`Status`], [`Metric`], [`EpisodeResult`] |
//!
//! iceoryx2 alone does not promise that nothing is lost: a publisher drops what a reader that has
//! not yet connected should have got, and a blocking one hangs when a reader stalls. So an actor
//! says hello until every required reader has acknowledged it, and keeps no more trajectories
//! unacknowledged than a reader's buffer holds; sending then never blocks and never drops.

mod bus;
mod choices;
mod domain;
mod latest;
mod ledger;
mod logging;
mod records;
mod reports;
mod round;
mod trajectories;

use std::sync::OnceLock;
use std::time::{SystemTime, UNIX_EPOCH};

pub use bus::{Bus, Claim, Limits, Waker, shared_memory_available};
pub use choices::settled;
pub use domain::{Leftover, RunDomain, clear, leftovers};
pub use latest::{
    DirectivePublisher, DirectiveSubscriber, GraphPublisher, GraphSubscriber, Weights,
    WeightsPublisher, WeightsSubscriber,
};
pub use ledger::{Books, Source};
pub use records::{
    ACTION, Directive, EpisodeResult, Kind, LAYOUT, MAX_ACTORS, MAX_EPISODES, Metric, Module,
    OBSERVATION, Phase, Reader, Role, State, Status, TrajectoryHeader, Transition, flags,
};
pub use reports::{ReportReader, Reporter};
pub use round::{Rounds, Trajectory};
pub use trajectories::{Counts, Drained, TrajectoryReceiver, TrajectorySender};

/// A number for this process that no other of a run has: process ids come again.
#[must_use]
pub fn incarnation() -> u32 {
    static NUMBER: OnceLock<u32> = OnceLock::new();
    *NUMBER.get_or_init(|| {
        let clock = SystemTime::now().duration_since(UNIX_EPOCH);
        let nanoseconds = clock.unwrap_or_default().as_nanos() as u64;
        let mixed =
            (nanoseconds ^ u64::from(std::process::id()) << 40).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        (mixed >> 32) as u32 | 1
    })
}

/// Why a channel could not be used.
#[derive(Debug, thiserror::Error)]
pub enum WireError {
    /// The run's folder of channels could not be made or read.
    #[error("{path}: {source}")]
    Io {
        /// The file or folder.
        path: String,
        /// What the system said.
        source: std::io::Error,
    },
    /// No run of this id is alive.
    #[error("no run '{0}' is alive on this machine; see `formica doctor`")]
    NoSuchRun(String),
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
    /// A service or port could not be made.
    #[error("channel '{service}': cannot {action}: {reason}")]
    Service {
        /// The service.
        service: String,
        /// What was tried.
        action: &'static str,
        /// What iceoryx2 said.
        reason: String,
    },
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
