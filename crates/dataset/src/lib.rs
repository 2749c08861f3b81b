//! Offline episodes on disk and in memory: one flat copy of the data.
//!
//! Each file format is a module that reads [`Dataset`]s and writes them: [`d4rl`], [`minari`] and
//! [`ogbench`]. [`open`] tells them apart by content.

mod array;
mod codes;
pub mod d4rl;
mod error;
mod fault;
pub mod fit;
mod format;
mod hdf5;
#[cfg(test)]
pub(crate) mod made;
mod mapped;
pub mod minari;
mod number;
pub mod ogbench;
mod parallel;
pub mod prepared;
mod provenance;
mod shape;
mod starts;
mod summary;

use std::ops::Range;
use std::path::Path;

use bytemuck::Pod;

pub use array::Array;
pub use codes::Codes;
pub use config::OnFault;
pub use error::DatasetError;
pub use fault::Dropped;
pub use fit::{LoadError, Loaded, Needs, load_for};
pub use format::{Format, Opened, open, open_with};
pub use mapped::MappedError;
pub use provenance::Made;
pub use shape::{Element, Shape};
pub use starts::Starts;
pub use summary::Summary;

/// Episodes, flat. All arrays have a row for each step; rows are counted from 0.
///
/// Rows of an episode are states that follow each other, each a step after the one before. An
/// episode's last row may hold an action without effect (OGBench) or of zeros (Minari): no state
/// follows it, so nothing is to be learnt from it.
#[derive(Debug, Clone, PartialEq)]
pub struct Dataset {
    shape: Shape,
    /// Values of an observation and of an action, as the shape has them.
    widths: [usize; 2],
    /// `[n, observation]`, before the action; empty where observations are images.
    pub observations: Array<f32>,
    /// `[n, rows, columns, channels]`, before the action; empty where observations are vectors.
    pub images: Array<u8>,
    /// `[n, action]`.
    pub actions: Array<f32>,
    /// `[n]`.
    pub rewards: Array<f32>,
    /// `[n]`. D4RL's terminals mark success and end no episode.
    pub terminals: Vec<bool>,
    /// Rows of each episode, in order; together they are all rows, and none is empty.
    pub episodes: Vec<Range<usize>>,
    /// The goal that each row's behaviour aimed at (m); empty where the file has none.
    pub goals: Array<[f32; 2]>,
    /// Where each image was taken (m); empty where observations begin with x and y.
    pub image_places: Array<[f32; 2]>,
}

impl Dataset {
    /// Without rows.
    #[must_use]
    pub fn new(shape: Shape) -> Self {
        Self {
            widths: [shape.observation(), shape.action()],
            shape,
            observations: Array::default(),
            images: Array::default(),
            actions: Array::default(),
            rewards: Array::default(),
            terminals: vec![],
            episodes: vec![],
            goals: Array::default(),
            image_places: Array::default(),
        }
    }

    /// Reads a data set of any [`Format`], recognised by its content.
    ///
    /// # Errors
    /// Anything that is wrong with the file, by key and row.
    pub fn open(path: &Path) -> Result<Self, DatasetError> {
        open(path).map(|(_, data)| data)
    }

    /// Shape of the rows.
    #[must_use]
    pub fn shape(&self) -> &Shape {
        &self.shape
    }

    /// Some of the episodes, by number, as a data set of their own.
    ///
    /// # Panics
    /// When there are not as many episodes.
    #[must_use]
    pub fn select(&self, numbers: Range<usize>) -> Self {
        let mut selected = Self::new(self.shape.clone());
        for episode in &self.episodes[numbers] {
            selected.take(self, episode.clone());
            selected.end_episode();
        }
        selected
    }

    /// Some of the episodes, those that are marked, as a data set of their own.
    pub(crate) fn kept(&self, keep: &[bool]) -> Self {
        let mut kept = Self::new(self.shape.clone());
        let marked = self.episodes.iter().zip(keep);
        for (rows, _) in marked.filter(|(_, keep)| **keep) {
            kept.take(self, rows.clone());
            kept.end_episode();
        }
        kept
    }

    /// The data set without the rows at some places: what lies before and after such rows in an
    /// episode are episodes of their own.
    #[must_use]
    pub fn without(self, left_out: impl Fn([f32; 2]) -> bool) -> Self {
        let mut kept = Self::new(self.shape.clone());
        for episode in &self.episodes {
            let mut start = episode.start;
            for row in episode.clone().filter(|row| left_out(self.place(*row))) {
                kept.take(&self, start..row);
                kept.end_episode();
                start = row + 1;
            }
            kept.take(&self, start..episode.end);
            kept.end_episode();
        }
        kept
    }

    /// Appends rows of a data set of the same shape, without an episode of them.
    fn take(&mut self, from: &Self, rows: Range<usize>) {
        fn append<T: Pod>(into: &mut Array<T>, from: &[T], rows: &Range<usize>, width: usize) {
            let values = from.get(rows.start * width..rows.end * width);
            into.extend_from_slice(values.unwrap_or_default());
        }
        let [observation, action] = self.widths;
        append(
            &mut self.observations,
            &from.observations,
            &rows,
            observation,
        );
        append(&mut self.images, &from.images, &rows, observation);
        append(&mut self.actions, &from.actions, &rows, action);
        append(&mut self.rewards, &from.rewards, &rows, 1);
        self.terminals
            .extend_from_slice(&from.terminals[rows.clone()]);
        append(&mut self.goals, &from.goals, &rows, 1);
        append(&mut self.image_places, &from.image_places, &rows, 1);
    }

    /// Makes an episode of the rows that are in none; of no rows none.
    pub fn end_episode(&mut self) {
        let start = self.episodes.last().map_or(0, |last| last.end);
        if start < self.len() {
            self.episodes.push(start..self.len());
        }
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

    /// Observation of a row.
    ///
    /// # Panics
    /// Where observations are images.
    #[must_use]
    pub fn observation(&self, row: usize) -> &[f32] {
        let width = self.widths[0];
        &self.observations[row * width..(row + 1) * width]
    }

    /// Image of a row.
    ///
    /// # Panics
    /// Where observations are vectors.
    #[must_use]
    pub fn image(&self, row: usize) -> &[u8] {
        let width = self.widths[0];
        &self.images[row * width..(row + 1) * width]
    }

    /// Action of a row.
    #[must_use]
    pub fn action(&self, row: usize) -> &[f32] {
        let width = self.widths[1];
        &self.actions[row * width..(row + 1) * width]
    }

    /// Place of the body in a row (m).
    #[must_use]
    pub fn place(&self, row: usize) -> [f32; 2] {
        if let Some(place) = self.image_places.get(row) {
            return *place;
        }
        let at = row * self.widths[0];
        [self.observations[at], self.observations[at + 1]]
    }

    /// Places of all rows (m).
    #[must_use]
    pub fn places(&self) -> Vec<[f32; 2]> {
        (0..self.len()).map(|row| self.place(row)).collect()
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
        assert_eq!(data.select(1..1), Dataset::new(Shape::ant()));
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
        let none = Dataset::new(Shape::ant());
        assert_eq!(none.share_from_to(a, c, 1.0), 0.0);
    }

    #[test]
    fn rows_of_any_shape_are_selected_and_left_out() {
        for shape in [Shape::vectors(4, 2), Shape::images(&[8, 8, 3], 3)] {
            let data = made::of(&shape, &[3, 1, 4]);
            made::sound(&data);
            assert_eq!(data.select(0..3), data);
            assert_eq!(data.kept(&[true; 3]), data);
            let last = data.select(1..3);
            made::sound(&last);
            assert_eq!(last.action(1), data.action(4));
            assert_eq!(last.place(1), data.place(4));
            let gone = data.place(1);
            let cut = data.clone().without(|place| place == gone);
            made::sound(&cut);
            assert_eq!(cut.episodes, [0..1, 1..2, 2..3, 3..7]);
            match shape.element() {
                Element::F32 => assert_eq!(cut.observation(1), data.observation(2)),
                Element::U8 => assert_eq!(cut.image(1), data.image(2)),
            }
        }
    }
}
