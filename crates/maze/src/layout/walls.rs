//! The walls' surfaces.

use super::{CELL_SIZE, Layout};

impl Layout {
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
