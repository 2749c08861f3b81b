//! Teleports, as OGBench's maze of that name has them (seohongpark/ogbench,
//! `ogbench/locomaze/maze.py`): a body that comes near an inlet leaves at a random outlet.

use rand::{Rng, RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

use crate::Layout;

/// Distance (m) to the centre of an inlet within which a body is taken away.
const RADIUS: f32 = 1.5;
/// More exits than any episode takes.
const MOST_TAKEN: u64 = 1 << 20;

/// The choice of outlets in an episode.
#[derive(Debug, Clone)]
pub(crate) struct Exits {
    seed: u64,
    taken: u64,
    rng: Pcg64Mcg,
}

impl Exits {
    fn new(seed: u64) -> Self {
        Self {
            seed,
            taken: 0,
            rng: Pcg64Mcg::seed_from_u64(seed),
        }
    }
}

/// The teleports of a maze.
#[derive(Debug, Clone)]
pub(crate) struct Teleports {
    /// Centres (m).
    inlets: Vec<[f32; 2]>,
    outlets: Vec<[f32; 2]>,
    exits: Exits,
}

impl Teleports {
    pub(crate) fn new(layout: &Layout) -> Self {
        let centres = |cells: &[_]| cells.iter().map(|cell| layout.centre(*cell)).collect();
        Self {
            inlets: centres(layout.inlets()),
            outlets: centres(layout.outlets()),
            exits: Exits::new(0),
        }
    }

    /// Draws the seed of an episode; 0, and nothing drawn, in a maze without teleports.
    pub(crate) fn draw(&self, rng: &mut (impl Rng + ?Sized)) -> u64 {
        if self.outlets.is_empty() {
            0
        } else {
            rng.random()
        }
    }

    /// Begins an episode.
    pub(crate) fn begin(&mut self, seed: u64) {
        if !self.outlets.is_empty() {
            self.exits = Exits::new(seed);
        }
    }

    /// Where a body at a place (m) comes out, if it is near an inlet.
    pub(crate) fn exit(&mut self, [x, y]: [f32; 2]) -> Option<[f32; 2]> {
        let near = |inlet: &[f32; 2]| (inlet[0] - x).hypot(inlet[1] - y) <= RADIUS;
        self.inlets.iter().any(near).then(|| {
            self.exits.taken += 1;
            self.outlets[self.exits.rng.random_range(0..self.outlets.len())]
        })
    }

    /// The choice of outlets, with what it has taken so far.
    pub(crate) fn exits(&self) -> &Exits {
        &self.exits
    }

    /// Continues a choice of outlets.
    pub(crate) fn set_exits(&mut self, exits: &Exits) {
        self.exits.clone_from(exits);
    }

    /// Seed of the episode, and exits taken in it.
    pub(crate) fn state(&self) -> [u64; 2] {
        [self.exits.seed, self.exits.taken]
    }

    /// Continues from a [`state`](Self::state); false, and nothing changed, if it is not one.
    pub(crate) fn restore(&mut self, [seed, taken]: [u64; 2]) -> bool {
        let most = if self.outlets.is_empty() {
            0
        } else {
            MOST_TAKEN
        };
        if taken > most {
            return false;
        }
        self.begin(seed);
        for _ in 0..taken {
            let _: usize = self.exits.rng.random_range(0..self.outlets.len());
        }
        self.exits.taken = taken;
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn teleports(maze: &str) -> Teleports {
        Teleports::new(&Layout::named(maze).unwrap())
    }

    #[test]
    fn a_restored_choice_of_outlets_continues_the_same() {
        let mut teleports = teleports("teleport");
        teleports.begin(7);
        let inlet = teleports.inlets[0];
        let exit = |teleports: &mut Teleports| teleports.exit(inlet).unwrap();
        for _ in 0..9 {
            exit(&mut teleports);
        }
        let state = teleports.state();
        let expected: Vec<_> = (0..9).map(|_| exit(&mut teleports)).collect();
        assert!(teleports.restore(state));
        assert_eq!(
            (0..9).map(|_| exit(&mut teleports)).collect::<Vec<_>>(),
            expected
        );
        assert!(expected.iter().any(|outlet| *outlet != expected[0]));
        assert!(!teleports.restore([7, u64::MAX]));
    }

    #[test]
    fn a_maze_without_teleports_takes_nothing_away() {
        let mut teleports = teleports("medium");
        assert_eq!(teleports.draw(&mut Pcg64Mcg::seed_from_u64(1)), 0);
        assert_eq!(teleports.exit([0.0, 0.0]), None);
        assert!(teleports.restore([0, 0]) && !teleports.restore([0, 1]));
    }
}
