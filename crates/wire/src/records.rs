//! What travels: plain records, read in place by other processes.
#![allow(unsafe_code)] // The derive of `ZeroCopySend` writes an unsafe impl and checks its terms.

use iceoryx2::prelude::ZeroCopySend;
use serde::{Deserialize, Serialize};

/// Version of all records; processes of another one are refused.
pub const LAYOUT: u32 = 4;
/// Width of an observation.
pub const OBSERVATION: usize = 29;
/// Width of an action.
pub const ACTION: usize = 8;
/// Actor ids are below this.
pub const MAX_ACTORS: usize = 64;
/// Nodes of a graph are fewer than this.
const MAX_NODES: i32 = 1 << 20;
/// Evaluation episodes of a run are at most this many.
pub const MAX_EPISODES: usize = 1024;

/// Bits of [`Transition::flags`].
pub mod flags {
    /// The episode ended for good after this step.
    pub const TERMINAL: u32 = 1;
    /// The episode was cut off after this step.
    pub const TRUNCATED: u32 = 2;
    /// A subgoal was chosen before this step.
    pub const CHOICE: u32 = 4;
    /// The chosen node was reached by this step.
    pub const REACHED: u32 = 8;
    /// The chosen node was given up at this step.
    pub const FAILED: u32 = 16;
    /// The ant lies on its back after this step.
    pub const FELL: u32 = 32;
    /// Not a step: only the observation that follows the last one.
    pub const FINAL: u32 = 64;
    /// The episode's goal was reached by this step.
    pub const SUCCESS: u32 = 128;
    /// A step of a test: nothing is to be learned from its choices.
    pub const TEST: u32 = 256;
}

/// One control step.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, ZeroCopySend)]
#[type_name("formica.Transition")]
pub struct Transition {
    /// Observation before the action.
    pub observation: [f32; OBSERVATION],
    /// The action as sampled; the simulator clips it.
    pub action: [f32; ACTION],
    /// The episode's goal (m), or the walker's unit direction.
    pub goal: [f32; 2],
    /// Reward after the action.
    pub reward: f32,
    /// Log-probability of the action (walker) or of the chosen node (high level, at a choice).
    pub log_prob: f32,
    /// The ant's node, -1 for none.
    pub node: i32,
    /// The chosen node, -1 for none.
    pub subgoal: i32,
    /// The goal's node, -1 for none.
    pub goal_node: i32,
    /// Bits of [`flags`].
    pub flags: u32,
}

impl Default for Transition {
    fn default() -> Self {
        Self {
            observation: [0.0; OBSERVATION],
            action: [0.0; ACTION],
            goal: [0.0; 2],
            reward: 0.0,
            log_prob: 0.0,
            node: -1,
            subgoal: -1,
            goal_node: -1,
            flags: 0,
        }
    }
}

impl Transition {
    /// Whether all values are finite and no index is absurd.
    #[must_use]
    pub fn is_sound(&self) -> bool {
        let nodes = [self.node, self.subgoal, self.goal_node];
        nodes.iter().all(|node| (-1..MAX_NODES).contains(node)) && self.is_finite()
    }

    fn is_finite(&self) -> bool {
        self.observation
            .iter()
            .chain(&self.action)
            .chain(&self.goal)
            .all(|v| v.is_finite())
            && self.reward.is_finite()
            && self.log_prob.is_finite()
    }

    /// Whether a bit of [`flags`] is set.
    #[must_use]
    pub fn has(&self, flag: u32) -> bool {
        self.flags & flag != 0
    }
}

/// What a trajectory message is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// The first word of an actor.
    Hello = 0,
    /// Steps.
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
    /// Version of the low level's weights that acted.
    pub low_version: u64,
    /// Version of the high level's, or of the walker's: what policy lag is measured by.
    pub weights_version: u64,
    /// Version of the graph that was walked.
    pub graph_version: u64,
    /// The round of a deterministic run, 0 outside of rounds.
    pub round: u32,
    /// Zero.
    pub reserved: u32,
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

/// Who must receive every trajectory.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Reader {
    /// The learner.
    Learner = 0,
    /// The graph-builder.
    GraphBuilder = 1,
}

impl Reader {
    /// Both readers.
    pub const ALL: [Self; 2] = [Self::Learner, Self::GraphBuilder];

    /// Where a reader in a run's folder notes what it had from every actor.
    #[must_use]
    pub fn ledger(self, folder: &std::path::Path) -> std::path::PathBuf {
        folder.join(format!("{}.ledger", self.name()))
    }

    /// The reader's name, which is its role's.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Learner => "learner",
            Self::GraphBuilder => "graph-builder",
        }
    }
}

/// Networks whose weights are published.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Module {
    /// Places to latents and back.
    Encoder = 0,
    /// The low-level policy.
    Low = 1,
    /// The high-level policy.
    High = 2,
    /// The walker's policy.
    Walker = 3,
}

impl Module {
    /// All modules, in the order of their numbers.
    pub const ALL: [Self; 4] = [Self::Encoder, Self::Low, Self::High, Self::Walker];

    pub(crate) fn service(self) -> &'static str {
        match self {
            Self::Encoder => "weights-encoder",
            Self::Low => "weights-low",
            Self::High => "weights-high",
            Self::Walker => "weights-walker",
        }
    }
}

#[repr(C)]
#[derive(Debug, Clone, Copy, Default, ZeroCopySend)]
#[type_name("formica.SnapshotHeader")]
pub(crate) struct SnapshotHeader {
    pub(crate) version: u64,
    pub(crate) shape_hash: u64,
}

/// What a run is at.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Phase {
    /// Learn; actors make rollouts as soon as they can.
    Train = 0,
    /// The graph is final, then the weights on it.
    Settle = 1,
    /// All is final: actors run the evaluation's episodes.
    Evaluate = 2,
    /// All is done: drain, save, leave.
    Finish = 3,
}

/// The launcher's word to all; the latest one counts.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, ZeroCopySend)]
#[type_name("formica.Directive")]
pub struct Directive {
    /// A [`Phase`].
    pub phase: u32,
    /// Episodes asked for, of the evaluation or of the round.
    pub episodes: u32,
    /// The round of a deterministic run; 0 before the first.
    pub round: u32,
    /// Zero.
    pub reserved: u32,
    /// Versions of weights and graph that the episodes are played with, exactly. While settling,
    /// the graph's final version, once it is known.
    pub low_version: u64,
    /// See `low_version`.
    pub high_version: u64,
    /// See `low_version`.
    pub graph_version: u64,
    /// Bit per episode that is done.
    pub done: [u64; MAX_EPISODES / 64],
}

impl Default for Directive {
    fn default() -> Self {
        Self {
            phase: Phase::Train as u32,
            episodes: 0,
            round: 0,
            reserved: 0,
            low_version: 0,
            high_version: 0,
            graph_version: 0,
            done: [0; MAX_EPISODES / 64],
        }
    }
}

impl Directive {
    /// Whether it is one that a launcher can have given.
    #[must_use]
    pub fn is_sound(&self) -> bool {
        self.phase <= Phase::Finish as u32 && self.episodes as usize <= MAX_EPISODES
    }

    /// The phase.
    #[must_use]
    pub fn phase(&self) -> Phase {
        match self.phase {
            0 => Phase::Train,
            1 => Phase::Settle,
            2 => Phase::Evaluate,
            _ => Phase::Finish,
        }
    }

    /// Whether an episode is done.
    #[must_use]
    pub fn is_done(&self, episode: u32) -> bool {
        let word = self
            .done
            .get(episode as usize / 64)
            .copied()
            .unwrap_or(u64::MAX);
        word >> (episode % 64) & 1 == 1
    }

    /// Marks an episode as done.
    pub fn mark_done(&mut self, episode: u32) {
        if let Some(word) = self.done.get_mut(episode as usize / 64) {
            *word |= 1 << (episode % 64);
        }
    }
}

/// Kinds of process.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Role {
    /// Builds the graph.
    GraphBuilder = 0,
    /// Learns.
    Learner = 1,
    /// Simulates.
    Actor = 2,
}

impl Role {
    /// The role's name, as on the command line.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::GraphBuilder => "graph-builder",
            Self::Learner => "learner",
            Self::Actor => "actor",
        }
    }

    /// The role of a number in a [`Status`].
    #[must_use]
    pub fn from_number(number: u32) -> Option<Self> {
        [Self::GraphBuilder, Self::Learner, Self::Actor]
            .into_iter()
            .find(|r| *r as u32 == number)
    }
}

/// What a process is doing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum State {
    /// Loading, joining.
    Starting = 0,
    /// Waiting for another process.
    Waiting = 1,
    /// At work.
    Working = 2,
    /// Its part of the training is done.
    Trained = 3,
    /// What it published last is final.
    Settled = 4,
    /// All is done and acknowledged.
    Finished = 5,
}

impl State {
    /// The state of a number in a [`Status`].
    #[must_use]
    pub fn from_number(number: u32) -> Option<Self> {
        let states = [
            Self::Starting,
            Self::Waiting,
            Self::Working,
            Self::Trained,
            Self::Settled,
            Self::Finished,
        ];
        states.into_iter().find(|state| *state as u32 == number)
    }
}

/// A process's pulse; sent at least once a second.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, ZeroCopySend)]
#[type_name("formica.Status")]
pub struct Status {
    /// A [`Role`].
    pub role: u32,
    /// Which of the role's processes.
    pub id: u32,
    /// Process id.
    pub pid: u32,
    /// A [`State`].
    pub state: u32,
    /// Rounds of a deterministic run that are learned from.
    pub round: u32,
    /// The process, by [`incarnation`](crate::incarnation).
    pub incarnation: u32,
    /// Control steps simulated.
    pub steps: u64,
    /// Transitions sent.
    pub sent: u64,
    /// Next sequence number that the slowest reader waits for.
    pub acknowledged: u64,
    /// Transitions received.
    pub received: u64,
    /// Messages refused at the door.
    pub refused: u64,
    /// Steps of the work at hand that are done: what stands still while there is work is stuck.
    pub updates: u64,
    /// Done and to do, of the work at hand.
    pub progress: [u64; 2],
    /// Newest versions published or used: low, high, graph.
    pub versions: [u64; 3],
    /// Where its ant, or the first of its ants, is in the maze (m); not numbers where it has none.
    pub place: [f32; 2],
    /// What is being done, UTF-8, zero-padded.
    pub text: [u8; 64],
}

impl Default for Status {
    fn default() -> Self {
        Self {
            role: 0,
            id: 0,
            pid: std::process::id(),
            state: State::Starting as u32,
            round: 0,
            incarnation: crate::incarnation(),
            steps: 0,
            sent: 0,
            acknowledged: 0,
            received: 0,
            refused: 0,
            updates: 0,
            progress: [0; 2],
            versions: [0; 3],
            place: [f32::NAN; 2],
            text: [0; 64],
        }
    }
}

impl Status {
    /// Sets what is being done.
    pub fn set_text(&mut self, text: &str) {
        self.text = padded(text);
    }

    /// What is being done.
    #[must_use]
    pub fn text(&self) -> String {
        unpadded(&self.text)
    }
}

/// One number over time.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, ZeroCopySend)]
#[type_name("formica.Metric")]
pub struct Metric {
    /// A [`Role`].
    pub role: u32,
    /// Which of the role's processes.
    pub id: u32,
    /// Update or step it belongs to.
    pub step: u64,
    /// Its value.
    pub value: f64,
    /// `area/name`, UTF-8, zero-padded.
    pub name: [u8; 48],
}

impl Metric {
    /// A metric of this name.
    #[must_use]
    pub fn new(role: Role, id: u32, name: &str, step: u64, value: f64) -> Self {
        Self {
            role: role as u32,
            id,
            step,
            value,
            name: padded(name),
        }
    }

    /// Its name.
    #[must_use]
    pub fn name(&self) -> String {
        unpadded(&self.name)
    }
}

/// How an episode of the evaluation or of a round went.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, PartialEq, ZeroCopySend, Serialize, Deserialize)]
#[type_name("formica.EpisodeResult")]
pub struct EpisodeResult {
    /// The actor.
    pub actor: u32,
    /// The episode's number in the evaluation or the round.
    pub episode: u32,
    /// The round, 0 for the evaluation.
    pub round: u32,
    /// 1 when the goal was reached.
    pub success: u32,
    /// 1 when the ant lay on its back at the end.
    pub fell: u32,
    /// Steps taken.
    pub steps: u32,
    /// Nearest distance to the goal (m).
    pub nearest: f32,
    /// Edges tried and reached.
    pub edges: [u32; 2],
}

fn padded<const N: usize>(text: &str) -> [u8; N] {
    let mut bytes = [0; N];
    let mut end = text.len().min(N);
    while !text.is_char_boundary(end) {
        end -= 1;
    }
    bytes[..end].copy_from_slice(&text.as_bytes()[..end]);
    bytes
}

fn unpadded(bytes: &[u8]) -> String {
    let end = bytes
        .iter()
        .position(|byte| *byte == 0)
        .unwrap_or(bytes.len());
    String::from_utf8_lossy(&bytes[..end]).into_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_texts_are_cut_between_characters() {
        let mut status = Status::default();
        status.set_text(&"é".repeat(40));
        assert_eq!(status.text(), "é".repeat(32));
        let mut status = Status::default();
        status.set_text(&format!("x{}", "é".repeat(40)));
        assert_eq!(status.text(), format!("x{}", "é".repeat(31)));
    }

    #[test]
    fn episodes_are_marked_one_by_one_and_none_lies_beyond() {
        let mut directive = Directive::default();
        directive.mark_done(70);
        assert!(directive.is_done(70) && !directive.is_done(69) && !directive.is_done(6));
        directive.mark_done(u32::MAX);
        assert!(directive.is_done(MAX_EPISODES as u32));
    }
}
