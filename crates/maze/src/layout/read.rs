//! Reads maps.

use super::{Cell, Layout};

/// Why a map was refused.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum LayoutError {
    /// The name is none of the built-in mazes.
    #[error("unknown maze '{0}'; use {names}, or custom with rows", names = Layout::NAMES.join(", "))]
    UnknownName(String),
    /// No rows at all.
    #[error("the maze has no rows")]
    Empty,
    /// Nothing but walls.
    #[error("the maze has no free cell, only walls")]
    NoFreeCell,
    /// A row is longer or shorter than the first.
    #[error("row {row} of the maze has {got} cells, the first row has {expected}")]
    Ragged {
        /// Index of the row, from 0.
        row: usize,
        /// Cells of the first row.
        expected: usize,
        /// Cells of this row.
        got: usize,
    },
    /// A character that is no cell.
    #[error(
        "row {row} of the maze holds '{found}'; cells are 1 (wall), 0 (free), r (start), g (goal), \
         i (teleport in) and o (teleport out)"
    )]
    UnknownCell {
        /// Index of the row, from 0.
        row: usize,
        /// The character found.
        found: char,
    },
    /// No start cell, or more than one.
    #[error("the maze has {0} start cells 'r'; it needs exactly one")]
    Starts(usize),
    /// No goal cell.
    #[error("the maze has no goal cell 'g'")]
    NoGoal,
    /// Only one end of a teleport.
    #[error("the maze has cells 'i' or 'o' alone; a teleport needs both")]
    HalfTeleport,
    /// A goal that no path leads to.
    #[error("the goal at row {}, column {} cannot be reached from the start", .0.0, .0.1)]
    Unreachable(Cell),
}

impl Layout {
    /// Reads a map from its rows of text.
    ///
    /// # Errors
    /// Any [`LayoutError`]: ragged rows, unknown cells, no free cell, no start, no goal, half a
    /// teleport, a goal that cannot be reached.
    pub fn from_rows<S: AsRef<str>>(rows: &[S]) -> Result<Self, LayoutError> {
        let columns = rows
            .first()
            .ok_or(LayoutError::Empty)?
            .as_ref()
            .chars()
            .count();
        let mut walls = Vec::with_capacity(rows.len() * columns);
        let (mut starts, mut goals) = (vec![], vec![]);
        let (mut inlets, mut outlets) = (vec![], vec![]);
        for (row, text) in rows.iter().enumerate() {
            let got = text.as_ref().chars().count();
            if got != columns {
                return Err(LayoutError::Ragged {
                    row,
                    expected: columns,
                    got,
                });
            }
            for (column, cell) in text.as_ref().chars().enumerate() {
                walls.push(cell == '1');
                match cell {
                    '1' | '0' => {}
                    'r' => starts.push((row, column)),
                    'g' => goals.push((row, column)),
                    'i' => inlets.push((row, column)),
                    'o' => outlets.push((row, column)),
                    found => return Err(LayoutError::UnknownCell { row, found }),
                }
            }
        }
        if walls.iter().all(|wall| *wall) {
            return Err(LayoutError::NoFreeCell);
        }
        let &[start] = starts.as_slice() else {
            return Err(LayoutError::Starts(starts.len()));
        };
        if goals.is_empty() {
            return Err(LayoutError::NoGoal);
        }
        if inlets.is_empty() != outlets.is_empty() {
            return Err(LayoutError::HalfTeleport);
        }
        let layout = Self {
            rows: rows.len(),
            columns,
            walls,
            start,
            play_goals: goals.clone(),
            goals,
            tasks: vec![],
            inlets,
            outlets,
        };
        let reach = layout.distances(start);
        match layout
            .goals
            .iter()
            .find(|&&goal| reach[layout.index(goal)].is_none())
        {
            Some(&goal) => Err(LayoutError::Unreachable(goal)),
            None => Ok(layout),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faults_of_a_map_are_named() {
        let fault = |rows: &[&str]| Layout::from_rows(rows).unwrap_err();
        assert_eq!(fault(&[]), LayoutError::Empty);
        assert_eq!(
            fault(&["111", "1r"]),
            LayoutError::Ragged {
                row: 1,
                expected: 3,
                got: 2
            }
        );
        assert_eq!(
            fault(&["1x1"]),
            LayoutError::UnknownCell { row: 0, found: 'x' }
        );
        assert_eq!(fault(&["11", "11"]), LayoutError::NoFreeCell);
        assert_eq!(fault(&["rgi"]), LayoutError::HalfTeleport);
        assert_eq!(fault(&["1g1"]), LayoutError::Starts(0));
        assert_eq!(fault(&["1r1"]), LayoutError::NoGoal);
        assert_eq!(fault(&["r1g"]), LayoutError::Unreachable((0, 2)));
    }
}
