//! The frames of reference that public data sets of ants in mazes have.

use std::fmt;

use maze::{CELL_SIZE, Layout};
use simulator::Body;

use crate::Dataset;

/// Where the origin lies and which way the map's rows go.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Frame {
    /// D4RL's and this project's: the origin at the start cell's centre, rows with growing y.
    #[default]
    D4rl,
    /// OGBench's: the origin at the centre of the cell in row 1 and column 1, rows with growing y
    /// (seohongpark/ogbench, `ogbench/locomaze/maze.py`).
    Ogbench,
    /// Gymnasium-Robotics' and Minari's: the origin at the maze's centre, rows with falling y
    /// (Farama-Foundation/Gymnasium-Robotics, `gymnasium_robotics/envs/maze/maze_v4.py`).
    GymnasiumRobotics,
}

impl fmt::Display for Frame {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::D4rl => "D4RL's frame (origin at the start cell's centre, y downwards)",
            Self::Ogbench => "OGBench's frame (origin at the cell in row 1, column 1, y downwards)",
            Self::GymnasiumRobotics => {
                "Gymnasium-Robotics' frame (origin at the maze's centre, y upwards)"
            }
        })
    }
}

impl Frame {
    /// All, the project's own first.
    pub const ALL: [Self; 3] = [Self::D4rl, Self::Ogbench, Self::GymnasiumRobotics];

    /// A place of this frame in the project's own (m).
    #[must_use]
    pub fn to_own(self, layout: &Layout, [x, y]: [f32; 2]) -> [f32; 2] {
        let (rows, columns) = layout.shape();
        match self {
            Self::D4rl => [x, y],
            Self::Ogbench => {
                let origin = layout.centre((1, 1));
                [x + origin[0], y + origin[1]]
            }
            Self::GymnasiumRobotics => {
                // The centre of the first cell, from either origin.
                let first = layout.centre((0, 0));
                let half = [columns, rows].map(|cells| (cells as f32 - 1.0) / 2.0 * CELL_SIZE);
                [first[0] + half[0] + x, first[1] + half[1] - y]
            }
        }
    }

    /// Whether y runs against the map's rows.
    #[must_use]
    pub fn is_mirrored(self) -> bool {
        self == Self::GymnasiumRobotics
    }
}

/// What is done with data to have them in the project's frame.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Conversion {
    /// The frame that their places are in.
    pub frame: Frame,
    /// Whether only the places are, and the bodies and velocities are those of the project's
    /// frame already.
    pub places_alone: bool,
}

impl Conversion {
    /// Converts places, goals and, in a mirrored frame, bodies and actions.
    ///
    /// A map with y upwards is the mirror image of the same map with y downwards, and no turn
    /// brings one onto the other. So the whole walk is mirrored, which for these bodies is a walk
    /// too.
    pub fn apply(self, body: &dyn Body, layout: &Layout, data: &mut Dataset) {
        if self.frame == Frame::D4rl {
            return;
        }
        let mirror = self.frame.is_mirrored() && !self.places_alone;
        let own = |place| self.frame.to_own(layout, place);
        let [width, action] = [data.shape().observation(), data.shape().action()];
        let rows = data.observations.chunks_exact_mut(width.max(1));
        for (row, action) in rows.zip(data.actions.chunks_exact_mut(action.max(1))) {
            let place = own([row[0], row[1]]);
            if mirror {
                body.mirror(row, action);
            }
            row[..2].copy_from_slice(&place);
        }
        for place in data.image_places.iter_mut().chain(data.goals.iter_mut()) {
            *place = own(*place);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Centre of a cell by `cell_rowcol_to_xy` of Gymnasium-Robotics.
    fn gymnasium(layout: &Layout, (row, column): (usize, usize)) -> [f32; 2] {
        let (rows, columns) = layout.shape();
        [
            (column as f32 + 0.5) * 4.0 - columns as f32 / 2.0 * 4.0,
            rows as f32 / 2.0 * 4.0 - (row as f32 + 0.5) * 4.0,
        ]
    }

    #[test]
    fn every_cell_of_every_maze_comes_to_its_own_centre() {
        let mut layouts: Vec<Layout> = Layout::NAMES
            .iter()
            .map(|name| Layout::named(name).unwrap())
            .collect();
        layouts.push(Layout::from_rows(&["1111", "100g", "1r01", "1111"]).unwrap());
        for layout in &layouts {
            for cell in layout.free_cells() {
                let (row, column) = (cell.0 as f32, cell.1 as f32);
                let own = layout.centre(cell);
                let frame = Frame::GymnasiumRobotics;
                assert_eq!(frame.to_own(layout, gymnasium(layout, cell)), own);
                let ogbench = [column * 4.0 - 4.0, row * 4.0 - 4.0];
                assert_eq!(Frame::Ogbench.to_own(layout, ogbench), own);
                assert_eq!(Frame::D4rl.to_own(layout, own), own);
            }
        }
    }
}
