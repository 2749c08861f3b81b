//! Checks of a run before any process is started: its config, its data, and the machine.

pub(crate) mod allowance;
pub(crate) mod limits;

use std::path::Path;

use anyhow::Context;
use config::{Config, Misfit};
use dataset::{Loaded, Made};
use maze::Layout;

use crate::fault::Input;
use limits::limits;

/// Reads the data set of a config, if it exists, and prints notes about it.
///
/// # Errors
/// The data cannot be read, or do not fit the run.
pub(crate) fn data(config: &Config) -> anyhow::Result<Option<Loaded>> {
    let path = Path::new(&config.dataset.path);
    let plan = agents::plan(config).context("the config's algorithm is unknown")?;
    let Some(needs) = plan.needs().filter(|_| path.exists()) else {
        return Ok(None);
    };
    if let Some(made) = Made::read(path)? {
        if !is_of_maze(&made, config)? {
            let other = other_maze(&made, config);
            match config.dataset.fit {
                Misfit::Refuse => return Err(Input(other).into()),
                Misfit::Warn => outln!("note: {other}"),
            }
        } else if let Some(wanted) = actor::collect::made(config)? {
            for change in changes(&made, &wanted) {
                outln!("note: {}: {change}", config.dataset.path);
            }
        }
    }
    let loaded = dataset::load_for(config, &needs)?;
    for note in &loaded.notes {
        outln!("note: {note}");
    }
    Ok(Some(loaded))
}

/// The message that a data set was collected in another maze than the config's.
fn other_maze(made: &Made, config: &Config) -> String {
    format!(
        "{}: was collected in maze.layout = \"{}\", the config has \"{}\"; name another file for this \
         maze, or set maze.layout to the data's",
        config.dataset.path, made.maze, config.maze.layout
    )
}

/// Whether a data set was collected in the config's maze, by any name.
fn is_of_maze(made: &Made, config: &Config) -> anyhow::Result<bool> {
    let rows: Vec<&str> = made.maze_rows.split_whitespace().collect();
    // A maze that this version does not know counts as another one.
    let Ok(own) = Layout::of(&made.maze, &rows) else {
        return Ok(false);
    };
    let wanted = actor::layout(config)?;
    let same = |layout: &Layout| (layout.shape(), layout.start(), layout.free_cells());
    Ok(same(&own) == same(&wanted))
}

/// Sentences about changes of `[collect]`. The seed is not compared, since runs with different seeds may use one
/// data set.
fn changes(made: &Made, wanted: &Made) -> Vec<String> {
    let keys = ["style", "transitions", "episode_steps", "noise", "walker"];
    let both = made.attributes().into_iter().zip(wanted.attributes());
    both.filter(|((key, was), (_, is))| keys.contains(key) && was != is)
        .map(|((key, was), (_, is))| {
            format!(
                "was collected with collect.{key} = {was}, the config has {is}; the file is taken \
                 as it is, delete it to collect anew"
            )
        })
        .collect()
}

/// Reads a config, and checks the map of the maze and the size of shared memory.
pub(crate) fn load(path: &Path, sets: &[(String, String)]) -> anyhow::Result<Config> {
    let available = wire::shared_memory_available()?;
    let paths = config::Paths::default();
    let config =
        agents::CONFIGS.load_with(path, sets, paths, |config| further(config, available))?;
    Ok(config)
}

/// Faults by `table.key` that a config has with its map, or on a machine with so many bytes of shared memory.
pub(crate) fn further(config: &Config, available: u64) -> Vec<(&'static str, String)> {
    let mut faults = vec![];
    match actor::layout(config) {
        Err(error) => faults.push(("maze.rows", error.root_cause().to_string())),
        Ok(layout) => {
            let cells = layout.free_cells();
            let stray = |cell: &&[usize; 2]| !cells.contains(&(cell[0], cell[1]));
            if let Some(cell) = config.dataset.leave_out.iter().find(stray) {
                let message = format!("{cell:?} is no free cell of the maze");
                faults.push(("dataset.leave_out", message));
            }
        }
    }
    if let Some(message) = too_little(config, available) {
        faults.push(("topology.window", message));
    }
    faults
}

/// The message that shared memory is too small for the run.
fn too_little(config: &Config, available: u64) -> Option<String> {
    let plan = agents::plan(config)?;
    let needed = limits(config, &*plan).shared_memory_bytes();
    (needed > available).then(|| {
        format!(
            "/dev/shm has {} MiB free and the run can need {} MiB; free some (see `formica \
             doctor`), or lower topology.window or topology.max_actors",
            available >> 20,
            needed.div_ceil(1 << 20)
        )
    })
}

/// Checks the resources of the machine for a run. [`load`] does not, since `collect` does not need them.
pub(crate) fn resources(config: &Config) -> anyhow::Result<()> {
    allowance::check(config)?;
    match too_little(config, wire::shared_memory_available()?) {
        Some(message) => anyhow::bail!(message),
        None => Ok(()),
    }
}

#[cfg(test)]
mod fuzz;
