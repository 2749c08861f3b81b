//! Offline episodes on disk and in memory: one flat copy of the data.
//!
//! Each file format is a module that reads [`Dataset`]s and writes them: [`d4rl`], [`minari`] and
//! [`ogbench`]. [`open`] tells them apart by content.

pub mod d4rl;
mod error;
mod fault;
pub mod fit;
mod format;
mod hdf5;
pub mod minari;
mod number;
pub mod ogbench;
mod parallel;
mod provenance;
mod starts;
mod summary;

use std::ops::Range;
use std::path::Path;

pub use config::OnFault;
pub use error::DatasetError;
pub use fault::Dropped;
pub use fit::{LoadError, Loaded, Needs, load_for};
pub use format::{Format, Opened, open, open_with};
pub use provenance::Made;
pub use starts::Starts;
pub use summary::Summary;

/// Widths of an observation and of an action: the ant's own.
pub use maze::{ACTION, OBSERVATION};

/// Episodes, flat. All arrays have a row for each step; rows are counted from 0.
///
/// Rows of an episode are states that follow each other, each a step after the one before. An
/// episode's last row may hold an action without effect (OGBench) or of zeros (Minari): no state
/// follows it, so nothing is to be learnt from it.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Dataset {
    /// `[n, 29]`, before the action.
    pub observations: Vec<f32>,
    /// `[n, 8]`.
    pub actions: Vec<f32>,
    /// `[n]`.
    pub rewards: Vec<f32>,
    /// `[n]`. D4RL's terminals mark success and end no episode.
    pub terminals: Vec<bool>,
    /// Rows of each episode, in order; together they are all rows, and none is empty.
    pub episodes: Vec<Range<usize>>,
    /// The goal that each row's behaviour aimed at (m); empty where the file has none.
    pub goals: Vec<[f32; 2]>,
}

impl Dataset {
    /// Reads a data set of any [`Format`], recognised by its content.
    ///
    /// # Errors
    /// Anything that is wrong with the file, by key and row.
    pub fn open(path: &Path) -> Result<Self, DatasetError> {
        open(path).map(|(_, data)| data)
    }

    /// Some of the episodes, by number, as a data set of their own.
    ///
    /// # Panics
    /// When there are not as many episodes.
    #[must_use]
    pub fn select(&self, numbers: Range<usize>) -> Self {
        let episodes = &self.episodes[numbers];
        let rows = episodes.first().map_or(0, |first| first.start)
            ..episodes.last().map_or(0, |last| last.end);
        Self {
            observations: self.observations[rows.start * OBSERVATION..rows.end * OBSERVATION]
                .to_vec(),
            actions: self.actions[rows.start * ACTION..rows.end * ACTION].to_vec(),
            rewards: self.rewards[rows.clone()].to_vec(),
            terminals: self.terminals[rows.clone()].to_vec(),
            goals: self.goals.get(rows.clone()).unwrap_or_default().to_vec(),
            episodes: episodes
                .iter()
                .map(|episode| episode.start - rows.start..episode.end - rows.start)
                .collect(),
        }
    }

    /// Some of the episodes, those that are marked, as a data set of their own.
    pub(crate) fn kept(&self, keep: &[bool]) -> Self {
        let mut kept = Self::default();
        let marked = self.episodes.iter().zip(keep);
        for (rows, _) in marked.filter(|(_, keep)| **keep) {
            let start = kept.len();
            let (from, to) = (rows.start, rows.end);
            kept.observations
                .extend_from_slice(&self.observations[from * OBSERVATION..to * OBSERVATION]);
            kept.actions
                .extend_from_slice(&self.actions[from * ACTION..to * ACTION]);
            kept.rewards.extend_from_slice(&self.rewards[rows.clone()]);
            kept.terminals
                .extend_from_slice(&self.terminals[rows.clone()]);
            kept.goals
                .extend_from_slice(self.goals.get(rows.clone()).unwrap_or_default());
            kept.episodes.push(start..kept.len());
        }
        kept
    }

    /// The data set without the rows at some places: what lies before and after such rows in an
    /// episode are episodes of their own.
    #[must_use]
    pub fn without(self, left_out: impl Fn([f32; 2]) -> bool) -> Self {
        let keep: Vec<bool> = (0..self.len())
            .map(|row| !left_out(self.place(row)))
            .collect();
        let mut kept = Self::default();
        for episode in &self.episodes {
            let mut start = None;
            for row in episode.clone() {
                if keep[row] {
                    start.get_or_insert(kept.len());
                    kept.observations.extend_from_slice(self.observation(row));
                    kept.actions.extend_from_slice(self.action(row));
                    kept.rewards.push(self.rewards[row]);
                    kept.terminals.push(self.terminals[row]);
                    kept.goals.extend(self.goals.get(row));
                } else if let Some(start) = start.take() {
                    kept.episodes.push(start..kept.len());
                }
            }
            if let Some(start) = start {
                kept.episodes.push(start..kept.len());
            }
        }
        kept
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
        maze::upright(self.observation(row))
    }

    /// Number of the episode that a row belongs to; the number of episodes for a row beyond all.
    #[must_use]
    pub fn episode_of(&self, row: usize) -> usize {
        self.episodes.partition_point(|episode| episode.end <= row)
    }

    /// Steps from a row to its episode's last row; 0 for a row beyond all.
    #[must_use]
    pub fn steps_left(&self, row: usize) -> usize {
        self.episodes
            .get(self.episode_of(row))
            .map_or(0, |episode| episode.end - 1 - row)
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

/// Episodes from the marks of their last rows; rows after the last mark are an episode too.
pub(crate) fn episodes(last: &[bool]) -> Vec<Range<usize>> {
    let mut episodes = vec![];
    let mut start = 0;
    for (row, last_row) in last.iter().enumerate() {
        if *last_row || row + 1 == last.len() {
            episodes.push(start..row + 1);
            start = row + 1;
        }
    }
    episodes
}

/// Data sets made up for tests.
#[cfg(test)]
pub(crate) mod made {
    use super::*;

    /// Episodes along the given places, all else zero but the quaternion's w.
    pub(crate) fn along(episodes: &[&[[f32; 2]]]) -> Dataset {
        let mut data = Dataset::default();
        for places in episodes {
            let start = data.len();
            for [x, y] in *places {
                let mut observation = [0.0; OBSERVATION];
                (observation[0], observation[1], observation[3]) = (*x, *y, 1.0);
                data.observations.extend(observation);
                data.actions.extend([0.0; ACTION]);
                data.rewards.push(0.0);
                data.terminals.push(false);
            }
            data.episodes.push(start..data.len());
        }
        data
    }

    /// Episodes of these lengths whose values all differ, by no more than a step's way.
    pub(crate) fn varied(lengths: &[usize]) -> Dataset {
        // Scattered, so that they deflate no better than real ones.
        let value = |at: usize| {
            let bits = (at as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
            ((bits ^ bits >> 29).wrapping_mul(0xbf58_476d_1ce4_e5b9) >> 40) as f32 / 1e7 - 0.8
        };
        let n: usize = lengths.iter().sum();
        let mut start = 0;
        Dataset {
            observations: (0..n * OBSERVATION).map(value).collect(),
            actions: (0..n * ACTION).map(value).collect(),
            rewards: (0..n).map(value).collect(),
            terminals: (0..n).map(|row| row % 3 == 1).collect(),
            episodes: lengths
                .iter()
                .map(|length| {
                    start += length;
                    start - length..start
                })
                .collect(),
            goals: (0..n).map(|row| [value(row), value(row + n)]).collect(),
        }
    }

    /// Panics unless the arrays are of one length and the episodes are all rows.
    pub(crate) fn sound(data: &Dataset) {
        let n = data.len();
        assert_eq!(data.observations.len(), n * OBSERVATION);
        assert_eq!(data.actions.len(), n * ACTION);
        assert_eq!(data.terminals.len(), n);
        assert!(data.goals.is_empty() || data.goals.len() == n);
        let mut end = 0;
        for episode in &data.episodes {
            assert!(episode.start == end && episode.end > end, "{episode:?}");
            end = episode.end;
        }
        assert!(n > 0 && end == n);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_know_their_episode_and_the_steps_left() {
        let data = made::along(&[&[[0.0; 2]; 3], &[[0.0; 2]; 1], &[[0.0; 2]; 4]]);
        let of: Vec<usize> = (0..9).map(|row| data.episode_of(row)).collect();
        assert_eq!(of, [0, 0, 0, 1, 2, 2, 2, 2, 3]);
        let left: Vec<usize> = (0..9).map(|row| data.steps_left(row)).collect();
        assert_eq!(left, [2, 1, 0, 0, 3, 2, 1, 0, 0]);
    }

    #[test]
    fn selected_episodes_are_rows_of_their_own() {
        let data = made::varied(&[3, 1, 4]);
        let last = data.select(1..3);
        assert_eq!(last.episodes, [0..1, 1..5]);
        assert_eq!(last.observation(1), data.observation(4));
        assert_eq!(last.goals, data.goals[3..]);
        made::sound(&last);
        assert_eq!(data.select(0..3), data);
        assert_eq!(data.select(1..1), Dataset::default());
    }

    #[test]
    fn what_is_left_out_cuts_episodes() {
        let data = made::along(&[
            &[[0.0; 2], [5.0, 0.0], [1.0, 0.0], [1.0, 0.0]],
            &[[5.0, 0.0], [2.0, 0.0]],
            &[[5.0, 0.0]],
        ]);
        let kept = data.clone().without(|[x, _]| x > 4.0);
        assert_eq!(kept.episodes, [0..1, 1..3, 3..4]);
        assert_eq!(kept.observation(1), data.observation(2));
        made::sound(&kept);
        assert_eq!(data.clone().without(|_| false), data);
    }

    #[test]
    fn share_from_to_wants_the_goal_after_the_start() {
        let (a, b, c) = ([0.0, 0.0], [4.0, 0.0], [8.0, 0.0]);
        let data = made::along(&[&[a, b, c], &[c, b, a], &[a, b], &[b, c, a, c]]);
        assert_eq!(data.share_from_to([0.5, 0.5], [8.0, 0.9], 1.0), 0.5);
        assert_eq!(data.share_from_to(c, a, 1.0), 0.5);
        assert_eq!(data.share_from_to(a, [8.0, 1.1], 1.0), 0.0);
        assert_eq!(Dataset::default().share_from_to(a, c, 1.0), 0.0);
    }

    #[test]
    fn upright_is_one_standing_and_minus_one_on_its_back() {
        let mut data = made::along(&[&[[1.0, 2.0]; 2]]);
        data.observations[OBSERVATION + 3..OBSERVATION + 7].copy_from_slice(&[0.0, 1.0, 0.0, 0.0]);
        assert_eq!((data.upright(0), data.upright(1)), (1.0, -1.0));
        assert_eq!(data.places(), [[1.0, 2.0]; 2]);
    }
}
