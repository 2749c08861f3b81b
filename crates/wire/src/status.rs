//! What processes report to the launcher.
#![allow(unsafe_code)] // The derive of `ZeroCopySend` writes an unsafe impl and checks its terms.

use iceoryx2::prelude::ZeroCopySend;
use serde::{Deserialize, Serialize};

use crate::records::{PARTS, Versions};

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
    /// Newest versions published or used.
    pub versions: Versions,
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
            versions: [0; PARTS],
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
    /// Choices that ended, and those of them that were carried out.
    pub choices: [u32; 2],
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
}
