//! Sizes of a run's channels.

use agents::Plan;
use config::Config;
use wire::{Limits, Part, Reader};

/// Sizes of the channels of a run that trains by a plan.
pub(crate) fn limits(config: &Config, plan: &dyn Plan) -> Limits {
    let graph = plan.graph();
    let readers = match graph {
        Some(_) => Reader::ALL.to_vec(),
        None => vec![Reader::Learner],
    };
    let parts = plan.networks().into_iter().map(|network| Part {
        name: network.name.to_owned(),
        values: network.weights,
        grows: network.grows,
    });
    Limits {
        max_actors: config.topology.max_actors,
        window: config.topology.window,
        spaces: agents::body(config).spaces(),
        trajectory_rows: plan.environments().trajectory_rows,
        choice_words: plan.choice_words(),
        parts: parts.collect(),
        graph_bytes: graph.map_or(0, |rule| rule.max_bytes()),
        readers,
    }
}
