//! How well the walker walks, and how far a perfect planner gets with it: the ceiling of any
//! method that learns from its data.

use std::fmt;
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};

use agents::stream;
use config::Config;
use maze::{
    AntBody, AntMaze, CONTROL_SECONDS, FALLEN, Layout, Physics, Route, evaluation_task, upright,
};
use rand::RngExt;
use rand_pcg::Pcg64Mcg;
use simulator::Body;

use crate::walker::Walker;

/// What was measured.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Ceiling {
    /// Episodes of each kind.
    pub episodes: usize,
    /// Mean speed towards the direction on the open floor, which turns now and then (m/s).
    pub speed: f64,
    /// Share of 1000-step episodes on the open floor that ended on the back.
    pub falls: f64,
    /// Share of evaluation episodes that reached the goal.
    pub success: f64,
    /// Their mean steps.
    pub steps: f64,
    /// Share of evaluation episodes that ended on the back.
    pub maze_falls: f64,
}

impl fmt::Display for Ceiling {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            episodes,
            speed,
            falls,
            success,
            steps,
            maze_falls,
        } = self;
        // Where none arrived there is no mean.
        let mean = match *success > 0.0 {
            true => format!(", in {steps:.0} steps on average"),
            false => String::new(),
        };
        writeln!(
            f,
            "open floor, direction turned every 60 steps on average, {episodes} episodes of 1000 \
             steps: {:.2} m/s towards it, {:.1}% fell",
            rounded(*speed),
            100.0 * falls
        )?;
        write!(
            f,
            "maze with a perfect planner, {episodes} episodes: {:.1}% reached the \
             goal{mean}, {:.1}% fell",
            100.0 * success,
            100.0 * maze_falls
        )
    }
}

/// To the centimetre a second, and no negative zero.
fn rounded(speed: f64) -> f64 {
    (100.0 * speed).round() / 100.0 + 0.0
}

/// Measures both, on every core.
///
/// # Errors
/// Another simulator than the ant, a walker that cannot be read, a maze that is none.
pub fn measure(config: &Config, episodes: usize, path: Option<&Path>) -> anyhow::Result<Ceiling> {
    is_ant(&config.run.simulator)?;
    let layout = crate::layout(config)?;
    let walker = Walker::load(path)?;
    let limit = config.evaluation.max_steps;
    let next = AtomicUsize::new(0);
    let threads = std::thread::available_parallelism()?.get();
    let sums = std::thread::scope(|scope| {
        let workers: Vec<_> = (0..threads)
            .map(|_| {
                let mut walker = walker.clone();
                let (layout, next) = (&layout, &next);
                scope.spawn(move || {
                    let mut open = AntMaze::new(layout, Physics::OPEN_FLOOR);
                    let mut maze = AntMaze::new(layout, Physics::MAZE);
                    let mut sum = Ceiling::default();
                    loop {
                        let episode = next.fetch_add(1, Ordering::Relaxed);
                        if episode >= episodes {
                            return sum;
                        }
                        let mut rng = stream(config.run.seed, "ceiling", episode as u64);
                        open_floor(&mut walker, &mut open, &mut rng, &mut sum);
                        planned(&mut walker, &mut maze, layout, limit, &mut rng, &mut sum);
                    }
                })
            })
            .collect();
        workers
            .into_iter()
            .filter_map(|worker| worker.join().ok())
            .collect::<Vec<_>>()
    });
    let n = episodes.max(1) as f64;
    let total = |of: fn(&Ceiling) -> f64| sums.iter().map(of).sum::<f64>();
    let reached = total(|sum| sum.success);
    Ok(Ceiling {
        episodes,
        speed: total(|sum| sum.speed) / n,
        falls: total(|sum| sum.falls) / n,
        success: reached / n,
        steps: total(|sum| sum.steps) / reached.max(1.0),
        maze_falls: total(|sum| sum.maze_falls) / n,
    })
}

/// Refuses any other simulator.
fn is_ant(simulator: &str) -> anyhow::Result<()> {
    anyhow::ensure!(
        simulator == AntBody.name(),
        "formica ceiling measures the ant's walker, and the simulator '{simulator}' has none; use a \
         config of the ant"
    );
    Ok(())
}

fn open_floor(walker: &mut Walker, ant: &mut AntMaze, rng: &mut Pcg64Mcg, sum: &mut Ceiling) {
    ant.reset([0.0, 0.0], rng);
    let mut direction = [1.0, 0.0];
    let mut metres = 0.0;
    for step in 0..1000 {
        if step == 0 || rng.random::<f32>() * 60.0 < 1.0 {
            let angle = rng.random_range(0.0..std::f32::consts::TAU);
            direction = [angle.cos(), angle.sin()];
        }
        let before = ant.observation();
        ant.step(&walker.act(&before, direction));
        let after = ant.observation();
        metres += (after[0] - before[0]) * direction[0] + (after[1] - before[1]) * direction[1];
    }
    sum.speed += f64::from(metres / (1000.0 * CONTROL_SECONDS));
    sum.falls += f64::from(u8::from(upright(&ant.observation()) < FALLEN));
}

fn planned(
    walker: &mut Walker,
    ant: &mut AntMaze,
    layout: &Layout,
    limit: usize,
    rng: &mut Pcg64Mcg,
    sum: &mut Ceiling,
) {
    let task = evaluation_task(layout, rng);
    let route = Route::new(layout, task.goal, task.goal_cell);
    ant.reset(task.start, rng);
    for step in 0..limit {
        let o = ant.observation();
        let place = [o[0], o[1]];
        if (task.goal[0] - place[0]).hypot(task.goal[1] - place[1]) <= maze::SUCCESS_RADIUS {
            sum.success += 1.0;
            sum.steps += step as f64;
            break;
        }
        ant.step(&walker.act(&o, route.direction(layout, place)));
    }
    sum.maze_falls += f64::from(u8::from(upright(&ant.observation()) < FALLEN));
}
