//! Everything that can be known to be wrong before a process is started.

use std::path::Path;

use ::dataset::{Loaded, Made};
use agents::{high, low, vae, walker};
use config::{Config, Kind, Misfit};
use maze::Layout;
use wire::{Limits, Reader};

use crate::allowance;

/// A data set of another maze than the config's.
#[derive(Debug, thiserror::Error)]
#[error(
    "{path}: was collected in maze.layout = \"{made}\", the config has \"{wanted}\"; name another \
     file for this maze, or set maze.layout to the data's"
)]
pub(crate) struct OtherMaze {
    path: String,
    made: String,
    wanted: String,
}

/// Reads the data set of a config, if it is there, and says what is to be said of it.
///
/// # Errors
/// Data that cannot be read, or that do not fit the run.
pub(crate) fn data(config: &Config) -> anyhow::Result<Option<Loaded>> {
    let path = Path::new(&config.dataset.path);
    if config.run.kind == Kind::Walker || !path.exists() {
        return Ok(None);
    }
    if let Some(made) = Made::read(path)? {
        if !is_of_maze(&made, config)? {
            let other = OtherMaze {
                path: config.dataset.path.clone(),
                made: made.maze,
                wanted: config.maze.layout.clone(),
            };
            match config.dataset.fit {
                Misfit::Refuse => return Err(other.into()),
                Misfit::Warn => say!("note: {other}"),
            }
        } else if let Some(wanted) = actor::collect::made(config)? {
            for change in changes(&made, &wanted) {
                say!("note: {}: {change}", config.dataset.path);
            }
        }
    }
    let loaded = ::dataset::load_for(config)?;
    for note in &loaded.notes {
        say!("note: {note}");
    }
    Ok(Some(loaded))
}

/// Whether a data set was collected in the config's maze, whatever either calls it.
fn is_of_maze(made: &Made, config: &Config) -> anyhow::Result<bool> {
    let rows: Vec<&str> = made.maze_rows.split_whitespace().collect();
    // A maze that this version does not know is another one.
    let Ok(own) = Layout::of(&made.maze, &rows) else {
        return Ok(false);
    };
    let wanted = actor::layout(config)?;
    let same = |layout: &Layout| (layout.shape(), layout.start(), layout.free_cells());
    Ok(same(&own) == same(&wanted))
}

/// What of `[collect]` is not as it was, a sentence each. Its seed is the run's, and runs of other
/// seeds may well learn from one data set.
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

/// Reads a config and checks all that the file alone does not tell: the maze's map, and whether
/// shared memory holds the run.
pub(crate) fn load(path: &Path, sets: &[(String, String)]) -> anyhow::Result<Config> {
    let available = wire::shared_memory_available()?;
    let paths = config::Paths::default();
    let config = Config::load_with(path, sets, paths, |config| further(config, available))?;
    Ok(config)
}

/// What is wrong with a config beyond what its file tells, by `table.key`: the maze's map, and
/// whether the shared memory that is available (bytes) holds the run.
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

/// What is wrong where shared memory does not hold the run.
fn too_little(config: &Config, available: u64) -> Option<String> {
    let needed = limits(config).shared_memory_bytes();
    (needed > available).then(|| {
        format!(
            "/dev/shm has {} MiB free and the run can need {} MiB; free some (see `formica \
             doctor`), or lower topology.window or topology.max_actors",
            available >> 20,
            needed.div_ceil(1 << 20)
        )
    })
}

/// Checks what a run needs of the machine, beyond what [`load`] does: a data set can be made without.
pub(crate) fn resources(config: &Config) -> anyhow::Result<()> {
    allowance::check(config)?;
    match too_little(config, wire::shared_memory_available()?) {
        Some(message) => anyhow::bail!(message),
        None => Ok(()),
    }
}

/// Sizes of the run's channels.
pub(crate) fn limits(config: &Config) -> Limits {
    let offline = config.run.kind == Kind::Offline;
    let dz = config.encoder.latent;
    let nodes = if config.graph.online {
        config.graph.max_nodes
    } else {
        config.graph.nodes
    };
    let weights = if offline {
        [
            vae::Shape::new(dz, &config.encoder.hidden).weights(),
            low::Policy::new(dz, &config.low.hidden).mlp().parameters(),
            high::Policy::new(dz, nodes, &config.high.hidden).weights(),
            0,
        ]
    } else {
        [
            0,
            0,
            0,
            walker::Policy::new(&config.walker.hidden).weights(),
        ]
    };
    Limits {
        max_actors: config.topology.max_actors,
        window: config.topology.window,
        trajectory_steps: if offline {
            actor::TRAJECTORY_STEPS
        } else {
            config.walker.segment + 1
        },
        weights,
        graph_bytes: if offline {
            graph::max_bytes(nodes, dz)
        } else {
            0
        },
        readers: if offline {
            Reader::ALL.to_vec()
        } else {
            vec![Reader::Learner]
        },
    }
}

#[cfg(test)]
mod fuzz;
