//! How the ant bears random actions: `cargo run --release -p maze --example random_actions -- 1000`
//! plays that many episodes of 1000 control steps in D4RL's medium maze, on all cores, and prints
//! the extremes. The fastest limb passes its limit by a few degrees: limits are springs, as
//! MuJoCo's are.

#![allow(clippy::print_stdout)] // A program of its own.

use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;

use maze::{AntMaze, JOINT_RANGES, Layout, Physics};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

const STEPS: usize = 1000;
/// The reset pose starts the ankles 30 degrees outside their range (control steps).
const SETTLING: usize = 10;

/// What was seen at the worst.
#[derive(Default)]
struct Extremes {
    /// Torso above the floor (m).
    height: f32,
    /// Speed of the torso in the plane (m/s).
    speed: f32,
    /// Degrees beyond a joint's limit, of all steps.
    overshoots: Vec<f32>,
    /// Rows with a value that is not finite, and ants inside a wall at the end.
    broken: usize,
}

fn play(world: &mut AntMaze, layout: &Layout, seed: u64, worst: &mut Extremes) {
    let mut rng = Pcg64Mcg::seed_from_u64(seed);
    let cells = layout.free_cells();
    let cell = cells[rng.random_range(0..cells.len())];
    world.reset(layout.centre(cell), &mut rng);
    for step in 0..STEPS {
        world.step(&std::array::from_fn(|_| rng.random_range(-1.0..=1.0)));
        let o = world.observation();
        worst.broken += usize::from(!o.iter().copied().all(f32::is_finite));
        worst.height = worst.height.max(o[2]);
        worst.speed = worst.speed.max(o[15].hypot(o[16]));
        if step >= SETTLING {
            let over = |joint: usize| {
                let [low, high] = JOINT_RANGES[joint];
                (low - o[7 + joint]).max(o[7 + joint] - high)
            };
            let most = (0..8).map(over).fold(0.0, f32::max);
            worst.overshoots.push(most.to_degrees());
        }
    }
    let o = world.observation();
    worst.broken += usize::from(layout.is_wall_at([o[0], o[1]]));
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let episodes: u64 = std::env::args()
        .nth(1)
        .map_or(Ok(1000), |text| text.parse())?;
    let layout = Layout::named("medium")?;
    let (next, all) = (AtomicU64::new(0), Mutex::new(Extremes::default()));
    let start = Instant::now();
    std::thread::scope(|scope| {
        for _ in 0..std::thread::available_parallelism().map_or(1, std::num::NonZero::get) {
            scope.spawn(|| {
                let mut worst = Extremes::default();
                let mut world = AntMaze::new(&layout, Physics::MAZE);
                loop {
                    let seed = next.fetch_add(1, Ordering::Relaxed);
                    if seed >= episodes {
                        break;
                    }
                    play(&mut world, &layout, seed, &mut worst);
                }
                if let Ok(mut all) = all.lock() {
                    all.height = all.height.max(worst.height);
                    all.speed = all.speed.max(worst.speed);
                    all.broken += worst.broken;
                    all.overshoots.append(&mut worst.overshoots);
                }
            });
        }
    });
    let mut all = all.into_inner()?;
    all.overshoots.sort_by(f32::total_cmp);
    let rank = |share: f64| {
        let at = ((all.overshoots.len() as f64 * share) as usize).min(all.overshoots.len() - 1);
        all.overshoots[at]
    };
    let seconds = start.elapsed().as_secs_f64();
    let steps = episodes as f64 * STEPS as f64;
    println!(
        "{episodes} episodes of {STEPS} steps, {:.0} steps/s",
        steps / seconds
    );
    println!("not finite, or inside a wall: {}", all.broken);
    println!(
        "torso: at most {:.2} m up, {:.1} m/s",
        all.height, all.speed
    );
    println!(
        "worst joint of a step beyond its limit: 99% {:.1}, 99.9% {:.1}, at most {:.1} degrees",
        rank(0.99),
        rank(0.999),
        rank(1.0)
    );
    Ok(())
}
