//! Everything that can be known to be wrong before a process is started.

use std::path::Path;

use agents::{high, low, vae, walker};
use config::{Config, Fault, Faults, Kind};
use wire::{Limits, Reader};

/// The machine's shared memory does not hold the run.
#[derive(Debug, thiserror::Error)]
#[error(
    "/dev/shm has {available} MiB free and the run can need {needed} MiB; free some (see `formica \
     doctor`), or lower topology.window or topology.max_actors"
)]
pub(crate) struct TooSmall {
    available: u64,
    needed: u64,
}

/// Reads a config and checks all that the config alone cannot: the maze's map, shared memory.
pub(crate) fn load(path: &Path, sets: &[(String, String)]) -> anyhow::Result<Config> {
    let config = Config::load(path, sets)?;
    if let Err(error) = actor::layout(&config) {
        let text = std::fs::read_to_string(path).unwrap_or_default();
        let line = text
            .lines()
            .position(|line| line.trim_start().starts_with("rows"));
        let fault = Fault {
            line: line.map_or(1, |line| line + 1),
            key: "maze.rows".to_owned(),
            message: error.root_cause().to_string(),
        };
        let origin = path.display().to_string();
        return Err(Faults {
            origin,
            faults: vec![fault],
        }
        .into());
    }
    let available = wire::shared_memory_available()?;
    let needed = limits(&config).shared_memory_bytes();
    if needed > available {
        return Err(TooSmall {
            available: available >> 20,
            needed: needed >> 20,
        }
        .into());
    }
    Ok(config)
}

/// Sizes of the run's channels.
pub(crate) fn limits(config: &Config) -> Limits {
    let offline = config.run.kind == Kind::Offline;
    let (dz, nodes) = (config.encoder.latent, config.graph.nodes);
    let weights = if offline {
        [
            vae::Shape::new(dz, &config.encoder.hidden).weights(),
            low::Policy::new(dz, &config.low.hidden).mlp().parameters(),
            high::Policy::new(dz, nodes, &config.high.hidden)
                .mlp()
                .parameters(),
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
