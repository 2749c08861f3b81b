//! What a change of a key means for a run that is resumed.

use std::collections::BTreeSet;

use agents::{ALGORITHMS, CONFIGS};
use config::OnResume::{Episodes, Fixed, Free, Input, Rollouts};
use config::{Config, OnResume};

const OFFLINE: &str = "[dataset]\npath = \"x.hdf5\"\n[collect]\n";

fn config(text: &str, sets: &[(&str, &str)]) -> Config {
    let sets: Vec<(String, String)> = sets
        .iter()
        .map(|(key, value)| ((*key).to_owned(), (*value).to_owned()))
        .collect();
    CONFIGS.parse(text, "x.toml", "x", &sets).unwrap()
}

/// What a change of each key means, where it is not fixed.
#[test]
fn most_keys_of_a_run_are_fixed() {
    let mut changeable = BTreeSet::new();
    for algorithm in ALGORITHMS {
        let text = format!("[run]\nalgorithm = \"{}\"\n{OFFLINE}", algorithm.name());
        for key in config(&text, &[]).keys() {
            if key.on_resume != Fixed {
                let name = format!("{}.{}", key.table, key.key);
                changeable.insert((format!("{:?}", key.on_resume), name));
            }
        }
    }
    let of = |on_resume: OnResume| -> Vec<&str> {
        let wanted = format!("{on_resume:?}");
        let found = changeable.iter().filter(|(kind, _)| *kind == wanted);
        found.map(|(_, name)| name.as_str()).collect()
    };
    assert_eq!(
        of(Input),
        [
            "collect.walker",
            "dataset.path",
            "encoder.from",
            "low.from",
            "walker.start"
        ]
    );
    assert_eq!(of(Episodes), ["evaluation.episodes"]);
    let rollouts = ["episodes", "rounds", "seconds", "test_every"];
    let rollouts = rollouts.map(|key| format!("rollouts.{key}"));
    assert_eq!(of(Rollouts)[..4], rollouts.each_ref().map(String::as_str));
    assert!(of(Rollouts).contains(&"topology.max_policy_lag"));
    assert_eq!(
        of(OnResume::Protocol),
        [
            "evaluation.max_steps",
            "evaluation.success_radius",
            "execution.goal_radius",
            "execution.look_ahead",
            "execution.max_edge_steps",
            "execution.reached_radius",
            "execution.timeout_factor",
        ]
    );
    for key in [
        "topology.actors",
        "graph.refresh_seconds",
        "traces.evaluation",
        "walker.output",
    ] {
        assert!(of(Free).contains(&key), "{key}");
    }
}

#[test]
fn files_that_a_run_reads_are_named_by_their_keys() {
    let config = config(OFFLINE, &[("dataset.path", "/a$$b/x.hdf5")]);
    let inputs = config.inputs();
    assert_eq!(inputs.len(), 1);
    assert_eq!(inputs[0].0, "dataset.path");
    assert_eq!(inputs[0].1.display().to_string(), "/a$b/x.hdf5");
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
