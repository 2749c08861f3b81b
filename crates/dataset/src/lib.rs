//! Offline episodes on disk and in memory: one flat copy of the data.

pub mod d4rl;

use std::ops::Range;
use std::path::{Path, PathBuf};

use rand::{Rng, RngExt};

/// Width of an observation.
pub const OBSERVATION: usize = 29;
/// Width of an action.
pub const ACTION: usize = 8;

/// Why a data set could not be read or written.
#[derive(Debug, thiserror::Error)]
pub enum DatasetError {
    /// The system refused.
    #[error("{path}: {source}", path = .path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// Not an HDF5 file, or a damaged one.
    #[error("{path}: {reason}", path = .path.display())]
    Format {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        reason: String,
    },
    /// A key of the layout is not there or cannot be read.
    #[error("{path}: '{key}': {reason}", path = .path.display())]
    Key {
        /// The file.
        path: PathBuf,
        /// The key.
        key: &'static str,
        /// What is wrong with it.
        reason: String,
    },
    /// A key of another shape than the layout has.
    #[error("{path}: '{key}' has shape {got:?}, expected {expected}", path = .path.display())]
    Shape {
        /// The file.
        path: PathBuf,
        /// The key.
        key: &'static str,
        /// The shape found.
        got: Vec<u64>,
        /// The shape wanted.
        expected: String,
    },
    /// A value that is NaN or infinite.
    #[error("{path}: '{key}' holds a value that is not finite in row {row}", path = .path.display())]
    NotFinite {
        /// The file.
        path: PathBuf,
        /// The key.
        key: &'static str,
        /// The first such row.
        row: usize,
    },
}

/// Episodes, flat.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Dataset {
    /// `[n, 29]`, before the action.
    pub observations: Vec<f32>,
    /// `[n, 8]`.
    pub actions: Vec<f32>,
    /// `[n]`.
    pub rewards: Vec<f32>,
    /// Rows of each episode, in order. D4RL's terminals mark success and end no episode.
    pub episodes: Vec<Range<usize>>,
    /// The goal that each row's behaviour aimed at (m); empty where the file has none.
    pub goals: Vec<[f32; 2]>,
}

impl Dataset {
    /// Reads a data set in D4RL's layout.
    ///
    /// # Errors
    /// Anything that is wrong with the file, by key and row.
    pub fn open(path: &Path) -> Result<Self, DatasetError> {
        d4rl::read(path)
    }

    /// Rows.
    #[must_use]
    pub fn len(&self) -> usize {
        self.rewards.len()
    }

    /// Whether there is no row.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.rewards.is_empty()
    }

    /// Observation of a row, 29 values.
    #[must_use]
    pub fn observation(&self, row: usize) -> &[f32] {
        &self.observations[row * OBSERVATION..(row + 1) * OBSERVATION]
    }

    /// Action of a row, 8 values.
    #[must_use]
    pub fn action(&self, row: usize) -> &[f32] {
        &self.actions[row * ACTION..(row + 1) * ACTION]
    }

    /// Place of the torso in a row (m).
    #[must_use]
    pub fn place(&self, row: usize) -> [f32; 2] {
        [
            self.observations[row * OBSERVATION],
            self.observations[row * OBSERVATION + 1],
        ]
    }

    /// Places of all rows (m).
    #[must_use]
    pub fn places(&self) -> Vec<[f32; 2]> {
        (0..self.len()).map(|row| self.place(row)).collect()
    }

    /// The z of the torso's up vector in a row: 1 upright, -1 on its back.
    #[must_use]
    pub fn upright(&self, row: usize) -> f32 {
        let o = self.observation(row);
        1.0 - 2.0 * (o[4] * o[4] + o[5] * o[5])
    }

    /// Share of episodes that pass within `radius` (m) of `start` and later of `goal`.
    #[must_use]
    pub fn share_from_to(&self, start: [f32; 2], goal: [f32; 2], radius: f32) -> f32 {
        let near = |row: usize, place: [f32; 2]| {
            let [x, y] = self.place(row);
            (x - place[0]).hypot(y - place[1]) <= radius
        };
        let passes = |episode: &&Range<usize>| {
            let mut rows = (*episode).clone();
            rows.any(|row| near(row, start)) && rows.any(|row| near(row, goal))
        };
        self.episodes.iter().filter(passes).count() as f32 / self.episodes.len().max(1) as f32
    }
}

/// Draws rows that have at least `lag` rows after them in their episode, all alike.
#[derive(Debug, Clone)]
pub struct Starts {
    /// First row of each episode, its end, and how many starts the episodes before it have.
    episodes: Vec<(usize, usize, usize)>,
    total: usize,
}

impl Starts {
    /// None when no episode is longer than `lag` rows.
    #[must_use]
    pub fn new(episodes: &[Range<usize>], lag: usize) -> Option<Self> {
        let mut starts = vec![];
        let mut total = 0;
        for episode in episodes.iter().filter(|episode| episode.len() > lag) {
            starts.push((episode.start, episode.end, total));
            total += episode.len() - lag;
        }
        (total > 0).then_some(Self {
            episodes: starts,
            total,
        })
    }

    /// A row and the end of its episode.
    pub fn draw(&self, rng: &mut impl Rng) -> (usize, usize) {
        let pick = rng.random_range(0..self.total);
        let at = self
            .episodes
            .partition_point(|(_, _, before)| *before <= pick)
            - 1;
        let (start, end, before) = self.episodes[at];
        (start + pick - before, end)
    }
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use rand_pcg::Pcg64Mcg;

    use super::*;

    #[test]
    fn starts_never_reach_beyond_an_episode_and_miss_none() {
        let starts = Starts::new(&[0..3, 3..10, 10..15], 4).unwrap();
        let mut rng = Pcg64Mcg::seed_from_u64(0);
        let mut seen = [0; 15];
        for _ in 0..4000 {
            let (row, end) = starts.draw(&mut rng);
            assert!(row + 4 < end);
            seen[row] += 1;
        }
        let rows: Vec<usize> = (0..15).filter(|row| seen[*row] > 0).collect();
        assert_eq!(rows, [3, 4, 5, 10]);
        assert!(
            rows.iter().all(|row| (850..1150).contains(&seen[*row])),
            "{seen:?}"
        );
        assert!(Starts::new(&[0..3], 3).is_none());
    }
}
