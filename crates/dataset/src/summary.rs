//! What a data set holds, in figures.

use std::collections::BTreeMap;
use std::fmt;

use maze::CELL_SIZE;

use crate::{Dataset, Shape};

/// Rows ahead at which [`Dataset::at_rest`] looks: a second.
const AHEAD: usize = 10;
/// Way within that second below which the ant rests (m); walking, it makes 1 to 2 m.
const WAY: f32 = 0.1;

/// Figures of a data set, for people. `Display` gives a line for each.
#[derive(Debug, Clone, PartialEq)]
pub struct Summary {
    /// What a row holds.
    pub shape: Shape,
    /// Rows.
    pub rows: usize,
    /// Episodes.
    pub episodes: usize,
    /// Rows of the shortest, the mean and the longest episode.
    pub lengths: (usize, f64, usize),
    /// Least, mean and greatest sum of an episode's rewards.
    pub returns: (f64, f64, f64),
    /// Share of rows whose reward is above zero.
    pub rewarded: f64,
    /// Share of rows at rest: [`Dataset::at_rest`].
    pub at_rest: f64,
    /// Least and greatest x and y of the torso (m).
    pub bounds: [[f32; 2]; 2],
    /// Rows in each 4 m cell that any row lies in: [`Dataset::coverage`].
    pub coverage: BTreeMap<[i32; 2], usize>,
}

impl Dataset {
    /// Whether the ant moves less than 0.1 m in the second after a row, or in the last second of
    /// the episode for the rows within it.
    #[must_use]
    pub fn at_rest(&self, row: usize) -> bool {
        let Some(episode) = self.episodes.get(self.episode_of(row)) else {
            return true;
        };
        self.rests(row, episode.start, episode.end)
    }

    fn rests(&self, row: usize, start: usize, end: usize) -> bool {
        let from = row.min(end.saturating_sub(1 + AHEAD).max(start));
        let to = (from + AHEAD).min(end - 1);
        let ([x, y], [u, v]) = (self.place(from), self.place(to));
        (x - u).hypot(y - v) < WAY
    }

    /// Rows in each cell of side `cell` (m) that any row lies in. Cell `[i, j]` has its centre at
    /// `(i cell, j cell)`, so that 4 m gives D4RL's cells, by column and row less one.
    #[must_use]
    pub fn coverage(&self, cell: f32) -> BTreeMap<[i32; 2], usize> {
        let mut cells = BTreeMap::new();
        for row in 0..self.len() {
            let key = self.place(row).map(|value| (value / cell).round() as i32);
            *cells.entry(key).or_default() += 1;
        }
        cells
    }

    /// Figures of the whole data set.
    #[must_use]
    pub fn summary(&self) -> Summary {
        let count = self.episodes.len().max(1) as f64;
        let lengths = || self.episodes.iter().map(ExactSizeIterator::len);
        let sum = |rewards: &[f32]| rewards.iter().map(|r| f64::from(*r)).sum::<f64>();
        let returns = || self.episodes.iter().map(|e| sum(&self.rewards[e.clone()]));
        let rest = |start: usize, end: usize| {
            (start..end)
                .filter(|row| self.rests(*row, start, end))
                .count()
        };
        let resting: usize = self.episodes.iter().map(|e| rest(e.start, e.end)).sum();
        let rewarded = self.rewards.iter().filter(|reward| **reward > 0.0).count();
        let share = |rows: usize| rows as f64 / self.len().max(1) as f64;
        let mut bounds = [[f32::INFINITY; 2], [f32::NEG_INFINITY; 2]];
        for row in 0..self.len() {
            for (axis, value) in self.place(row).into_iter().enumerate() {
                bounds[0][axis] = bounds[0][axis].min(value);
                bounds[1][axis] = bounds[1][axis].max(value);
            }
        }
        Summary {
            shape: self.shape().clone(),
            rows: self.len(),
            episodes: self.episodes.len(),
            lengths: (
                lengths().min().unwrap_or(0),
                self.len() as f64 / count,
                lengths().max().unwrap_or(0),
            ),
            returns: (
                returns().reduce(f64::min).unwrap_or(0.0),
                sum(&self.rewards) / count,
                returns().reduce(f64::max).unwrap_or(0.0),
            ),
            rewarded: share(rewarded),
            at_rest: share(resting),
            bounds,
            coverage: self.coverage(CELL_SIZE),
        }
    }
}

impl fmt::Display for Summary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (min, mean, max) = self.lengths;
        // To the centimetre, and no negative zero.
        let rounded = |metres| (100.0 * f64::from(metres)).round() / 100.0 + 0.0;
        let [[left, bottom], [right, top]] = self.bounds.map(|place| place.map(rounded));
        let least = self.coverage.values().min().copied().unwrap_or(0);
        let cells = self.coverage.len();
        writeln!(f, "rows          {}", self.rows)?;
        writeln!(f, "each          {}", self.shape)?;
        writeln!(f, "episodes      {}", self.episodes)?;
        writeln!(f, "length        {min} to {max} rows, mean {mean:.1}")?;
        let (worst, middle, best) = self.returns;
        writeln!(f, "return        {worst:.3} to {best:.3}, mean {middle:.3}")?;
        writeln!(f, "rewarded      {:.2} % of rows", 100.0 * self.rewarded)?;
        writeln!(f, "at rest       {:.2} % of rows", 100.0 * self.at_rest)?;
        writeln!(f, "x             {left:.2} to {right:.2} m")?;
        writeln!(f, "y             {bottom:.2} to {top:.2} m")?;
        write!(
            f,
            "coverage      {cells} cells of {CELL_SIZE} m, at least {least} rows in each"
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::made;

    /// Walks 0.2 m a step along x for 40 rows, then stays for 20; and an episode of one row.
    fn walk() -> Dataset {
        let places: Vec<[f32; 2]> = (0..60).map(|t| [0.2 * (t.min(40)) as f32, 1.0]).collect();
        made::along(&[&places, &[[-8.0, 3.0]]])
    }

    #[test]
    fn figures_are_those_of_the_walk() {
        let mut data = walk();
        data.rewards[..6].fill(0.5);
        let summary = data.summary();
        assert_eq!((summary.rows, summary.episodes), (61, 2));
        assert_eq!(summary.lengths, (1, 30.5, 60));
        assert_eq!(summary.returns, (0.0, 1.5, 3.0));
        assert_eq!(summary.rewarded, 6.0 / 61.0);
        assert_eq!(summary.bounds, [[-8.0, 1.0], [8.0, 3.0]]);
        // Rows 40 to 59 stay, and the lone row has nowhere to go.
        assert_eq!(summary.at_rest, 21.0 / 61.0);
        let resting: Vec<usize> = (0..61).filter(|row| data.at_rest(*row)).collect();
        assert_eq!(resting, (40..61).collect::<Vec<_>>());
        let text = summary.to_string();
        let row = "each          observations of 29 values and actions of 8\n";
        assert!(text.contains(row), "{text}");
        assert!(
            text.contains("length        1 to 60 rows, mean 30.5\n"),
            "{text}"
        );
        assert!(
            text.ends_with("4 cells of 4 m, at least 1 rows in each"),
            "{text}"
        );
    }

    #[test]
    fn coverage_counts_rows_by_the_nearest_centre() {
        let cells = walk().coverage(4.0);
        let keys: Vec<[i32; 2]> = cells.keys().copied().collect();
        assert_eq!(keys, [[-2, 1], [0, 0], [1, 0], [2, 0]]);
        assert_eq!(cells.values().sum::<usize>(), 61);
        assert_eq!(cells[&[0, 0]], 10);
    }

    #[test]
    fn no_rows_give_zeros_and_no_panic() {
        let summary = Dataset::new(Shape::ant()).summary();
        assert_eq!(
            (summary.rows, summary.lengths, summary.at_rest),
            (0, (0, 0.0, 0), 0.0)
        );
        assert!(Dataset::new(Shape::ant()).at_rest(3));
    }
}
