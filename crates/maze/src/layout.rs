//! Maze maps: rows of `1` (wall), `0` (free), `r` (start) and `g` (goal), as in D4RL, and `i`
//! (teleport in) and `o` (teleport out) as OGBench's teleport maze has them.

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
    /// Start and goal cells of the evaluation tasks; empty where D4RL's protocol stands.
    tasks: Vec<(Cell, Cell)>,
    inlets: Vec<Cell>,
    outlets: Vec<Cell>,
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

const GIANT: [&str; 12] = [
    "1111111111111111",
    "1r10000001100001",
    "1010110101001101",
    "1000100100010001",
    "1011101111110101",
    "1000100010000101",
    "1110101001010111",
    "1000100100010001",
    "1010101111110101",
    "1011100010001101",
    "10000010001000g1",
    "1111111111111111",
];
const TELEPORT: [&str; 9] = [
    "111111111111",
    "1r00001o1001",
    "110100010011",
    "110111000001",
    "100001i10101",
    "1i1101010101",
    "1o11010101o1",
    "1000010001g1",
    "111111111111",
];

impl Layout {
    /// The mazes that have a name: D4RL's three, then OGBench's others.
    pub const NAMES: [&str; 5] = ["umaze", "medium", "large", "giant", "teleport"];

    /// A maze by name: `umaze`, `medium` and `large` of D4RL (`d4rl/locomotion/maze_env.py`),
    /// `giant` and `teleport` of OGBench (seohongpark/ogbench, `ogbench/locomaze/maze.py`).
    ///
    /// # Errors
    /// [`LayoutError::UnknownName`] for any other name.
    pub fn named(name: &str) -> Result<Self, LayoutError> {
        // Goal cells of D4RL's generation maps, which the `play` data aim at, and OGBench's tasks.
        let (rows, play, tasks): (&[&str], &[Cell], &[(Cell, Cell)]) = match name {
            "umaze" => (&UMAZE, &[], &[]),
            "medium" => (&MEDIUM, &[(2, 6), (5, 1), (6, 5)], &[]),
            "large" => (
                &LARGE,
                &[(1, 6), (3, 5), (3, 10), (5, 2), (7, 4), (7, 6), (7, 9)],
                &[],
            ),
            "giant" => (
                &GIANT,
                &[],
                &[
                    ((1, 1), (10, 14)),
                    ((1, 14), (10, 1)),
                    ((8, 14), (1, 1)),
                    ((8, 3), (5, 12)),
                    ((5, 9), (3, 8)),
                ],
            ),
            "teleport" => (
                &TELEPORT,
                &[],
                &[
                    ((1, 10), (7, 1)),
                    ((1, 1), (7, 10)),
                    ((5, 6), (7, 10)),
                    ((7, 1), (7, 10)),
                    ((5, 6), (7, 1)),
                ],
            ),
            _ => return Err(LayoutError::UnknownName(name.to_owned())),
        };
        let mut layout = Self::from_rows(rows)?;
        if !play.is_empty() {
            layout.play_goals = play.to_vec();
        }
        layout.tasks = tasks.to_vec();
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

    /// Start and goal cells of the maze's evaluation tasks; empty where the start cell and the
    /// goal cells are all there is to it, as in D4RL.
    #[must_use]
    pub fn tasks(&self) -> &[(Cell, Cell)] {
        &self.tasks
    }

    /// Cells that take an ant away when it comes near their centre.
    #[must_use]
    pub fn inlets(&self) -> &[Cell] {
        &self.inlets
    }

    /// Cells at whose centre it comes out again, one of them at random.
    #[must_use]
    pub fn outlets(&self) -> &[Cell] {
        &self.outlets
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

    /// The free cells that can be walked to from the start without a teleport, row by row.
    #[must_use]
    pub fn reachable_cells(&self) -> Vec<Cell> {
        let reach = self.distances(self.start);
        let mut cells = self.free_cells();
        cells.retain(|&cell| reach[self.index(cell)].is_some());
        cells
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

    /// The free cell whose centre is nearest to a place (m).
    #[must_use]
    pub fn nearest_free(&self, place: [f32; 2]) -> Cell {
        let gap = |cell: &Cell| {
            let [x, y] = self.centre(*cell);
            (x - place[0]).hypot(y - place[1])
        };
        let free = self.free_cells().into_iter();
        free.min_by(|a, b| gap(a).total_cmp(&gap(b)))
            .unwrap_or(self.start)
    }

    /// Moves a circle (m) out of the walls, as little as possible. Its radius is less than half a
    /// cell. A circle with its centre in a wall goes to the nearest free cell's centre.
    #[must_use]
    pub fn pushed_out(&self, place: [f32; 2], radius: f32) -> [f32; 2] {
        let Some(cell) = self.cell_at(place).filter(|cell| !self.is_wall(*cell)) else {
            return self.centre(self.nearest_free(place));
        };
        let centre = self.centre(cell);
        // In the quarter of the cell that the circle's centre is in, mirrored to be the positive
        // one, only three other cells are near enough to touch.
        let signs = [0, 1].map(|axis| {
            if place[axis] < centre[axis] {
                -1.0
            } else {
                1.0
            }
        });
        let mut offset = [0, 1].map(|axis| signs[axis] * (place[axis] - centre[axis]));
        let beside = |index: usize, sign: f32| match sign > 0.0 {
            true => index.wrapping_add(1),
            false => index.wrapping_sub(1),
        };
        let (row, column) = (beside(cell.0, signs[1]), beside(cell.1, signs[0]));
        let walls = [(cell.0, column), (row, cell.1)].map(|cell| self.is_wall(cell));
        let half = CELL_SIZE / 2.0;
        for axis in 0..2 {
            if walls[axis] {
                offset[axis] = offset[axis].min(half - radius);
            }
        }
        if walls == [false; 2] && self.is_wall((row, column)) {
            let [x, y] = offset.map(|offset| half - offset);
            let distance = x.hypot(y);
            if distance < radius && distance > 0.0 {
                offset = [x, y].map(|gap| half - gap * radius / distance);
            }
        }
        [0, 1].map(|axis| centre[axis] + signs[axis] * offset[axis])
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

    /// Walls as boxes (centre x, y, half width, half depth; m), runs of a row merged. Where a map
    /// is open at its edge a wall closes it.
    #[must_use]
    pub fn boxes(&self) -> Vec<[f32; 4]> {
        let (rows, columns) = (self.rows as i64, self.columns as i64);
        let is_wall = |row: i64, column: i64| {
            let cell = |row: i64, column: i64| {
                let inside = row >= 0 && column >= 0;
                let cell = (row as usize, column as usize);
                (inside && cell.0 < self.rows && cell.1 < self.columns).then_some(cell)
            };
            match cell(row, column) {
                Some(cell) => self.is_wall(cell),
                None => (-1..=1)
                    .flat_map(|i| (-1..=1).map(move |j| (row + i, column + j)))
                    .filter_map(|(row, column)| cell(row, column))
                    .any(|cell| !self.is_wall(cell)),
            }
        };
        let mut boxes = vec![];
        for row in -1..=rows {
            let mut column = -1;
            while column <= columns {
                let first = column;
                while column <= columns && is_wall(row, column) {
                    column += 1;
                }
                if column > first {
                    let half = (column - first) as f32 * CELL_SIZE / 2.0;
                    let left = (first - self.start.1 as i64) as f32 * CELL_SIZE;
                    let y = (row - self.start.0 as i64) as f32 * CELL_SIZE;
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
    fn mazes_have_their_known_sizes() {
        for (name, free, path) in [
            ("umaze", 7, 6),
            ("medium", 26, 10),
            ("large", 46, 14),
            ("giant", 86, 30),
            ("teleport", 45, 15),
        ] {
            let layout = Layout::named(name).unwrap();
            assert_eq!(layout.free_cells().len(), free, "{name}");
            let start = layout.distances(layout.goals()[0])[layout.index(layout.start())];
            assert_eq!(start, Some(path), "{name}");
            for (start, goal) in layout.tasks() {
                let reach = layout.distances(*start);
                assert!(!layout.is_wall(*start) && reach[layout.index(*goal)].is_some());
            }
        }
    }

    #[test]
    fn the_teleports_exits_include_a_cell_without_a_way_out() {
        let layout = Layout::named("teleport").unwrap();
        assert_eq!(layout.inlets(), [(4, 6), (5, 1)]);
        assert_eq!(layout.outlets(), [(1, 7), (6, 1), (6, 10)]);
        let reachable = layout.reachable_cells();
        assert_eq!(reachable.len() + 1, layout.free_cells().len());
        assert!(!reachable.contains(&(1, 7)));
    }

    #[test]
    fn an_open_edge_is_closed_by_a_wall() {
        let boxes = Layout::from_rows(&["rg"]).unwrap().boxes();
        let closed = [
            [2.0, -4.0, 8.0, 2.0],
            [-4.0, 0.0, 2.0, 2.0],
            [8.0, 0.0, 2.0, 2.0],
            [2.0, 4.0, 8.0, 2.0],
        ];
        assert_eq!(boxes, closed);
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
        assert_eq!(fault(&["11", "11"]), LayoutError::NoFreeCell);
        assert_eq!(fault(&["rgi"]), LayoutError::HalfTeleport);
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
