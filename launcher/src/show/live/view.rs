//! The data of a frame.

use std::sync::Arc;
use std::time::Duration;

use maze::{CELL_SIZE, Layout};
use wire::{Phase, State};

/// The state of a run at one moment.
#[derive(Clone)]
pub(crate) struct View {
    /// Folder of the run.
    pub(crate) run: String,
    /// Hash of the config.
    pub(crate) config: String,
    /// Phases of this kind of run.
    pub(crate) phases: &'static [Phase],
    pub(crate) phase: Phase,
    pub(crate) passed: Duration,
    pub(crate) processes: Vec<Process>,
    /// Of the evaluation, once it has started.
    pub(crate) score: Option<Score>,
    /// The most important first.
    pub(crate) metrics: Vec<Metric>,
    pub(crate) outline: Arc<MazeOutline>,
    pub(crate) ants: Vec<Ant>,
    /// Log lines, the newest last.
    pub(crate) lines: Vec<String>,
    pub(crate) colour: bool,
}

/// State of a process.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Health {
    /// Alive, with its own state.
    Alive(State),
    /// Ended, will be restarted.
    Restarting,
    /// Ended.
    Gone,
}

/// A process of the run.
#[derive(Clone)]
pub(crate) struct Process {
    /// Role, with the id of an actor.
    pub(crate) name: String,
    pub(crate) pid: Option<u32>,
    pub(crate) health: Health,
    /// Text of its status.
    pub(crate) doing: String,
    /// Share of the current work that is done.
    pub(crate) done: Option<f64>,
    /// Rate per second, and its unit.
    pub(crate) rate: Option<(f64, &'static str)>,
    pub(crate) restarts: usize,
    /// Time since its last status.
    pub(crate) silence: Option<Duration>,
}

/// Progress of the evaluation.
#[derive(Clone, Copy)]
pub(crate) struct Score {
    pub(crate) successes: usize,
    pub(crate) done: usize,
    pub(crate) episodes: usize,
}

/// A metric that is shown.
#[derive(Clone)]
pub(crate) struct Metric {
    pub(crate) label: &'static str,
    pub(crate) value: f64,
    pub(crate) decimals: usize,
    /// The newest last.
    pub(crate) history: Vec<f64>,
}

/// An ant in the maze.
#[derive(Clone)]
pub(crate) struct Ant {
    /// Id of its actor.
    pub(crate) id: u32,
    /// Its positions, the newest last (m).
    pub(crate) trail: Vec<[f32; 2]>,
}

/// The maze from above, with x to the right and y up.
pub(crate) struct MazeOutline {
    /// Least x and y, greatest x and y of the free cells (m).
    pub(crate) bounds: [f64; 4],
    /// Lines between free cells and walls: both ends (m).
    pub(crate) walls: Vec<[f64; 4]>,
    pub(crate) start: [f64; 2],
    pub(crate) goals: Vec<[f64; 2]>,
}

impl MazeOutline {
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

    /// Whether an ant can be at a position. Positions from a channel are not trusted.
    pub(crate) fn holds(&self, place: [f32; 2]) -> bool {
        let [x, y] = place.map(f64::from);
        let [left, low, right, high] = self.bounds;
        // False where one is not a number.
        (left..=right).contains(&x) && (low..=high).contains(&y)
    }
}
