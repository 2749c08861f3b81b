//! What a run is at, and what its processes are asked for.
#![allow(unsafe_code)] // The derive of `ZeroCopySend` writes an unsafe impl and checks its terms.

use iceoryx2::prelude::ZeroCopySend;

use crate::records::{PARTS, Versions};

/// Evaluation episodes of a run are at most this many.
pub const MAX_EPISODES: usize = 1024;

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
    /// Versions that the episodes are played with, exactly. While settling, the graph's final
    /// version, once it is known.
    pub versions: Versions,
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
            versions: [0; PARTS],
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn episodes_are_marked_one_by_one_and_none_lies_beyond() {
        let mut directive = Directive::default();
        directive.mark_done(70);
        assert!(directive.is_done(70) && !directive.is_done(69) && !directive.is_done(6));
        directive.mark_done(u32::MAX);
        assert!(directive.is_done(MAX_EPISODES as u32));
    }
}
