//! Everything that can be known to be wrong before a process is started.

use std::path::Path;

use agents::{high, low, vae, walker};
use config::{Config, Kind};
use wire::{Limits, Reader};

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
