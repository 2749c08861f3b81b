//! How fast bodies are simulated, and how much memory an ant takes: `cargo run --release -p maze
//! --example speed -- [SECONDS]` steps ants with random actions in D4RL's medium maze on one
//! thread, then on two, then on one through the trait `Simulator`, and likewise points, and prints
//! figures as JSON. `tests/foreign/bench_mujoco.py` compares them with MuJoCo's.

#![allow(clippy::print_stdout)] // A program of its own.

use std::time::{Duration, Instant};

use maze::{AntMaze, AntSimulator, Layout, Physics, PointSimulator, SUCCESS_RADIUS};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use simulator::{Simulator, Tasks};

/// Control steps of an episode.
const STEPS: usize = 1000;
/// Worlds built to weigh one.
const WORLDS: usize = 256;

/// Control steps that one thread makes, and the seconds that it takes.
fn run(layout: &Layout, seed: u64, time: Duration) -> (usize, f64) {
    let mut rng = Pcg64Mcg::seed_from_u64(seed);
    let mut world = AntMaze::new(layout, Physics::MAZE);
    let cells = layout.free_cells();
    let start = Instant::now();
    let mut steps = 0;
    while start.elapsed() < time {
        let cell = cells[rng.random_range(0..cells.len())];
        world.reset(layout.centre(cell), &mut rng);
        for _ in 0..STEPS {
            world.step(&std::array::from_fn(|_| rng.random_range(-1.0..=1.0)));
        }
        steps += STEPS;
    }
    (steps, start.elapsed().as_secs_f64())
}

/// Control steps a second of a number of threads together.
fn rate(layout: &Layout, threads: u64, time: Duration) -> f64 {
    std::thread::scope(|scope| {
        let workers: Vec<_> = (0..threads)
            .map(|seed| scope.spawn(move || run(layout, seed, time)))
            .collect();
        let done = workers.into_iter().filter_map(|worker| worker.join().ok());
        done.map(|(steps, seconds)| steps as f64 / seconds).sum()
    })
}

/// Control steps a second through the trait.
fn simulator_rate(simulator: &mut dyn Simulator, time: Duration) -> f64 {
    let mut rng = Pcg64Mcg::seed_from_u64(0);
    let mut action = vec![0.0; simulator.body().spaces().action.len()];
    let start = Instant::now();
    let mut steps = 0;
    while start.elapsed() < time {
        let task = simulator.draw(Tasks::Training, &mut rng);
        simulator.reset(&task, &mut rng);
        for _ in 0..STEPS {
            action.fill_with(|| rng.random_range(-1.0..=1.0));
            simulator.step(&action);
        }
        steps += STEPS;
    }
    steps as f64 / start.elapsed().as_secs_f64()
}

/// Resident memory of this process (KiB).
fn resident() -> Option<f64> {
    let text = std::fs::read_to_string("/proc/self/smaps_rollup").ok()?;
    let line = text.lines().find(|line| line.starts_with("Rss:"))?;
    line.split_whitespace().nth(1)?.parse().ok()
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let seconds = std::env::args()
        .nth(1)
        .map_or(Ok(5.0), |text| text.parse())?;
    let time = Duration::try_from_secs_f64(seconds)?;
    let layout = Layout::named("medium")?;
    let before = resident();
    let mut worlds = vec![AntMaze::new(&layout, Physics::MAZE); WORLDS];
    let mut rng = Pcg64Mcg::seed_from_u64(0);
    for world in &mut worlds {
        world.reset([0.0, 0.0], &mut rng);
        for _ in 0..50 {
            world.step(&std::array::from_fn(|_| rng.random_range(-1.0..=1.0)));
        }
    }
    let weight = resident()
        .zip(before)
        .map(|(after, before)| (after - before) / WORLDS as f64);
    drop(worlds);
    let (one, two) = (rate(&layout, 1, time), rate(&layout, 2, time));
    let by_trait = simulator_rate(&mut AntSimulator::new(&layout, SUCCESS_RADIUS), time);
    let point = simulator_rate(&mut PointSimulator::new(&layout, SUCCESS_RADIUS), time);
    let weight = weight.map_or("null".to_owned(), |kib| format!("{kib:.1}"));
    println!(
        "{{\"one_thread\": {one:.0}, \"two_threads\": {two:.0}, \"kib_an_ant\": {weight}, \
         \"simulator\": {by_trait:.0}, \"point\": {point:.0}}}"
    );
    Ok(())
}
