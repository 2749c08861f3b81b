//! The trajectories of a round of a deterministic run: in an order of their own, whoever played
//! them and whenever they came.

use std::collections::BTreeMap;

use crate::records::{TrajectoryHeader, Transition, flags};

/// A trajectory, copied out of its channel.
#[derive(Debug, Clone, PartialEq)]
pub struct Trajectory {
    /// What stood before it.
    pub header: TrajectoryHeader,
    /// Its steps, the final row among them.
    pub steps: Vec<Transition>,
}

/// Gathers round after round.
#[derive(Debug, Default)]
pub struct Rounds {
    taken: u32,
    /// By episode and first step: an episode that was played again, since its actor died, is
    /// there once.
    pieces: BTreeMap<(u64, u32), Trajectory>,
}

impl Rounds {
    /// Goes on after so many rounds.
    #[must_use]
    pub fn after(rounds: u32) -> Self {
        Self {
            taken: rounds,
            ..Self::default()
        }
    }

    /// Takes in a trajectory; those of other rounds than the next are left out.
    pub fn add(&mut self, header: &TrajectoryHeader, steps: &[Transition]) {
        if header.round == self.taken + 1 {
            let trajectory = Trajectory {
                header: *header,
                steps: steps.to_vec(),
            };
            self.pieces
                .insert((header.episode, header.first_step), trajectory);
        }
    }

    /// The next round's trajectories by episode and step, once all of so many episodes have come
    /// to their ends.
    pub fn take(&mut self, episodes: u32) -> Option<Vec<Trajectory>> {
        let ended = |trajectory: &&Trajectory| {
            let ends = flags::TERMINAL | flags::TRUNCATED;
            trajectory.steps.iter().any(|step| step.has(ends))
        };
        if self.pieces.values().filter(ended).count() < episodes as usize {
            return None;
        }
        self.taken += 1;
        Some(std::mem::take(&mut self.pieces).into_values().collect())
    }

    /// Rounds taken so far.
    #[must_use]
    pub fn taken(&self) -> u32 {
        self.taken
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn piece(
        round: u32,
        episode: u64,
        first_step: u32,
        end: bool,
    ) -> (TrajectoryHeader, Transition) {
        let header = TrajectoryHeader {
            round,
            episode,
            first_step,
            ..TrajectoryHeader::default()
        };
        let step = Transition {
            flags: if end { flags::TRUNCATED } else { 0 },
            ..Transition::default()
        };
        (header, step)
    }

    #[test]
    fn a_round_is_whole_once_and_in_order() {
        let mut rounds = Rounds::default();
        let mut add = |round, episode, first_step, end| {
            let (header, step) = piece(round, episode, first_step, end);
            rounds.add(&header, &[step]);
            rounds.take(2)
        };
        assert_eq!(add(1, 1, 0, true), None);
        assert_eq!(add(1, 0, 0, false), None);
        assert_eq!(add(2, 0, 0, true), None, "of another round");
        // Its actor died and another one plays the episode again.
        assert_eq!(add(1, 0, 0, false), None);
        let round = add(1, 0, 128, true).unwrap();
        let order = round
            .iter()
            .map(|t| (t.header.episode, t.header.first_step));
        assert_eq!(order.collect::<Vec<_>>(), [(0, 0), (0, 128), (1, 0)]);
        assert_eq!(add(1, 0, 0, true), None, "late");
        assert_eq!(rounds.taken(), 1);
    }
}
