//! What traces cost the simulation that is traced: the time of episodes without and with them, in
//! turns, on one core and with every core busy; and the processor time of the thread that writes.
//!
//! `cargo run --release -p trace --example slowdown`, on a machine that does nothing else.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use maze::{AntMaze, Layout, Physics};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use trace::{
    ChoiceRecord, EndRecord, Episode, EpisodeMeta, Recorder, Scene, StartRecord, StepRecord,
};

/// Steps of an episode; a turn is one without and one with a trace.
const STEPS: u32 = 300;
const TURNS: usize = 80;
/// Steps between choices.
const CHOICE: u32 = 15;

/// A trace's name.
const TRACE: &str = "episode.mcap";

type Failure = Box<dyn std::error::Error>;

/// A simulating thread's own.
struct Bench {
    ant: AntMaze,
    recorder: Recorder,
    folder: PathBuf,
}

fn main() -> Result<(), Failure> {
    let folder = std::env::temp_dir().join(format!("formica-slowdown-{}", std::process::id()));
    let layout = Layout::named("large")?;
    let cores = std::thread::available_parallelism()?.get();
    let mut benches = vec![];
    for core in 0..cores {
        let folder = folder.join(core.to_string());
        std::fs::create_dir_all(&folder)?;
        benches.push(Bench {
            ant: AntMaze::new(&layout, Physics::MAZE),
            recorder: Recorder::new(|told| eprintln!("{told}"))?,
            folder,
        });
    }
    for count in [1, cores] {
        let (mut times, mut writing) = ([vec![], vec![]], vec![]);
        // The first turn warms up.
        for turn in 0..=TURNS {
            for traced in [false, true] {
                let [took, written] = timed(&mut benches[..count], &layout, traced)?;
                if turn > 0 {
                    times[usize::from(traced)].push(took);
                    if traced {
                        writing.push(written);
                    }
                }
            }
        }
        let [without, with] = times.map(median);
        println!(
            "{count} of {cores} cores: {:.0} steps/s; with traces slower by {:.2}%; to write them \
             takes {:.1}% of its time",
            f64::from(STEPS) * count as f64 / without,
            100.0 * (with / without - 1.0),
            100.0 * median(writing) / (without * count as f64),
        );
    }
    std::fs::remove_dir_all(&folder)?;
    Ok(())
}

/// Of many short turns the median does not mind that a machine is at times taken by others.
fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

/// Time until all threads have played an episode, and processor time that writing it took (s).
fn timed(benches: &mut [Bench], layout: &Layout, traced: bool) -> Result<[f64; 2], Failure> {
    let before = writers()?;
    let start = Instant::now();
    std::thread::scope(|scope| {
        for bench in benches.iter_mut() {
            scope.spawn(move || {
                let mut rng = Pcg64Mcg::seed_from_u64(0);
                play(bench, layout, &mut rng, traced);
            });
        }
    });
    let took = start.elapsed().as_secs_f64();
    if traced {
        for bench in benches {
            let trace = bench.folder.join(TRACE);
            while !trace.exists() {
                std::thread::sleep(Duration::from_millis(1));
            }
            std::fs::remove_file(trace)?;
        }
    }
    Ok([took, writers()? - before])
}

/// Processor time that the writing threads have had (s; Linux).
fn writers() -> Result<f64, Failure> {
    let mut nanoseconds = 0.0;
    for task in std::fs::read_dir("/proc/self/task")?.flatten() {
        // A thread that has just ended has no files left.
        let read = |name: &str| std::fs::read_to_string(task.path().join(name)).unwrap_or_default();
        if read("comm").trim_end() == "trace" {
            let text = read("schedstat");
            nanoseconds += text.split(' ').next().unwrap_or_default().parse::<f64>()?;
        }
    }
    Ok(1e-9 * nanoseconds)
}

fn play(bench: &mut Bench, layout: &Layout, rng: &mut Pcg64Mcg, traced: bool) {
    let Bench {
        ant,
        recorder,
        folder,
    } = bench;
    let start = ant.reset([0.0, 0.0], rng);
    if traced {
        let path: &Path = &folder.join(TRACE);
        recorder.begin(Episode {
            path: path.to_path_buf(),
            part: path.with_extension("part"),
            meta: EpisodeMeta::default(),
            scene: scene(layout),
            start: StartRecord {
                state: start.observation,
                exits: start.exits,
            },
        });
    }
    let traced = recorder.is_open();
    for step in 0..STEPS {
        let observation = ant.observation();
        let action = std::array::from_fn(|_| rng.random_range(-1.0..=1.0));
        let record = traced.then(|| StepRecord {
            step,
            observation,
            action,
            reward: 0.0,
            node: 0,
            subgoal_node: 1,
            subgoal: [4.0, 0.0],
            bodies: ant.body_poses(),
        });
        if traced && step % CHOICE == 0 {
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
        if let Some(record) = record {
            recorder.step(record);
        }
    }
    if traced {
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
