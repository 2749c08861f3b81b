//! What a change of a key means for a run that is resumed: one table of all keys.

use std::collections::BTreeMap;

use crate::fault::shown;
use crate::sections::Config;

/// What becomes of a key that has changed since a run's states were made.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum OnResume {
    /// Taken: it says how processes are run and watched, not what they make.
    Free,
    /// Taken, but not in a deterministic run, whose result follows from its first config: it says
    /// what is played in training.
    Rollouts,
    /// Taken: episodes of the evaluation that were played count, those that are missing are
    /// played.
    Episodes,
    /// Taken, but not in a deterministic run: it says what an episode is, so the evaluation is
    /// played anew.
    Protocol,
    /// A file that was read: taken where its content is the same, as when it was moved.
    Input,
    /// Refused: it shapes the data, the weights or the graph.
    Fixed,
}

/// A key that has changed.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Change {
    /// `table.key`.
    pub key: String,
    /// The value that the states were made with, as TOML, shortened; none where there was no such key.
    pub old: Option<String>,
    /// The value that is asked for now.
    pub new: Option<String>,
    /// What becomes of it, in a run of this kind.
    pub on_resume: OnResume,
}

impl std::fmt::Display for Change {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let value = |value: &Option<String>| value.clone().unwrap_or_else(|| "nothing".to_owned());
        let (old, new) = (value(&self.old), value(&self.new));
        write!(f, "{}: {old} -> {new}", self.key)
    }
}

use OnResume::{Episodes, Fixed, Free, Input, Protocol, Rollouts};

/// Every table with its keys. A key that is not here is a failing test.
const TABLES: [(&str, &[(&str, OnResume)]); 17] = [
    (
        "run",
        &[
            // The folder keeps its name; `mv` gives it another one.
            ("name", Fixed),
            ("seed", Fixed),
            ("kind", Fixed),
            ("deterministic", Fixed),
            ("checkpoint_seconds", Free),
        ],
    ),
    ("maze", &[("layout", Fixed), ("rows", Fixed)]),
    (
        "topology",
        &[
            ("actors", Free),
            ("max_actors", Free),
            ("window", Free),
            // What is too old is not learned from, which steers like the number of actors does.
            ("max_policy_lag", Rollouts),
        ],
    ),
    ("actor", &SUPERVISION),
    ("learner", &SUPERVISION),
    ("graph_builder", &SUPERVISION),
    (
        "dataset",
        &[
            ("path", Input),
            ("leave_out", Fixed),
            ("fit", Fixed),
            ("on_fault", Fixed),
        ],
    ),
    (
        "collect",
        &[
            ("style", Fixed),
            ("transitions", Fixed),
            ("episode_steps", Fixed),
            ("noise", Fixed),
            ("walker", Input),
            ("threads", Free),
        ],
    ),
    (
        "encoder",
        &[
            ("kind", Fixed),
            ("latent", Fixed),
            ("lag", Fixed),
            ("beta", Fixed),
            ("prior_balance", Fixed),
            ("null_condition", Fixed),
            ("hidden", Fixed),
            // Weights of two step sizes are of neither config, here and below; and step sizes
            // fall over the updates, so that a stage's length is part of its schedule.
            ("learning_rate", Fixed),
            ("batch", Fixed),
            ("updates", Fixed),
            ("from", Input),
        ],
    ),
    (
        "graph",
        &[
            ("nodes", Fixed),
            ("lag", Fixed),
            ("min_count", Fixed),
            ("min_trajectories", Fixed),
            ("states_per_place", Fixed),
            // When versions come, not what is in them.
            ("refresh_seconds", Free),
            ("seeding", Fixed),
            ("wrong_edges", Fixed),
            ("knowledge", Fixed),
            ("online", Fixed),
            ("max_nodes", Fixed),
            ("growth_radius", Fixed),
            ("growth_states", Fixed),
            ("least_success", Fixed),
        ],
    ),
    (
        "low",
        &[
            ("hidden", Fixed),
            ("learning_rate", Fixed),
            ("batch", Fixed),
            ("updates", Fixed),
            ("expectile", Fixed),
            ("discount", Fixed),
            ("inverse_temperature", Fixed),
            ("weight_clip", Fixed),
            ("target_rate", Fixed),
            ("snap", Fixed),
            ("slack", Fixed),
            // Without it there are weights to train that nobody trained.
            ("controller", Fixed),
            ("from", Input),
        ],
    ),
    (
        "high",
        &[
            ("hidden", Fixed),
            ("learning_rate", Fixed),
            ("environments", Fixed),
            ("horizon", Fixed),
            ("epochs", Fixed),
            ("minibatch", Fixed),
            ("clip", Fixed),
            ("entropy", Fixed),
            ("discount", Fixed),
            ("gae_lambda", Fixed),
            ("arrival_reward", Fixed),
            ("edge_cost", Fixed),
            ("max_edges", Fixed),
            ("steps", Fixed),
            ("physics_share", Fixed),
            ("planner", Fixed),
        ],
    ),
    (
        "rollouts",
        &[
            ("seconds", Rollouts),
            ("test_every", Rollouts),
            // Of deterministic runs alone.
            ("rounds", Rollouts),
            ("episodes", Rollouts),
        ],
    ),
    (
        "execution",
        &[
            ("reached_radius", Protocol),
            ("goal_radius", Protocol),
            ("look_ahead", Protocol),
            ("timeout_factor", Protocol),
            ("max_edge_steps", Protocol),
        ],
    ),
    (
        "evaluation",
        &[
            ("episodes", Episodes),
            ("max_steps", Protocol),
            ("success_radius", Protocol),
        ],
    ),
    ("traces", &[("evaluation", Free), ("training_every", Free)]),
    (
        "walker",
        &[
            ("environments", Fixed),
            ("segment", Fixed),
            ("batch", Fixed),
            ("epochs", Fixed),
            ("minibatch", Fixed),
            ("learning_rate", Fixed),
            ("clip", Fixed),
            ("entropy", Fixed),
            ("discount", Fixed),
            ("gae_lambda", Fixed),
            ("hidden", Fixed),
            ("initial_log_std", Fixed),
            ("target_kl", Fixed),
            ("steps", Fixed),
            ("turn_every", Fixed),
            ("maze_share", Fixed),
            ("top_speed", Fixed),
            ("fall_cost", Fixed),
            ("tilt_cost", Fixed),
            ("start", Input),
            ("output", Free),
        ],
    ),
];

const SUPERVISION: [(&str, OnResume); 7] = [
    ("restarts", Free),
    ("window_seconds", Free),
    ("pause_seconds", Free),
    ("longest_pause_seconds", Free),
    ("hung_seconds", Free),
    ("start_seconds", Free),
    ("stuck_seconds", Free),
];

/// Tables that have a key of this name.
pub(crate) fn tables_with(key: &str) -> Vec<&'static str> {
    let has = |keys: &[(&str, OnResume)]| keys.iter().any(|(known, _)| *known == key);
    let tables = TABLES.iter().filter(|(_, keys)| has(keys));
    tables.map(|(table, _)| *table).collect()
}

impl Config {
    /// The keys that have changed since a run's states were made with `made`, and what becomes of
    /// each when the run is resumed.
    #[must_use]
    pub fn changes(&self, made: &Self) -> Vec<Change> {
        let (old, new) = (flat(made.resolved()), flat(self.resolved()));
        let keys: std::collections::BTreeSet<&String> = old.keys().chain(new.keys()).collect();
        let changed = keys
            .into_iter()
            .filter(|key| old.get(*key) != new.get(*key));
        changed
            .map(|key| Change {
                key: key.clone(),
                old: old.get(key).map(|value| shown(value)),
                new: new.get(key).map(|value| shown(value)),
                on_resume: match (on_resume(key), made.run.deterministic) {
                    (Rollouts | Protocol, true) => Fixed,
                    (on_resume, _) => on_resume,
                },
            })
            .collect()
    }
}

fn on_resume(path: &str) -> OnResume {
    let (table, key) = path.split_once('.').unwrap_or((path, ""));
    let keys = TABLES.iter().find(|(known, _)| *known == table);
    let key = keys.and_then(|(_, keys)| keys.iter().find(|(known, _)| *known == key));
    key.map_or(Fixed, |(_, on_resume)| *on_resume)
}

/// Values by `table.key`.
fn flat(resolved: &str) -> BTreeMap<String, String> {
    let mut flat = BTreeMap::new();
    for (table, value) in toml::from_str::<toml::Table>(resolved).unwrap_or_default() {
        if let toml::Value::Table(keys) = value {
            for (key, value) in keys {
                flat.insert(format!("{table}.{key}"), value.to_string());
            }
        }
    }
    flat
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    const OFFLINE: &str = "[dataset]\npath = \"x.hdf5\"\n[collect]\n";

    fn config(text: &str, sets: &[(&str, &str)]) -> Config {
        let sets: Vec<(String, String)> = sets
            .iter()
            .map(|(key, value)| ((*key).to_owned(), (*value).to_owned()))
            .collect();
        Config::parse(text, "x.toml", "x", &sets).unwrap()
    }

    #[test]
    fn every_key_is_in_the_table_once_and_none_besides() {
        let [offline, walker] =
            [OFFLINE, "[run]\nkind = \"walker\"\n"].map(|text| config(text, &[]));
        let mut read: BTreeSet<String> = flat(offline.resolved()).into_keys().collect();
        read.extend(flat(walker.resolved()).into_keys());
        let listed: Vec<String> = TABLES
            .iter()
            .flat_map(|(table, keys)| keys.iter().map(move |(key, _)| format!("{table}.{key}")))
            .collect();
        let unique: BTreeSet<String> = listed.iter().cloned().collect();
        assert_eq!(
            unique.len(),
            listed.len(),
            "a key stands twice in the table"
        );
        assert_eq!(read, unique);
    }

    #[test]
    fn changes_are_told_with_what_becomes_of_them() {
        let made = config(OFFLINE, &[]);
        assert_eq!(made.changes(&made), []);
        let now = config(
            OFFLINE,
            &[
                ("topology.actors", "3"),
                ("graph.nodes", "100"),
                ("evaluation.episodes", "7"),
                ("rollouts.seconds", "1"),
            ],
        );
        let told: Vec<(String, OnResume)> = now
            .changes(&made)
            .into_iter()
            .map(|change| (change.to_string(), change.on_resume))
            .collect();
        let expected = [
            ("evaluation.episodes: 100 -> 7", Episodes),
            ("graph.max_nodes: 300 -> 150", Fixed),
            ("graph.nodes: 200 -> 100", Fixed),
            ("rollouts.seconds: 15.0 -> 1.0", Rollouts),
            ("topology.actors: 2 -> 3", Free),
        ];
        let expected = expected.map(|(change, on_resume)| (change.to_owned(), on_resume));
        assert_eq!(told, expected);
    }

    #[test]
    fn what_is_played_is_fixed_in_a_deterministic_run() {
        let fixed = [("run.deterministic", "true")];
        let made = config(OFFLINE, &fixed);
        for (key, value) in [("rollouts.rounds", "9"), ("execution.look_ahead", "3")] {
            let now = config(OFFLINE, &[fixed[0], (key, value)]);
            assert_eq!(now.changes(&made)[0].on_resume, Fixed, "{key}");
        }
    }
}
