//! Start and goal of an episode, as D4RL samples them (`d4rl/locomotion/maze_env.py`,
//! `scripts/generation/generate_ant_maze_datasets.py`) and OGBench
//! (`ogbench/locomaze/maze.py`).

use rand::{Rng, RngExt};

use crate::layout::{Cell, Layout};

/// Within this distance of a goal it counts as reached (m): the default of evaluations, and what
/// collected data and hindsight goals use.
pub const SUCCESS_RADIUS: f32 = 0.5;

/// How the goals of offline data are drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Style {
    /// Any free cell.
    Diverse,
    /// The maze's hand-picked cells.
    Play,
}

/// Where an episode starts and where it should end (m).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Task {
    /// The torso's place at the start, before reset noise.
    pub start: [f32; 2],
    /// The goal.
    pub goal: [f32; 2],
    /// The goal's cell.
    pub goal_cell: Cell,
}

impl From<Task> for simulator::Task {
    fn from(task: Task) -> Self {
        Self {
            start: task.start,
            goal: task.goal.to_vec(),
        }
    }
}

/// An evaluation task. In D4RL's mazes: from the start cell to a goal cell's centre plus U(0, 1)
/// and U(0, 0.5) in each axis. In OGBench's (those with [`tasks`](Layout::tasks)): one of the
/// tasks, start and goal off their centres by U(-1, 1) in each axis.
#[must_use]
pub fn evaluation_task(layout: &Layout, rng: &mut (impl Rng + ?Sized)) -> Task {
    if !layout.tasks().is_empty() {
        let (start, goal_cell) = layout.tasks()[rng.random_range(0..layout.tasks().len())];
        let mut noisy = |cell| {
            layout
                .centre(cell)
                .map(|axis| axis + rng.random_range(-1.0..1.0_f32))
        };
        let (start, goal) = (noisy(start), noisy(goal_cell));
        return Task {
            start,
            goal,
            goal_cell,
        };
    }
    let goal_cell = pick(layout.goals(), rng);
    let goal = layout
        .centre(goal_cell)
        .map(|axis| axis + rng.random_range(0.0..1.0_f32) + rng.random_range(0.0..0.5_f32));
    Task {
        start: layout.centre(layout.start()),
        goal,
        goal_cell,
    }
}

/// A task of data collection: a start cell that can be reached that is no goal cell of its style's own, plus
/// U(0, 1) in each axis, and a goal of the style, another cell.
#[must_use]
pub fn random_task(layout: &Layout, style: Style, rng: &mut (impl Rng + ?Sized)) -> Task {
    let free = layout.reachable_cells();
    let goal_cell = match style {
        Style::Diverse => pick(&free, rng),
        Style::Play => pick(layout.play_goals(), rng),
    };
    let starts: Vec<Cell> = free.into_iter().filter(|&cell| cell != goal_cell).collect();
    let start_cell = if starts.is_empty() {
        goal_cell
    } else {
        pick(&starts, rng)
    };
    let mut noisy = |cell| {
        layout
            .centre(cell)
            .map(|axis| axis + rng.random_range(0.0..1.0_f32))
    };
    let (start, goal) = (noisy(start_cell), noisy(goal_cell));
    Task {
        start,
        goal,
        goal_cell,
    }
}

/// One of a layout's cells; layouts always have a start and a goal.
fn pick(cells: &[Cell], rng: &mut (impl Rng + ?Sized)) -> Cell {
    cells
        .get(rng.random_range(0..cells.len().max(1)))
        .copied()
        .unwrap_or((0, 0))
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use rand_pcg::Pcg64Mcg;

    use super::*;

    #[test]
    fn ogbench_tasks_are_all_drawn_and_lie_within_a_metre_of_their_cells() {
        let layout = Layout::named("giant").unwrap();
        let mut rng = Pcg64Mcg::seed_from_u64(0);
        let mut seen = std::collections::BTreeSet::new();
        for _ in 0..200 {
            let task = evaluation_task(&layout, &mut rng);
            let start = layout.cell_at(task.start).unwrap();
            assert!(layout.tasks().contains(&(start, task.goal_cell)));
            let [x, y] = layout.centre(task.goal_cell);
            assert!((task.goal[0] - x).abs() <= 1.0 && (task.goal[1] - y).abs() <= 1.0);
            seen.insert(start);
        }
        assert_eq!(seen.len(), 5);
    }

    #[test]
    fn tasks_lie_in_free_cells_and_within_d4rls_ranges() {
        let layout = Layout::named("medium").unwrap();
        let mut rng = Pcg64Mcg::seed_from_u64(0);
        for _ in 0..200 {
            let task = evaluation_task(&layout, &mut rng);
            assert_eq!(task.start, [0.0, 0.0]);
            assert!(task.goal.iter().all(|axis| (20.0..21.5).contains(axis)));
            for style in [Style::Diverse, Style::Play] {
                let task = random_task(&layout, style, &mut rng);
                assert!(!layout.is_wall_at(task.start) && !layout.is_wall_at(task.goal));
                assert_ne!(layout.cell_at(task.start), layout.cell_at(task.goal));
            }
        }
    }
}
