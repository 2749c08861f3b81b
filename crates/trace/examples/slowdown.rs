//! What a trace costs the simulation that is traced: steps a second without and with one, in turns.
//!
//! `cargo run --release -p trace --example slowdown [THREADS]`: with as many threads as cores every
//! core is busy, so that the writers' work shows as well.

use std::path::{Path, PathBuf};
use std::sync::Barrier;
use std::time::{Duration, Instant};

use maze::{AntMaze, Layout, Physics};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use trace::{
    ChoiceRecord, EndRecord, Episode, EpisodeMeta, Recorder, Scene, StartRecord, StepRecord,
};

/// Steps of an episode, and episodes of a turn.
const STEPS: u32 = 300;
const EPISODES: u32 = 10;
const TURNS: usize = 15;
/// Steps between choices.
const CHOICE: u32 = 15;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let threads = match std::env::args().nth(1) {
        Some(threads) => threads.parse()?,
        None => 1,
    };
    let folder = std::env::temp_dir().join(format!("formica-slowdown-{}", std::process::id()));
    std::fs::create_dir_all(&folder)?;
    let barrier = Barrier::new(threads);
    let layout = Layout::named("large")?;
    let recorder = || Recorder::new(|told| eprintln!("{told}"));
    let recorders: Vec<Recorder> = (0..threads).map(|_| recorder()).collect::<Result<_, _>>()?;
    let ratios: Vec<Vec<[Duration; 2]>> = std::thread::scope(|scope| {
        let (folder, barrier, layout) = (&folder, &barrier, &layout);
        let simulate = |(id, recorder): (usize, Recorder)| {
            scope.spawn(move || turns(id, recorder, layout, folder, barrier))
        };
        let handles: Vec<_> = recorders.into_iter().enumerate().map(simulate).collect();
        handles.into_iter().filter_map(|h| h.join().ok()).collect()
    });
    std::fs::remove_dir_all(&folder)?;
    for (id, turns) in ratios.iter().enumerate() {
        let rate = |which: usize| {
            let mut seconds: Vec<f64> = turns.iter().map(|t| t[which].as_secs_f64()).collect();
            seconds.sort_by(f64::total_cmp);
            f64::from(STEPS * EPISODES) / seconds[seconds.len() / 2]
        };
        let mut slower: Vec<f64> = turns
            .iter()
            .map(|[without, with]| 100.0 * (with.as_secs_f64() / without.as_secs_f64() - 1.0))
            .collect();
        slower.sort_by(f64::total_cmp);
        println!(
            "thread {id}: {:.0} steps/s without a trace, {:.0} with one; slower by {:.2}% (median \
             of {TURNS} turns, quartiles {:.2} and {:.2})",
            rate(0),
            rate(1),
            slower[TURNS / 2],
            slower[TURNS / 4],
            slower[TURNS * 3 / 4]
        );
    }
    Ok(())
}

/// Time of each turn, without and with traces.
fn turns(
    id: usize,
    mut recorder: Recorder,
    layout: &Layout,
    folder: &Path,
    barrier: &Barrier,
) -> Vec<[Duration; 2]> {
    let mut ant = AntMaze::new(layout, Physics::MAZE);
    let mut turns = vec![];
    for turn in 0..=TURNS {
        let mut times = [Duration::ZERO; 2];
        for (with, time) in [false, true].into_iter().zip(&mut times) {
            barrier.wait();
            let start = Instant::now();
            for episode in 0..EPISODES {
                let mut rng = Pcg64Mcg::seed_from_u64(u64::from(episode));
                let name = format!("{id}-{episode}.mcap");
                play(
                    &mut ant,
                    layout,
                    &mut rng,
                    with.then(|| (&mut recorder, folder.join(name))),
                );
            }
            *time = start.elapsed();
        }
        // The first turn warms up.
        if turn > 0 {
            turns.push(times);
        }
    }
    turns
}

fn play(
    ant: &mut AntMaze,
    layout: &Layout,
    rng: &mut Pcg64Mcg,
    mut traced: Option<(&mut Recorder, PathBuf)>,
) {
    let start = ant.reset([0.0, 0.0], rng);
    if let Some((recorder, path)) = &mut traced {
        recorder.begin(Episode {
            part: path.with_extension("part"),
            path: path.clone(),
            meta: EpisodeMeta::default(),
            scene: scene(layout),
            start: StartRecord {
                state: start.observation,
                exits: start.exits,
            },
        });
    }
    for step in 0..STEPS {
        let action = std::array::from_fn(|_| rng.random_range(-1.0..=1.0));
        let record = traced.is_some().then(|| StepRecord {
            step,
            observation: ant.observation(),
            action,
            reward: 0.0,
            node: 0,
            subgoal_node: 1,
            subgoal: [4.0, 0.0],
            bodies: ant.body_poses(),
        });
        if let Some((recorder, _)) = traced.as_mut().filter(|_| step % CHOICE == 0) {
            recorder.choice(ChoiceRecord {
                step,
                node: 0,
                goal_node: 9,
                subgoal_node: 1,
                value: 0.5,
                neighbours: (0..20).collect(),
                probabilities: vec![0.05; 20],
            });
        }
        ant.step(&action);
        if let (Some((recorder, _)), Some(record)) = (&mut traced, record) {
            recorder.step(record);
        }
    }
    if let Some((recorder, _)) = &mut traced {
        recorder.end(EndRecord {
            success: false,
            fell: false,
            observation: ant.observation(),
            bodies: ant.body_poses(),
        });
    }
}

/// A graph of the size that runs have: 190 nodes, 20 edges each.
fn scene(layout: &Layout) -> Scene {
    let nodes: Vec<[f32; 2]> = (0..190)
        .map(|i| [(i % 19) as f32, (i / 19) as f32])
        .collect();
    let edges = (0..190).flat_map(|from| (1..11).map(move |way| (from, (from + way) % 190)));
    Scene {
        walls: layout.boxes(),
        wall_height: maze::WALL_HEIGHT,
        nodes,
        edges: edges.flat_map(|(a, b)| [(a, b), (b, a)]).collect(),
        goal: [32.0, 24.0],
        goal_radius: 0.5,
    }
}
