//! Sizes of a run's channels.

use agents::{high, low, vae, walker};
use config::{Config, Kind};
use wire::{Limits, Reader};

/// Sizes of the channels of a run.
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
