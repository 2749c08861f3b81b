//! Maze maps: rows of `1` (wall), `0` (free), `r` (start) and `g` (goal), as in D4RL, and `i`
//! (teleport in) and `o` (teleport out) as OGBench's teleport maze has them.

mod maps;
mod paths;
mod read;
mod walls;

pub use read::LayoutError;

/// Side of a cell (m).
pub const CELL_SIZE: f32 = 4.0;
/// Height of a wall (m).
pub const WALL_HEIGHT: f32 = 2.0;

/// Row and column of a cell.
pub type Cell = (usize, usize);

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

impl Layout {
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
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn start_is_the_origin_and_goals_lie_where_d4rl_has_them() {
        let medium = Layout::named("medium").unwrap();
        assert_eq!(medium.centre(medium.start()), [0.0, 0.0]);
        assert_eq!(medium.centre(medium.goals()[0]), [20.0, 20.0]);
        let large = Layout::named("large").unwrap();
        assert_eq!(large.centre(large.goals()[0]), [32.0, 24.0]);
    }
}
