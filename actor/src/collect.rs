//! Offline data: the walker, with noise, between random or hand-picked cells.
//!
//! As D4RL's script does (`generate_ant_maze_datasets.py`), but for one thing: on arrival the
//! walker is given a new goal instead of milling about until the episode's end.

use std::fmt;
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc;

use config::{Collect, Config};
use dataset::{Made, d4rl};
use durable::Output;
use maze::{AntMaze, Layout, OBSERVATION, Physics, Route, SUCCESS_RADIUS, Style, random_task};
use rand::{RngExt, SeedableRng};
use rand_distr::{Distribution, Normal};
use rand_pcg::Pcg64Mcg;

use crate::walker::Walker;

/// Waypoints lie up to this far off the centre of their cell in each axis (m).
const OFF_CENTRE: f32 = 1.0;

/// Rows of one episode, flat.
#[derive(Default)]
struct Episode {
    observations: Vec<f32>,
    actions: Vec<f32>,
    goals: Vec<f32>,
    /// Observation after each action.
    next: Vec<f32>,
}

/// What was collected.
#[derive(Debug, Clone, PartialEq)]
pub struct Collected {
    /// Rows written.
    pub transitions: usize,
    /// Episodes written.
    pub episodes: usize,
    /// Share of rows on the back.
    pub fallen: f64,
    /// Where.
    pub path: String,
}

impl fmt::Display for Collected {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            transitions,
            episodes,
            fallen,
            path,
        } = self;
        let fallen = 100.0 * fallen;
        write!(
            f,
            "{transitions} transitions in {episodes} episodes ({fallen:.1}% on the back) to {path}"
        )
    }
}

/// What a collection by this config is noted as in its file; none without a `[collect]` table.
///
/// # Errors
/// A walker that cannot be read.
pub fn made(config: &Config) -> anyhow::Result<Option<Made>> {
    let Some(settings) = &config.collect else {
        return Ok(None);
    };
    let walker = Walker::load(settings.walker.as_ref().map(Path::new))?;
    Ok(Some(Made {
        maze: config.maze.layout.clone(),
        maze_rows: config.maze.rows.join(" "),
        style: settings.style.clone(),
        transitions: settings.transitions.to_string(),
        episode_steps: settings.episode_steps.to_string(),
        noise: settings.noise.to_string(),
        seed: config.run.seed.to_string(),
        walker: walker.hash(),
        formica_version: env!("CARGO_PKG_VERSION").to_owned(),
    }))
}

/// Collects the data set of a config and writes it to `output` in D4RL's layout. The same seed
/// gives the same file, whatever the number of threads. `progress` is told transitions done and to
/// do. None, and no file, once `stopped` says so.
///
/// # Errors
/// No `[collect]` table, a walker that cannot be read, a file that cannot be written.
pub fn collect(
    config: &Config,
    output: &Output,
    stopped: &(dyn Fn() -> bool + Sync),
    mut progress: impl FnMut(usize, usize),
) -> anyhow::Result<Option<Collected>> {
    let Some(settings) = &config.collect else {
        anyhow::bail!("the config has no [collect] table");
    };
    let layout = crate::layout(config)?;
    let walker = Walker::load(settings.walker.as_ref().map(Path::new))?;
    let rows = settings.episode_steps + 1;
    let count = settings.transitions.div_ceil(rows);
    let next = AtomicUsize::new(0);
    let (sender, receiver) = mpsc::channel();
    let mut episodes: Vec<Option<Episode>> = (0..count).map(|_| None).collect();
    std::thread::scope(|scope| {
        for _ in 0..settings.threads {
            let (sender, mut walker) = (sender.clone(), walker.clone());
            let (layout, next) = (&layout, &next);
            scope.spawn(move || {
                let mut ant = AntMaze::new(layout, Physics::MAZE);
                while !stopped() {
                    let number = next.fetch_add(1, Ordering::Relaxed);
                    if number >= count {
                        break;
                    }
                    let seed = (config.run.seed << 32) + number as u64;
                    let episode = walk(&mut ant, &mut walker, layout, settings, seed);
                    if sender.send((number, episode)).is_err() {
                        break;
                    }
                }
            });
        }
        drop(sender);
        let mut done = 0;
        for (number, episode) in receiver {
            episodes[number] = Some(episode);
            done += rows;
            progress(done.min(settings.transitions), settings.transitions);
        }
    });
    if stopped() {
        return Ok(None);
    }
    write(
        output,
        made(config)?.as_ref(),
        &layout,
        episodes.into_iter().flatten(),
        rows,
    )
    .map(Some)
}

fn walk(
    ant: &mut AntMaze,
    walker: &mut Walker,
    layout: &Layout,
    settings: &Collect,
    seed: u64,
) -> Episode {
    let mut rng = Pcg64Mcg::seed_from_u64(seed);
    let style = if settings.style == "play" {
        Style::Play
    } else {
        Style::Diverse
    };
    let task = random_task(layout, style, &mut rng);
    let mut route = Route::new(layout, task.goal, task.goal_cell);
    ant.reset(task.start, &mut rng);
    let mut episode = Episode::default();
    let noise = Normal::new(0.0, settings.noise as f32).ok();
    let (mut waypoint, mut offset) = ([f32::NAN; 2], [0.0; 2]);
    let mut o = ant.observation();
    for _ in 0..=settings.episode_steps {
        let place = [o[0], o[1]];
        let goal = route.goal();
        if (goal[0] - place[0]).hypot(goal[1] - place[1]) < SUCCESS_RADIUS {
            let task = random_task(layout, style, &mut rng);
            route = Route::new(layout, task.goal, task.goal_cell);
        }
        let towards = route.waypoint(layout, place);
        if towards != waypoint {
            waypoint = towards;
            let last = towards == route.goal();
            offset = [0; 2].map(|_| {
                if last {
                    0.0
                } else {
                    rng.random_range(-OFF_CENTRE..OFF_CENTRE)
                }
            });
        }
        let direction = [0, 1].map(|axis| waypoint[axis] + offset[axis] - place[axis]);
        let mut action = walker.act(&o, direction);
        for value in &mut action {
            let noise = noise.map_or(0.0, |noise| noise.sample(&mut rng));
            *value = (*value + noise).clamp(-1.0, 1.0);
        }
        episode.observations.extend_from_slice(&o);
        episode.actions.extend_from_slice(&action);
        episode.goals.extend(route.goal());
        ant.step(&action);
        o = ant.observation();
        episode.next.extend_from_slice(&o);
    }
    episode
}

fn write(
    output: &Output,
    made: Option<&Made>,
    layout: &Layout,
    episodes: impl Iterator<Item = Episode>,
    rows: usize,
) -> anyhow::Result<Collected> {
    let mut all = Episode::default();
    let (mut timeouts, mut count) = (vec![], 0);
    for episode in episodes {
        all.observations.extend(episode.observations);
        all.actions.extend(episode.actions);
        all.goals.extend(episode.goals);
        all.next.extend(episode.next);
        timeouts.extend((0..rows).map(|row| u8::from(row + 1 == rows)));
        count += 1;
    }
    let n = timeouts.len();
    // D4RL's rewards are those of the evaluation's goal, whatever the behaviour aimed at.
    let target = layout
        .goals()
        .first()
        .map_or([0.0; 2], |goal| layout.centre(*goal));
    let near = |next: &[f32]| (next[0] - target[0]).hypot(next[1] - target[1]) <= SUCCESS_RADIUS;
    let terminals: Vec<u8> = all
        .next
        .chunks_exact(OBSERVATION)
        .map(|next| u8::from(near(next)))
        .collect();
    let rewards: Vec<f32> = terminals
        .iter()
        .map(|terminal| f32::from(*terminal))
        .collect();
    let next = || all.next.chunks_exact(OBSERVATION);
    let staged = d4rl::stage_rows(
        output,
        &d4rl::Rows {
            observations: &all.observations,
            actions: &all.actions,
            rewards: &rewards,
            terminals: &terminals,
            timeouts: &timeouts,
            goals: &all.goals,
            qpos: &next().flat_map(|o| &o[..15]).copied().collect::<Vec<_>>(),
            qvel: &next().flat_map(|o| &o[15..]).copied().collect::<Vec<_>>(),
        },
        made,
    )?;
    staged.place()?;
    let fallen = next().filter(|o| maze::upright(o) < maze::FALLEN).count();
    Ok(Collected {
        transitions: n,
        episodes: count,
        fallen: fallen as f64 / n.max(1) as f64,
        path: output.path().display().to_string(),
    })
}

#[cfg(test)]
mod tests {
    use durable::Existing;

    use super::*;

    /// Episodes are the same bits whoever simulates them, in a maze with teleports as well.
    #[test]
    fn the_same_seed_makes_the_same_file_whatever_the_number_of_threads() {
        let folder = tempfile::tempdir().unwrap();
        let file = |name: &str, seed: u64, threads: usize| {
            let path = folder.path().join(name);
            let text = format!(
                "[run]\nseed = {seed}\n[maze]\nlayout = \"teleport\"\n[dataset]\npath = \"{}\"\n\
                 [collect]\ntransitions = 1000\nepisode_steps = 150\nthreads = {threads}\n",
                path.display()
            );
            let config = Config::parse(&text, "x.toml", "x", &[]).unwrap();
            let output = Output::file(&path, Existing::Refuse, &[]).unwrap();
            let told = collect(&config, &output, &|| false, |_, _| {});
            let told = told.unwrap().unwrap();
            assert_eq!(told.episodes, 7);
            std::fs::read(path).unwrap()
        };
        let one = file("one.hdf5", 3, 1);
        assert!(one == file("three.hdf5", 3, 3), "threads changed the data");
        assert!(one != file("other.hdf5", 4, 1), "the seed changed nothing");
    }
}
