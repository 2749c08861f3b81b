//! What a trace costs the simulation that is traced, in processor time: of the simulating thread
//! without and with one, in turns, and of the thread that writes.
//!
//! `cargo run --release -p trace --example slowdown [THREADS]`. Processor time (Linux: schedstat)
//! tells the same whatever else the machine is doing. Where no core is free for the writers, a
//! simulation waits for them too: the sum of both is the bound.

use std::path::{Path, PathBuf};

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

type Failure = Box<dyn std::error::Error>;

fn main() -> Result<(), Failure> {
    let folder = std::env::temp_dir().join(format!("formica-slowdown-{}", std::process::id()));
    std::fs::create_dir_all(&folder)?;
    let layout = Layout::named("large")?;
    let mut ant = AntMaze::new(&layout, Physics::MAZE);
    let (mut simulating, mut writing) = (vec![], vec![]);
    // The first turn warms up.
    for turn in 0..=TURNS {
        let without = turn_of(&mut ant, &layout, None)?;
        let mut recorder = Recorder::new(|told| eprintln!("{told}"))?;
        let before = processor_seconds("/proc/self")?;
        let own = processor_seconds("/proc/thread-self")?;
        let with = turn_of(&mut ant, &layout, Some((&mut recorder, &folder)))?;
        let all = processor_seconds("/proc/self")? - before;
        let own = processor_seconds("/proc/thread-self")? - own;
        if turn > 0 {
            simulating.push([without, with]);
            writing.push((all - own) / without);
        }
    }
    std::fs::remove_dir_all(&folder)?;
    let median = |mut values: Vec<f64>| {
        values.sort_by(f64::total_cmp);
        [values[TURNS / 4], values[TURNS / 2], values[TURNS * 3 / 4]]
    };
    let steps = f64::from(STEPS * EPISODES);
    let [_, rate, _] = median(
        simulating
            .iter()
            .map(|[without, _]| without / steps)
            .collect(),
    );
    println!("simulation: {:.1} us a step", 1e6 * rate);
    let slower = simulating
        .iter()
        .map(|[without, with]| with / without - 1.0);
    for (told, shares) in [
        ("slower by", slower.collect()),
        ("the writer takes, of the simulation's time,", writing),
    ] {
        let [low, middle, high] = median(shares).map(|share| 100.0 * share);
        println!("{told} {middle:.2}% (quartiles {low:.2}, {high:.2}; {TURNS} turns)");
    }
    Ok(())
}

/// Processor time that a process or thread has had (s).
fn processor_seconds(of: &str) -> Result<f64, Failure> {
    // Of a process the file tells its first thread alone.
    let files: Vec<PathBuf> = match of {
        "/proc/self" => std::fs::read_dir("/proc/self/task")?
            .flatten()
            .map(|task| task.path().join("schedstat"))
            .collect(),
        _ => vec![Path::new(of).join("schedstat")],
    };
    let mut nanoseconds = 0.0;
    for file in files {
        let text = std::fs::read_to_string(file)?;
        let first = text.split(' ').next().unwrap_or_default();
        nanoseconds += first.parse::<f64>()?;
    }
    Ok(1e-9 * nanoseconds)
}

/// Plays some episodes and waits until their traces are written; processor time that this thread
/// took to play (s).
fn turn_of(
    ant: &mut AntMaze,
    layout: &Layout,
    mut traced: Option<(&mut Recorder, &PathBuf)>,
) -> Result<f64, Failure> {
    let start = processor_seconds("/proc/thread-self")?;
    for episode in 0..EPISODES {
        let mut rng = Pcg64Mcg::seed_from_u64(u64::from(episode));
        let traced = traced.as_mut().map(|(recorder, folder)| {
            let path = folder.join(format!("{episode}.mcap"));
            (&mut **recorder, path)
        });
        play(ant, layout, &mut rng, traced);
    }
    let took = processor_seconds("/proc/thread-self")? - start;
    if let Some((recorder, folder)) = &mut traced {
        // The last file is there when all before it is written.
        let last = folder.join(format!("{}.mcap", EPISODES - 1));
        while recorder.is_open() || !last.exists() {
            std::thread::sleep(std::time::Duration::from_millis(1));
        }
        std::fs::remove_file(last)?;
    }
    Ok(took)
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
