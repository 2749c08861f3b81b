//! Where the rows of a data set are in its maze.

use std::fmt::Write;

use ::dataset::Dataset;
use maze::{CELL_SIZE, Layout};

/// Shades of a cell, from never visited to the most visited.
const SHADES: &[u8] = b" .:-=+*#%@";

/// Maximum cells per side without a layout.
const MOST: i64 = 60;

/// A map of the rows per cell as shades, and of walls as blocks, with y down. Without a layout it covers the
/// visited cells.
pub(super) fn visit_map(data: &Dataset, layout: Option<&Layout>) -> String {
    let counts = match layout {
        Some(layout) => visits(data, layout),
        None => {
            let coverage = data.coverage(CELL_SIZE);
            let bound = |axis: usize| {
                let along = || coverage.keys().map(|cell| cell[axis]);
                (along().min().unwrap_or(0), along().max().unwrap_or(0))
            };
            let ((left, right), (top, bottom)) = (bound(0), bound(1));
            // Too large for a terminal.
            if i64::from(right) - i64::from(left) > MOST
                || i64::from(bottom) - i64::from(top) > MOST
            {
                return format!("no picture: it would be of more than {MOST} cells a side\n");
            }
            let count = |x, y| coverage.get(&[x, y]).copied().unwrap_or(0);
            (top..=bottom)
                .map(|y| (left..=right).map(|x| count(x, y)).collect())
                .collect()
        }
    };
    let most = counts.iter().flatten().max().copied().unwrap_or(0).max(1);
    let mut text = String::new();
    for (row, counts) in counts.iter().enumerate() {
        for (column, count) in counts.iter().enumerate() {
            let wall = layout.is_some_and(|layout| layout.is_wall((row, column)));
            if wall {
                text.push_str("██");
            } else {
                // Rounded up, so that every visited cell has a shade.
                let shade = char::from(SHADES[(count * (SHADES.len() - 1)).div_ceil(most)]);
                text.extend([shade, shade]);
            }
        }
        text.push('\n');
    }
    if let Some(layout) = layout {
        let inside = |(row, column)| !layout.is_wall((row, column));
        let cells = (0..counts.len()).flat_map(|row| (0..counts[row].len()).map(move |c| (row, c)));
        let free: usize = cells
            .filter(|cell| inside(*cell))
            .map(|(r, c)| counts[r][c])
            .sum();
        let outside = data.len() - free;
        let _ = writeln!(
            text,
            "{outside} of {} rows outside of the free cells",
            data.len()
        );
    }
    text
}

/// Rows in each cell of a layout, by row and column. The origin is the centre of the start cell (D4RL, OGBench),
/// or the centre of the maze with y up (Gymnasium-Robotics, Minari): the one with more rows in free cells.
fn visits(data: &Dataset, layout: &Layout) -> Vec<Vec<usize>> {
    let (rows, columns) = layout.shape();
    let corner = layout.centre((0, 0));
    let from_centre = |[x, y]: [f32; 2]| {
        [
            x + corner[0] + (columns as f32 - 1.0) * CELL_SIZE / 2.0,
            -y + corner[1] + (rows as f32 - 1.0) * CELL_SIZE / 2.0,
        ]
    };
    let count = |place: &dyn Fn(usize) -> [f32; 2]| {
        let mut counts = vec![vec![0; columns]; rows];
        let mut free = 0_usize;
        for row in 0..data.len() {
            if let Some(cell) = layout.cell_at(place(row)) {
                counts[cell.0][cell.1] += 1;
                free += usize::from(!layout.is_wall(cell));
            }
        }
        (free, counts)
    };
    let (in_start, start) = count(&|row| data.place(row));
    let (in_centre, centre) = count(&|row| from_centre(data.place(row)));
    if in_centre > in_start { centre } else { start }
}

#[cfg(test)]
mod tests {
    use ::dataset::Shape;

    use super::*;

    /// One episode through these positions.
    fn along(places: &[[f32; 2]]) -> Dataset {
        let mut data = Dataset::new(Shape::ant());
        for [x, y] in places {
            let mut observation = [0.0; 29];
            (observation[0], observation[1]) = (*x, *y);
            data.observations.extend(observation);
            data.actions.extend([0.0; 8]);
            data.rewards.push(0.0);
            data.terminals.push(false);
        }
        data.episodes = std::iter::once(0..places.len()).collect();
        data
    }

    #[test]
    fn the_map_has_shades_and_walls() {
        let places = [[0.0, 0.0], [0.1, 0.0], [0.0, 0.1], [4.0, 0.0], [0.0, 4.0]];
        let layout = Layout::named("umaze").unwrap();
        let text = visit_map(&along(&places), Some(&layout));
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(lines[1], "██@@--  ██");
        assert_eq!(lines[3], "██      ██");
        assert_eq!(lines[5], "1 of 5 rows outside of the free cells");
        let text = visit_map(&along(&places), None);
        assert_eq!(text, "@@--\n--  \n");
    }

    #[test]
    fn the_origin_of_positions_is_detected() {
        // In Gymnasium-Robotics, row 1 of five is at y = 4, and column 1 at x = -4.
        let places = [
            [-4.0, 4.0],
            [0.0, 4.0],
            [4.0, 4.0],
            [4.0, 0.0],
            [4.0, -4.0],
            [-4.0, -4.0],
        ];
        let layout = Layout::named("umaze").unwrap();
        let text = visit_map(&along(&places), Some(&layout));
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(lines[1], "██@@@@@@██");
        assert_eq!(lines[2], "██████@@██");
        assert_eq!(lines[3], "██@@  @@██");
        assert!(lines[5].starts_with("0 of 6"), "{text}");
    }

    #[test]
    fn distant_positions_are_not_drawn() {
        let text = visit_map(&along(&[[-1e30, 0.0], [1e30, 0.0]]), None);
        assert!(text.starts_with("no picture"), "{text}");
    }
}
