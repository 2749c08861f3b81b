//! What can be wrong with data that are whole and do not fit a run.

use std::fmt;

use crate::Shape;

/// Why a run cannot learn from a data set. One sentence each: what, how much, what to do.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Unfit {
    /// Rows of another body.
    #[error(
        "the file has {found}, the simulator '{body}' expects {wanted} ({instead}); use data recorded \
         with '{body}'"
    )]
    Shape {
        /// What the file has.
        found: Shape,
        /// What the run's simulator has.
        wanted: Shape,
        /// The run's simulator.
        body: &'static str,
        /// Which simulator has such rows, in words.
        instead: String,
    },
    /// Columns 3 to 6 are no rotation.
    #[error(
        "columns 3 to 6 of the observations are no unit quaternion in {share} of the rows{found}; \
         expected x, y, z, the quaternion w, x, y, z, 8 joint angles, then the velocities"
    )]
    Quaternion {
        /// Share of rows whose norm is not 1.
        share: Share,
        /// Where one stands instead, as a remark.
        found: String,
    },
    /// The quaternion's w stands last.
    #[error(
        "the quaternion stands as x, y, z, w in columns 3 to 6: read so the ant is upright in \
         {last} of the rows, as w, x, y, z in {first}; put w first"
    )]
    QuaternionOrder {
        /// Share of rows upright with w first.
        first: Share,
        /// The same with w last.
        last: Share,
    },
    /// Column 2 is no height of a torso.
    #[error(
        "column 2 of the observations, the torso's height, is not within 0 to 2.5 m in {share} of \
         the rows (median {median}); expected metres, in the order x, y, z"
    )]
    Height {
        /// Share of rows.
        share: Share,
        /// Median height (m).
        median: Number,
    },
    /// Columns 7 to 14 are no joint angles.
    #[error(
        "columns 7 to 14 of the observations, the joint angles, are farther than 1.5 rad out of \
         the ant's ranges in {share} of the rows (first in row {row}, column {column}: {value}); \
         expected radians, hip and ankle of legs 1 to 4"
    )]
    Joints {
        /// Share of rows.
        share: Share,
        /// First such row.
        row: usize,
        /// Its first such column.
        column: usize,
        /// The value there.
        value: Number,
    },
    /// A value that no ant has.
    #[error(
        "row {row} holds {value} in column {column} of the observations, and {count} of {rows} rows \
         hold values beyond 10000; mend or drop them"
    )]
    Huge {
        /// First such row.
        row: usize,
        /// Its first such column.
        column: usize,
        /// The value there.
        value: Number,
        /// Such rows.
        count: usize,
        /// All rows.
        rows: usize,
    },
    /// Actions beyond the actuators' range.
    #[error(
        "actions are not within -1 to 1 in {share} of the rows (first in row {row}: {value}, the \
         largest is {largest}); divide them by the largest torque"
    )]
    ActionRange {
        /// Share of rows.
        share: Share,
        /// First such row.
        row: usize,
        /// The value there.
        value: Number,
        /// Greatest magnitude of any action.
        largest: Number,
    },
    /// All actions are one.
    #[error(
        "every row has the same action, {value} in its first column: there is nothing to learn; \
         are 'actions' filled in?"
    )]
    SameAction {
        /// Its first value.
        value: Number,
    },
    /// A place far beyond the map.
    #[error(
        "row {row} lies at ({x}, {y}) m, far beyond the map of '{maze}' ({bounds}), and {count} of \
         {rows} rows do{hint}; mend or drop them"
    )]
    Far {
        /// First such row.
        row: usize,
        /// Its place (m).
        x: Number,
        /// Its place (m).
        y: Number,
        /// The config's maze.
        maze: String,
        /// What the map reaches over, in words.
        bounds: String,
        /// Such rows.
        count: usize,
        /// All rows.
        rows: usize,
        /// What fits instead, as a remark.
        hint: String,
    },
    /// Rows inside walls.
    #[error("{share} of the rows lie inside walls of '{maze}'; {instead}")]
    Walls {
        /// Share of rows in walls or beyond the map.
        share: Share,
        /// The config's maze.
        maze: String,
        /// What fits instead, and what to do.
        instead: String,
    },
    /// Velocities that are not those of the places.
    #[error(
        "the velocities in columns 15 and 16 do not follow the change of x, y from row to row over \
         0.1 s: {how}"
    )]
    Velocity {
        /// The figure, and what it may mean.
        how: String,
    },
    /// Rows that do not follow each other.
    #[error(
        "{share} of successive rows lie more than {most} m apart, farther than the {body} moves in \
         0.1 s (first after row {row}: {jump} m); are the rows shuffled? They must be in the order \
         of time"
    )]
    Shuffled {
        /// The run's simulator.
        body: &'static str,
        /// Share of pairs of rows.
        share: Share,
        /// Farthest that the body moves in a step (m).
        most: Number,
        /// First row before a jump.
        row: usize,
        /// That jump (m).
        jump: Number,
    },
    /// A body that stays where it is.
    #[error(
        "the {body} is under way in {moving} of {rows} rows (0.3 m or more within 10 steps{upright}), \
         fewer than graph.nodes = {nodes}; give data in which it moves, or lower graph.nodes",
        upright = if *standing { ", upright" } else { "" }
    )]
    Still {
        /// The run's simulator.
        body: &'static str,
        /// Whether it can fall, so that only rows in which it stands count.
        standing: bool,
        /// Rows in which it moves.
        moving: usize,
        /// All rows.
        rows: usize,
        /// Nodes that are asked for.
        nodes: usize,
    },
    /// Episodes too short for a pair or a segment.
    #[error(
        "no episode has more rows than {key} = {lag}: the longest of {episodes} has {longest}{why}; \
         lower {key}, or give data of longer episodes"
    )]
    TooShort {
        /// The key of the config that wants more.
        key: &'static str,
        /// Its value.
        lag: usize,
        /// Number of episodes.
        episodes: usize,
        /// Rows of the longest.
        longest: usize,
        /// What may have cut them, as a remark.
        why: &'static str,
    },
}

impl Unfit {
    /// Whether a run may go on regardless: not with rows of another body, and not where there is
    /// nothing to learn from.
    #[must_use]
    pub fn can_be_waived(&self) -> bool {
        !matches!(
            self,
            Self::Shape { .. } | Self::Still { .. } | Self::TooShort { .. }
        )
    }
}

/// A share, as a percentage.
#[derive(Debug, Clone, Copy, PartialEq, PartialOrd)]
pub struct Share(pub f64);

impl Share {
    /// `part` of `all`; nothing of nothing.
    #[must_use]
    pub fn of(part: usize, all: usize) -> Self {
        Self(part as f64 / all.max(1) as f64)
    }
}

impl fmt::Display for Share {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let percent = 100.0 * self.0;
        match percent {
            p if p > 0.0 && p < 0.05 => f.write_str("less than 0.1%"),
            p if (99.95..100.0).contains(&p) => f.write_str("more than 99.9%"),
            p => write!(f, "{p:.1}%"),
        }
    }
}

/// A number for people: two decimals, or powers of ten where it is large; never a negative zero.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Number(pub f32);

impl fmt::Display for Number {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0 {
            v if v.abs() >= 1e5 => write!(f, "{v:.2e}"),
            v if v.abs() < 0.005 => f.write_str("0.00"),
            v => write!(f, "{v:.2}"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shares_and_numbers_are_never_rounded_to_what_they_are_not() {
        let share = |part, all| Share::of(part, all).to_string();
        assert_eq!(share(0, 0), "0.0%");
        assert_eq!(share(1, 100_000), "less than 0.1%");
        assert_eq!(share(99_999, 100_000), "more than 99.9%");
        assert_eq!(share(841, 1000), "84.1%");
        let number = |v| Number(v).to_string();
        assert_eq!(number(-0.001), "0.00");
        assert_eq!(number(1e9), "1.00e9");
        assert_eq!(number(-12.345), "-12.35");
    }
}
