//! What traces cost the simulation: the time of many episodes without traces, with a trace of each
//! that the writing thread keeps up with (as in training), and with a trace of each (as in an
//! evaluation), in turns, on one core and with every core busy.
//!
//! `cargo run --release -p trace --example slowdown`, on a machine that does nothing else.

#![allow(clippy::print_stdout, clippy::print_stderr)] // A program of its own.

use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

use maze::{AntBody, AntSimulator, Layout};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use simulator::{Body, Simulator, Task};
use trace::{
    Behind, ChoiceRecord, EndRecord, Episode, EpisodeMeta, Recorder, Scene, StateRecord, Still,
};

/// Steps of an episode, and episodes of a turn: more than the recorder's queue holds.
const STEPS: u32 = 300;
const EPISODES: usize = 100;
/// A turn is one of each way.
const TURNS: usize = 8;
/// Steps between choices.
const CHOICE: u32 = 15;

type Failure = Box<dyn std::error::Error>;

/// A simulating thread's own.
struct Bench {
    ant: AntSimulator,
    folder: PathBuf,
    still: Arc<Still>,
}

fn main() -> Result<(), Failure> {
    let folder = std::env::temp_dir().join(format!("formica-slowdown-{}", std::process::id()));
    let layout = Layout::named("large")?;
    let cores = std::thread::available_parallelism()?.get();
    let still = Arc::new(Still::new(scene(&layout)));
    let mut benches = vec![];
    for core in 0..cores {
        let folder = folder.join(core.to_string());
        std::fs::create_dir_all(&folder)?;
        benches.push(Bench {
            ant: AntSimulator::new(&layout, maze::SUCCESS_RADIUS),
            folder,
            still: Arc::clone(&still),
        });
    }
    for count in [1, cores] {
        let benches = &mut benches[..count];
        let ways = [None, Some(Behind::Skip), Some(Behind::Wait)];
        let mut turns = ways.map(|_| vec![]);
        // The first turn warms up.
        for turn in 0..=TURNS {
            for (way, turns) in ways.into_iter().zip(&mut turns) {
                let cost = timed(benches, way);
                if turn > 0 {
                    turns.push(cost);
                }
                for bench in benches.iter() {
                    std::fs::remove_dir_all(&bench.folder)?;
                    std::fs::create_dir(&bench.folder)?;
                }
            }
        }
        let [without, training, evaluation] = turns;
        let episodes = (EPISODES * count) as f64;
        let speed = median(without.iter().map(|cost| cost.simulated));
        let speed = episodes * f64::from(STEPS) / speed;
        println!("{count} of {cores} cores: {speed:.0} steps/s");
        for (name, with) in [("training", training), ("evaluation", evaluation)] {
            let more = |part: fn(&Cost) -> f64| {
                let shares = with.iter().zip(&without);
                100.0 * (median(shares.map(|(with, without)| part(with) / part(without))) - 1.0)
            };
            println!(
                "  {name}: {:.0}% of the episodes traced, slower by {:.1}% until the last step, by \
                 {:.1}% until the last trace is written, for {:.1}% more processor time",
                100.0 * median(with.iter().map(|cost| cost.traces as f64)) / episodes,
                more(|cost| cost.simulated),
                more(|cost| cost.written),
                more(|cost| cost.processor),
            );
        }
    }
    std::fs::remove_dir_all(&folder)?;
    Ok(())
}

/// Of many turns the median does not mind that a machine is at times taken by others.
fn median(values: impl Iterator<Item = f64>) -> f64 {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

/// What a turn takes: seconds until the last step, until all is written, and of processors; and
/// the traces that there are.
struct Cost {
    simulated: f64,
    written: f64,
    processor: f64,
    traces: usize,
}

fn timed(benches: &mut [Bench], traced: Option<Behind>) -> Cost {
    let before = processor();
    let start = Instant::now();
    let ended: Vec<f64> = std::thread::scope(|scope| {
        let spawn = benches.iter_mut().map(|bench| {
            scope.spawn(move || {
                let recorder =
                    traced.map(|_| Recorder::new(&AntBody.spaces(), |text| eprintln!("{text}")));
                let mut recorder = recorder.and_then(Result::ok).zip(traced);
                let mut rng = Pcg64Mcg::seed_from_u64(0);
                for episode in 0..EPISODES {
                    play(bench, episode, &mut rng, recorder.as_mut());
                }
                let ended = start.elapsed().as_secs_f64();
                drop(recorder);
                ended
            })
        });
        let threads: Vec<_> = spawn.collect();
        let ends = threads.into_iter().map(std::thread::ScopedJoinHandle::join);
        ends.filter_map(Result::ok).collect()
    });
    let traces = |bench: &Bench| bench.folder.read_dir().map_or(0, Iterator::count);
    Cost {
        simulated: ended.into_iter().fold(0.0, f64::max),
        written: start.elapsed().as_secs_f64(),
        processor: processor() - before,
        traces: benches.iter().map(traces).sum(),
    }
}

/// Processor time that this process has had (s).
fn processor() -> f64 {
    let time = rustix::time::clock_gettime(rustix::time::ClockId::ProcessCPUTime);
    time.tv_sec as f64 + 1e-9 * time.tv_nsec as f64
}

fn play(
    bench: &mut Bench,
    episode: usize,
    rng: &mut Pcg64Mcg,
    recorder: Option<&mut (Recorder, Behind)>,
) {
    let Bench { ant, folder, still } = bench;
    let task = Task {
        start: [0.0, 0.0],
        goal: vec![32.0, 24.0],
    };
    ant.reset(&task, rng);
    let mut recorder = recorder.map(|(recorder, behind)| {
        let path = folder.join(format!("{episode}.mcap"));
        let episode = Episode {
            part: path.with_extension("part"),
            path,
            meta: EpisodeMeta::default(),
            still: Arc::clone(still),
            state: ant.state(),
        };
        recorder.begin(episode, *behind);
        recorder
    });
    if recorder
        .as_ref()
        .is_some_and(|recorder| !recorder.is_open())
    {
        recorder = None;
    }
    for step in 0..STEPS {
        let action: [f32; 8] = std::array::from_fn(|_| rng.random_range(-1.0..=1.0));
        let record = recorder.as_ref().map(|recorder| {
            let mut record = recorder.blank();
            record.step = step;
            record.state.observe(ant);
            record.action.extend(action);
            (record.node, record.subgoal_node) = (0, 1);
            record.subgoal = Some([4.0, 0.0]);
            record
        });
        if let Some(recorder) = recorder.as_mut().filter(|_| step % CHOICE == 0) {
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
        if let (Some(recorder), Some(record)) = (recorder.as_mut(), record) {
            recorder.step(record);
        }
    }
    if let Some(recorder) = recorder {
        recorder.end(EndRecord {
            success: false,
            fell: false,
            state: StateRecord::of(ant),
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
        ..Scene::default()
    }
    .with_body(&AntBody)
}
