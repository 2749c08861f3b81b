//! What the view shows: all that a frame is drawn from.

use std::sync::Arc;
use std::time::Duration;

use maze::{CELL_SIZE, Layout};
use wire::{Phase, State};

/// The state of a run, as of a moment.
#[derive(Clone)]
pub(crate) struct View {
    /// The run's folder.
    pub(crate) run: String,
    /// Hash of its config.
    pub(crate) config: String,
    /// Phases of this kind of run.
    pub(crate) phases: &'static [Phase],
    pub(crate) phase: Phase,
    pub(crate) passed: Duration,
    pub(crate) processes: Vec<Process>,
    /// Of the evaluation, once it has begun.
    pub(crate) score: Option<Score>,
    /// The most important first.
    pub(crate) figures: Vec<Figure>,
    pub(crate) floor: Arc<Floor>,
    pub(crate) ants: Vec<Ant>,
    /// What was said, the newest last.
    pub(crate) lines: Vec<String>,
    pub(crate) colour: bool,
}

/// How a process is.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Health {
    /// As it says itself.
    Alive(State),
    /// Gone, to be started again.
    Restarting,
    /// Gone for good.
    Gone,
}

/// A process of the run.
#[derive(Clone)]
pub(crate) struct Process {
    /// Role, and id where there are several.
    pub(crate) name: String,
    pub(crate) pid: Option<u32>,
    pub(crate) health: Health,
    /// In its own words.
    pub(crate) doing: String,
    /// Share of the work at hand that is done.
    pub(crate) done: Option<f64>,
    /// A second, and of what.
    pub(crate) rate: Option<(f64, &'static str)>,
    pub(crate) restarts: usize,
    /// Time since its last word.
    pub(crate) heard: Option<Duration>,
}

/// How the evaluation goes.
#[derive(Clone, Copy)]
pub(crate) struct Score {
    pub(crate) successes: usize,
    pub(crate) done: usize,
    pub(crate) episodes: usize,
}

/// A metric that is worth to be seen.
#[derive(Clone)]
pub(crate) struct Figure {
    pub(crate) label: &'static str,
    pub(crate) value: f64,
    pub(crate) decimals: usize,
    /// The newest last.
    pub(crate) history: Vec<f64>,
}

/// An ant on the floor.
#[derive(Clone)]
pub(crate) struct Ant {
    /// Of its actor.
    pub(crate) id: u32,
    /// Where it was, and last where it is (m).
    pub(crate) way: Vec<[f32; 2]>,
}

/// The maze as seen from above; x to the right, y up, as in all pictures of it.
pub(crate) struct Floor {
    /// Least x and y, greatest x and y of all that can be walked on (m).
    pub(crate) bounds: [f64; 4],
    /// Where floor and wall meet: both ends of a line (m).
    pub(crate) walls: Vec<[f64; 4]>,
    pub(crate) start: [f64; 2],
    pub(crate) goals: Vec<[f64; 2]>,
}

impl Floor {
    pub(crate) fn new(layout: &Layout) -> Self {
        let half = f64::from(CELL_SIZE) / 2.0;
        let centre = |cell| layout.centre(cell).map(f64::from);
        let mut walls = vec![];
        let mut bounds = [f64::MAX, f64::MAX, f64::MIN, f64::MIN];
        for cell in layout.free_cells() {
            let [x, y] = centre(cell);
            let [left, low, right, high] = bounds;
            bounds = [
                left.min(x - half),
                low.min(y - half),
                right.max(x + half),
                high.max(y + half),
            ];
            let sides = [(0, 1), (1, 0), (0, usize::MAX), (usize::MAX, 0)];
            for (down, along) in sides {
                let next = (cell.0.wrapping_add(down), cell.1.wrapping_add(along));
                if !layout.is_wall(next) {
                    continue;
                }
                let side = |step: usize| match step {
                    0 => None,
                    1 => Some(half),
                    _ => Some(-half),
                };
                walls.push(match (side(along), side(down)) {
                    (Some(dx), _) => [x + dx, y - half, x + dx, y + half],
                    (None, dy) => {
                        let y = y + dy.unwrap_or(0.0);
                        [x - half, y, x + half, y]
                    }
                });
            }
        }
        Self {
            bounds,
            walls,
            start: centre(layout.start()),
            goals: layout.goals().iter().map(|goal| centre(*goal)).collect(),
        }
    }

    /// Whether an ant can be at a place: anyone may say anything on a channel.
    pub(crate) fn holds(&self, place: [f32; 2]) -> bool {
        let [x, y] = place.map(f64::from);
        let [left, low, right, high] = self.bounds;
        // False where one is not a number.
        (left..=right).contains(&x) && (low..=high).contains(&y)
    }
}
