//! Maze maps: rows of `1` (wall), `0` (free), `r` (start) and `g` (goal), as in D4RL.

use std::collections::VecDeque;

/// Side of a cell (m).
pub const CELL_SIZE: f32 = 4.0;
/// Height of a wall (m).
pub const WALL_HEIGHT: f32 = 2.0;

/// Row and column of a cell.
pub type Cell = (usize, usize);

/// Why a map was refused.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum LayoutError {
    /// The name is none of the built-in mazes.
    #[error("unknown maze '{0}'; use umaze, medium, large, or custom with rows")]
    UnknownName(String),
    /// No rows at all.
    #[error("the maze has no rows")]
    Empty,
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
    /// A character other than 1, 0, r, g.
    #[error("row {row} of the maze holds '{found}'; cells are 1 (wall), 0 (free), r and g")]
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
    /// A goal that no path leads to.
    #[error("the goal at row {}, column {} cannot be reached from the start", .0.0, .0.1)]
    Unreachable(Cell),
}

/// A maze map. The start cell's centre is the origin of world coordinates; x grows with the
/// column, y with the row.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Layout {
    rows: usize,
    columns: usize,
    walls: Vec<bool>,
    start: Cell,
    goals: Vec<Cell>,
    play_goals: Vec<Cell>,
}

const UMAZE: [&str; 5] = ["11111", "1r001", "11101", "1g001", "11111"];
const MEDIUM: [&str; 8] = [
    "11111111", "1r011001", "10010001", "11000111", "10010001", "10100101", "100010g1", "11111111",
];
const LARGE: [&str; 9] = [
    "111111111111",
    "1r0001000001",
    "101101010101",
    "100000010001",
    "101111011101",
    "100101000001",
    "110101010111",
    "100100010g01",
    "111111111111",
];

impl Layout {
    /// A maze of D4RL by name: `umaze`, `medium` or `large`.
    ///
    /// # Errors
    /// [`LayoutError::UnknownName`] for any other name.
    pub fn named(name: &str) -> Result<Self, LayoutError> {
        let (rows, play): (&[&str], &[Cell]) = match name {
            "umaze" => (&UMAZE, &[]),
            // Goal cells of D4RL's generation maps, which the `play` data aim at.
            "medium" => (&MEDIUM, &[(2, 6), (5, 1), (6, 5)]),
            "large" => (
                &LARGE,
                &[(1, 6), (3, 5), (3, 10), (5, 2), (7, 4), (7, 6), (7, 9)],
            ),
            _ => return Err(LayoutError::UnknownName(name.to_owned())),
        };
        let mut layout = Self::from_rows(rows)?;
        if !play.is_empty() {
            layout.play_goals = play.to_vec();
        }
        Ok(layout)
    }

    /// The maze that a run file means: the rows for `custom`, else the one of that name.
    ///
    /// # Errors
    /// Any [`LayoutError`].
    pub fn of<S: AsRef<str>>(name: &str, rows: &[S]) -> Result<Self, LayoutError> {
        match name {
            "custom" => Self::from_rows(rows),
            _ => Self::named(name),
        }
    }

    /// Reads a map from its rows of text.
    ///
    /// # Errors
    /// Any [`LayoutError`]: ragged rows, unknown cells, no start, no goal, unreachable goal.
    pub fn from_rows<S: AsRef<str>>(rows: &[S]) -> Result<Self, LayoutError> {
        let columns = rows
            .first()
            .ok_or(LayoutError::Empty)?
            .as_ref()
            .chars()
            .count();
        let mut walls = Vec::with_capacity(rows.len() * columns);
        let (mut starts, mut goals) = (vec![], vec![]);
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
                    found => return Err(LayoutError::UnknownCell { row, found }),
                }
            }
        }
        let &[start] = starts.as_slice() else {
            return Err(LayoutError::Starts(starts.len()));
        };
        if goals.is_empty() {
            return Err(LayoutError::NoGoal);
        }
        let layout = Self {
            rows: rows.len(),
            columns,
            walls,
            start,
            play_goals: goals.clone(),
            goals,
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

    fn index(&self, cell: Cell) -> usize {
        cell.0 * self.columns + cell.1
    }

    /// Rows and columns.
    #[must_use]
    pub fn shape(&self) -> (usize, usize) {
        (self.rows, self.columns)
    }

    /// The start cell.
    #[must_use]
    pub fn start(&self) -> Cell {
        self.start
    }

    /// The goal cells of evaluation.
    #[must_use]
    pub fn goals(&self) -> &[Cell] {
        &self.goals
    }

    /// The hand-picked goal cells of "play" data.
    #[must_use]
    pub fn play_goals(&self) -> &[Cell] {
        &self.play_goals
    }

    /// Whether a cell is a wall; cells beyond the map count as walls.
    #[must_use]
    pub fn is_wall(&self, cell: Cell) -> bool {
        cell.0 >= self.rows || cell.1 >= self.columns || self.walls[self.index(cell)]
    }

    /// All free cells, row by row.
    #[must_use]
    pub fn free_cells(&self) -> Vec<Cell> {
        (0..self.rows)
            .flat_map(|row| (0..self.columns).map(move |column| (row, column)))
            .filter(|&cell| !self.is_wall(cell))
            .collect()
    }

    /// Centre of a cell (m).
    #[must_use]
    pub fn centre(&self, cell: Cell) -> [f32; 2] {
        [
            (cell.1 as f32 - self.start.1 as f32) * CELL_SIZE,
            (cell.0 as f32 - self.start.0 as f32) * CELL_SIZE,
        ]
    }

    /// The cell that holds a place (m), none beyond the map's edge.
    #[must_use]
    pub fn cell_at(&self, place: [f32; 2]) -> Option<Cell> {
        let column = (place[0] / CELL_SIZE).round() + self.start.1 as f32;
        let row = (place[1] / CELL_SIZE).round() + self.start.0 as f32;
        let inside = row >= 0.0 && column >= 0.0;
        let cell = (row as usize, column as usize);
        (inside && cell.0 < self.rows && cell.1 < self.columns).then_some(cell)
    }

    /// Whether a place (m) lies in a wall or beyond the map.
    #[must_use]
    pub fn is_wall_at(&self, place: [f32; 2]) -> bool {
        self.cell_at(place).is_none_or(|cell| self.is_wall(cell))
    }

    /// Cells to walk from each cell to `goal`, by breadth-first search; none where no path leads.
    /// Indexed row by row.
    #[must_use]
    pub fn distances(&self, goal: Cell) -> Vec<Option<u32>> {
        let mut distance = vec![None; self.walls.len()];
        let mut queue = VecDeque::from([(goal, 0)]);
        distance[self.index(goal)] = Some(0);
        while let Some((cell, steps)) = queue.pop_front() {
            for next in self.neighbours(cell) {
                let slot = &mut distance[next.0 * self.columns + next.1];
                if slot.is_none() {
                    *slot = Some(steps + 1);
                    queue.push_back((next, steps + 1));
                }
            }
        }
        distance
    }

    /// The free cells that share an edge with a cell.
    pub fn neighbours(&self, cell: Cell) -> impl Iterator<Item = Cell> + '_ {
        [(0, 1), (1, 0), (0, usize::MAX), (usize::MAX, 0)]
            .into_iter()
            .map(move |(row, column)| (cell.0.wrapping_add(row), cell.1.wrapping_add(column)))
            .filter(|&next| !self.is_wall(next))
    }

    /// The next cell on a shortest path, given [`distances`](Self::distances) to the goal.
    /// The cell itself at the goal and where no path leads.
    #[must_use]
    pub fn next_cell(&self, distances: &[Option<u32>], cell: Cell) -> Cell {
        let here = distances.get(self.index(cell)).copied().flatten();
        self.neighbours(cell)
            .find(
                |&next| matches!((distances[self.index(next)], here), (Some(d), Some(h)) if d < h),
            )
            .unwrap_or(cell)
    }

    /// Walls as boxes (centre x, y, half width, half depth; m), runs of a row merged.
    #[must_use]
    pub fn boxes(&self) -> Vec<[f32; 4]> {
        let mut boxes = vec![];
        for row in 0..self.rows {
            let mut column = 0;
            while column < self.columns {
                let first = column;
                while column < self.columns && self.is_wall((row, column)) {
                    column += 1;
                }
                if column > first {
                    let [left, y] = self.centre((row, first));
                    let half = (column - first) as f32 * CELL_SIZE / 2.0;
                    boxes.push([left - CELL_SIZE / 2.0 + half, y, half, CELL_SIZE / 2.0]);
                }
                column += 1;
            }
        }
        boxes
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn d4rl_mazes_have_their_known_sizes() {
        for (name, free, path) in [("umaze", 7, 6), ("medium", 26, 10), ("large", 46, 14)] {
            let layout = Layout::named(name).unwrap();
            assert_eq!(layout.free_cells().len(), free, "{name}");
            let start = layout.distances(layout.goals()[0])[layout.index(layout.start())];
            assert_eq!(start, Some(path), "{name}");
        }
    }

    #[test]
    fn start_is_the_origin_and_goals_lie_where_d4rl_has_them() {
        let medium = Layout::named("medium").unwrap();
        assert_eq!(medium.centre(medium.start()), [0.0, 0.0]);
        assert_eq!(medium.centre(medium.goals()[0]), [20.0, 20.0]);
        let large = Layout::named("large").unwrap();
        assert_eq!(large.centre(large.goals()[0]), [32.0, 24.0]);
    }

    #[test]
    fn following_next_cell_reaches_the_goal() {
        let layout = Layout::named("large").unwrap();
        let distances = layout.distances(layout.goals()[0]);
        let mut cell = layout.start();
        for _ in 0..14 {
            cell = layout.next_cell(&distances, cell);
        }
        assert_eq!(cell, layout.goals()[0]);
    }

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
        assert_eq!(fault(&["1g1"]), LayoutError::Starts(0));
        assert_eq!(fault(&["1r1"]), LayoutError::NoGoal);
        assert_eq!(fault(&["r1g"]), LayoutError::Unreachable((0, 2)));
    }

    #[test]
    fn boxes_cover_the_walls_and_nothing_else() {
        let layout = Layout::named("medium").unwrap();
        let boxes = layout.boxes();
        let inside = |p: [f32; 2]| {
            boxes
                .iter()
                .any(|b| (p[0] - b[0]).abs() < b[2] && (p[1] - b[1]).abs() < b[3])
        };
        for row in 0..8 {
            for column in 0..8 {
                let centre = layout.centre((row, column));
                assert_eq!(
                    inside(centre),
                    layout.is_wall((row, column)),
                    "{row} {column}"
                );
            }
        }
    }
}
