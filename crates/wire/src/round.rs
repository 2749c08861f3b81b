//! The trajectories of a round of a deterministic run: in an order of their own, whoever played
//! them and whenever they came.

use std::collections::BTreeMap;

use simulator::{RowLayout, Rows, flags};

use crate::receiver::Trajectory;
use crate::records::TrajectoryHeader;

/// A trajectory, copied out of its channel.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct OwnedTrajectory {
    /// Its header.
    pub header: TrajectoryHeader,
    layout: RowLayout,
    rows: Vec<u32>,
    choices: Vec<u32>,
}

impl OwnedTrajectory {
    /// Copies a trajectory of rows in a layout.
    #[must_use]
    pub fn new(header: &TrajectoryHeader, layout: RowLayout, trajectory: Trajectory<'_>) -> Self {
        Self {
            header: *header,
            layout,
            rows: trajectory.rows.words().to_vec(),
            choices: trajectory.choices.to_vec(),
        }
    }

    /// Its steps and choices.
    #[must_use]
    pub fn view(&self) -> Trajectory<'_> {
        Trajectory {
            rows: self.layout.rows(&self.rows),
            choices: &self.choices,
        }
    }
}

/// Gathers round after round.
#[derive(Debug)]
pub struct Rounds {
    layout: RowLayout,
    taken: u32,
    /// By episode and first step: an episode that was played again, since its actor died, is
    /// there once.
    pieces: BTreeMap<(u64, u32), OwnedTrajectory>,
}

impl Rounds {
    /// Goes on after so many rounds, of rows in this layout.
    #[must_use]
    pub fn after(rounds: u32, layout: RowLayout) -> Self {
        Self {
            layout,
            taken: rounds,
            pieces: BTreeMap::new(),
        }
    }

    /// Takes in a trajectory; those of other rounds than the next are left out.
    pub fn add(&mut self, header: &TrajectoryHeader, trajectory: Trajectory<'_>) {
        if header.round == self.taken + 1 {
            let trajectory = OwnedTrajectory::new(header, self.layout, trajectory);
            self.pieces
                .insert((header.episode, header.first_step), trajectory);
        }
    }

    /// The next round's trajectories by episode and step, once all of so many episodes have come
    /// to their ends.
    pub fn take(&mut self, episodes: u32) -> Option<Vec<OwnedTrajectory>> {
        let ended = |trajectory: &&OwnedTrajectory| {
            let ends = flags::TERMINAL | flags::TRUNCATED;
            let rows: Rows<'_> = trajectory.view().rows;
            rows.iter().any(|row| row.has(ends))
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
    use crate::limits::tests::limits;

    #[test]
    fn a_round_is_whole_once_and_in_order() {
        let layout = RowLayout::new(&limits().spaces);
        let mut rounds = Rounds::after(0, layout);
        let mut add = |round, episode, first_step, end| {
            let header = TrajectoryHeader {
                round,
                episode,
                first_step,
                ..TrajectoryHeader::default()
            };
            let mut words = vec![0; layout.stride()];
            words[0] = if end { flags::TRUNCATED } else { 0 };
            let trajectory = Trajectory {
                rows: layout.rows(&words),
                choices: &[],
            };
            rounds.add(&header, trajectory);
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
