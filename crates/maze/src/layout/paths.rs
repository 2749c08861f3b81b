//! Shortest paths over cells.

use std::collections::VecDeque;

use super::{Cell, Layout};

impl Layout {
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
}

#[cfg(test)]
mod tests {
    use super::*;

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
}
