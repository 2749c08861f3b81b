//! The mazes that have a name.

use super::{Cell, Layout, LayoutError};

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
}
