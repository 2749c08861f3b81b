//! Offline data: a behaviour of the simulator's body, with noise, between random or hand-picked cells.
//!
//! As D4RL's script does (`generate_ant_maze_datasets.py`), but for one thing: on arrival the
//! body is given a new goal instead of milling about until the episode's end.

mod episode;

use std::fmt;
use std::ops::Range;
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc;

use agents::stream;
use anyhow::Context;
use config::Config;
use dataset::{Made, d4rl};
use durable::Output;
use maze::{AntBody, FALLEN, Layout, SUCCESS_RADIUS};
use simulator::Body;

use crate::drive::Drive;
use episode::Episode;

/// Of an ant's observation, the columns that are positions; the others are velocities.
const POSITIONS: usize = 15;

/// What was collected.
#[derive(Debug, Clone, PartialEq)]
pub struct Collected {
    /// Rows written.
    pub transitions: usize,
    /// Episodes written.
    pub episodes: usize,
    /// Share of rows in which the body has fallen.
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
/// A simulator without a behaviour, a walker that cannot be read.
pub fn made(config: &Config) -> anyhow::Result<Option<Made>> {
    let Some(settings) = &config.collect else {
        return Ok(None);
    };
    let drive = Drive::of(
        &config.run.simulator,
        settings.walker.as_ref().map(Path::new),
    )?;
    Ok(Some(Made {
        simulator: config.run.simulator.clone(),
        maze: config.maze.layout.clone(),
        maze_rows: config.maze.rows.join(" "),
        style: settings.style.clone(),
        transitions: settings.transitions.to_string(),
        episode_steps: settings.episode_steps.to_string(),
        noise: settings.noise.to_string(),
        seed: config.run.seed.to_string(),
        walker: drive.hash(),
        formica_version: env!("CARGO_PKG_VERSION").to_owned(),
    }))
}

/// Collects the data set of a config and writes it to `output` in D4RL's layout. The same seed
/// gives the same file, whatever the number of threads. `progress` gets transitions done and to
/// do. None, and no file, once `stopped` returns true.
///
/// # Errors
/// No `[collect]` table, a simulator without a behaviour, a walker that cannot be read, a file that
/// cannot be written.
pub fn collect(
    config: &Config,
    output: &Output,
    stopped: &(dyn Fn() -> bool + Sync),
    progress: impl FnMut(usize, usize),
) -> anyhow::Result<Option<Collected>> {
    let layout = crate::layout(config)?;
    let name = config.run.simulator.as_str();
    let body = simulators::body(name).with_context(|| format!("no simulator '{name}'"))?;
    let episodes = episodes(config, &layout, name, stopped, progress)?;
    if stopped() {
        return Ok(None);
    }
    write(output, made(config)?.as_ref(), &layout, body, episodes).map(Some)
}

/// All episodes, by their number.
fn episodes(
    config: &Config,
    layout: &Layout,
    name: &str,
    stopped: &(dyn Fn() -> bool + Sync),
    mut progress: impl FnMut(usize, usize),
) -> anyhow::Result<Vec<Episode>> {
    let Some(settings) = &config.collect else {
        anyhow::bail!("the config has no [collect] table");
    };
    let drive = Drive::of(name, settings.walker.as_ref().map(Path::new))?;
    let rows = settings.episode_steps + 1;
    let count = settings.transitions.div_ceil(rows);
    let next = AtomicUsize::new(0);
    let (sender, receiver) = mpsc::channel();
    let mut episodes: Vec<Option<Episode>> = (0..count).map(|_| None).collect();
    std::thread::scope(|scope| {
        for _ in 0..settings.threads {
            let (sender, mut drive) = (sender.clone(), drive.clone());
            let next = &next;
            scope.spawn(move || {
                let mut simulator = simulators::create(name, layout, SUCCESS_RADIUS)?;
                while !stopped() {
                    let number = next.fetch_add(1, Ordering::Relaxed);
                    if number >= count {
                        break;
                    }
                    let rng = stream(config.run.seed, "collect", number as u64);
                    let episode =
                        episode::play(&mut *simulator, &mut drive, layout, settings, rng)?;
                    sender.send((number, episode)).ok()?;
                }
                Some(())
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
    Ok(episodes.into_iter().flatten().collect())
}

fn write(
    output: &Output,
    made: Option<&Made>,
    layout: &Layout,
    body: &dyn Body,
    episodes: Vec<Episode>,
) -> anyhow::Result<Collected> {
    let width = body.spaces().observation.len();
    let (mut all, mut timeouts) = (Episode::default(), vec![]);
    let count = episodes.len();
    for episode in episodes {
        let rows = episode.next.len() / width;
        timeouts.extend((0..rows).map(|row| u8::from(row + 1 == rows)));
        all.observations.extend(episode.observations);
        all.actions.extend(episode.actions);
        all.goals.extend(episode.goals);
        all.next.extend(episode.next);
    }
    let next_rows = || all.next.chunks_exact(width);
    // D4RL's rewards are those of the evaluation's goal, whatever the behaviour aimed at.
    let target = layout
        .goals()
        .first()
        .map_or([0.0; 2], |goal| layout.centre(*goal));
    let near = |next: &[f32]| {
        let [x, y] = body.place(next);
        (x - target[0]).hypot(y - target[1]) <= SUCCESS_RADIUS
    };
    let terminals: Vec<u8> = next_rows().map(|next| u8::from(near(next))).collect();
    let rewards: Vec<f32> = terminals.iter().map(|flag| f32::from(*flag)).collect();
    let columns = |columns: Range<usize>| -> Vec<f32> {
        match body.name() == AntBody.name() {
            true => next_rows()
                .flat_map(|o| &o[columns.clone()])
                .copied()
                .collect(),
            false => vec![],
        }
    };
    let staged = d4rl::stage_rows(
        output,
        &d4rl::Rows {
            observations: &all.observations,
            actions: &all.actions,
            rewards: &rewards,
            terminals: &terminals,
            timeouts: &timeouts,
            goals: &all.goals,
            qpos: &columns(0..POSITIONS),
            qvel: &columns(POSITIONS..width),
        },
        made,
    )?;
    staged.place()?;
    let fallen = next_rows().filter(|o| body.upright(o) < FALLEN).count();
    Ok(Collected {
        transitions: timeouts.len(),
        episodes: count,
        fallen: fallen as f64 / timeouts.len().max(1) as f64,
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
            let config = agents::CONFIGS.parse(&text, "x.toml", "x", &[]).unwrap();
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
