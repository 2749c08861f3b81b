//! What travels with trajectories and snapshots: plain records, read in place by other processes.
#![allow(unsafe_code)] // The derive of `ZeroCopySend` writes an unsafe impl and checks its terms.

use iceoryx2::prelude::ZeroCopySend;

/// Version of all records; processes of another one are refused.
pub const LAYOUT: u32 = 5;
/// Actor ids are below this.
pub const MAX_ACTORS: usize = 64;
/// Parts of an algorithm that have versions: its networks in their order, and at [`GRAPH`] its graph.
pub const PARTS: usize = 8;
/// The graph's place among the parts.
pub const GRAPH: usize = PARTS - 1;
/// A version of each part, 0 for none.
pub type Versions = [u64; PARTS];

/// What a trajectory message is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// The first word of an actor.
    Hello = 0,
    /// Steps and choices.
    Data = 1,
    /// The last word of an actor.
    Bye = 2,
}

/// Stands before each trajectory.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, ZeroCopySend)]
#[type_name("formica.TrajectoryHeader")]
pub struct TrajectoryHeader {
    /// [`LAYOUT`].
    pub layout: u32,
    /// The actor's id.
    pub actor: u32,
    /// Its process, by [`incarnation`](crate::incarnation).
    pub incarnation: u32,
    /// A [`Kind`].
    pub kind: u32,
    /// Counts the actor's messages from 0, the hello.
    pub sequence: u64,
    /// The actor's episode.
    pub episode: u64,
    /// First step's place in the episode.
    pub first_step: u32,
    /// Which of the actor's ants.
    pub environment: u32,
    /// Versions that acted.
    pub versions: Versions,
    /// The round of a deterministic run, 0 outside of rounds.
    pub round: u32,
    /// Rows of the payload; the words behind them are choices.
    pub rows: u32,
}

impl TrajectoryHeader {
    /// A number for the episode that no other of a run has. An episode of a round has the same
    /// whoever plays it.
    #[must_use]
    pub fn name(&self) -> u64 {
        match self.round {
            0 => u64::from(self.incarnation) << 31 ^ u64::from(self.actor) << 24 ^ self.episode,
            round => u64::from(round) << 32 | self.episode,
        }
    }
}

#[repr(C)]
#[derive(Debug, Clone, Copy, Default, ZeroCopySend)]
#[type_name("formica.Acknowledgement")]
pub(crate) struct Acknowledgement {
    pub(crate) incarnation: u32,
    pub(crate) reserved: u32,
    pub(crate) next_sequence: u64,
}

#[repr(C)]
#[derive(Debug, Clone, Copy, Default, ZeroCopySend)]
#[type_name("formica.AcknowledgementHeader")]
pub(crate) struct AcknowledgementHeader {
    pub(crate) reader: u32,
    /// The reader's process: a new one has not seen what waited for the one before.
    pub(crate) incarnation: u32,
}

#[repr(C)]
#[derive(Debug, Clone, Copy, Default, ZeroCopySend)]
#[type_name("formica.SnapshotHeader")]
pub(crate) struct SnapshotHeader {
    pub(crate) version: u64,
    pub(crate) shape_hash: u64,
}
