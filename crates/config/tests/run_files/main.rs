//! Whole run files, with the tables of the default algorithm.
#![allow(clippy::unwrap_used, clippy::panic, clippy::expect_used)]

mod messages;
mod random;
mod resume;

use proptest::prelude::*;

use agents::CONFIGS;
use agents::lg_h_ppo::Settings;
use config::{Config, Fault, Faults};

fn settings(config: &Config) -> &Settings {
    config.settings.get().unwrap()
}

fn parse(text: &str) -> Result<Config, Faults> {
    CONFIGS.parse(text, "x.toml", "x", &[])
}

const GOOD: &str = "[run]\nseed = 3\n[dataset]\npath = \"data/none.hdf5\"\n[collect]\n";

#[test]
fn every_fault_is_named_at_once_with_its_line() {
    let text = "[run]\nsead = 3\nalgorithm = \"lg-hppo\"\n[maze]\nlayout = 7\n[topologie]\n\
                [graph]\nnodes = 1\n[high]\nhorizon = 1\nenvironments = 2\n";
    let faults = parse(text).unwrap_err();
    let told = faults.to_string();
    let lines: Vec<&str> = told.lines().collect();
    assert_eq!(
        lines,
        [
            "x.toml:1: dataset.path: missing; name a D4RL HDF5 file, a Minari folder or an OGBench npz",
            "x.toml:2: run.sead: unknown key; did you mean 'seed'?",
            "x.toml:3: run.algorithm: unknown word; did you mean 'lg-h-ppo'?",
            "x.toml:5: maze.layout: expected a text in quotes, found the whole number 7",
            "x.toml:6: topologie: unknown table; did you mean 'topology'?",
            "x.toml:8: graph.nodes: 1 is out of range; 2 to 4096 are possible",
            "x.toml:9: high.minibatch: 4096 is more than a batch of environments x horizon = 2",
        ]
    );
}

#[test]
fn missing_data_are_named_unless_they_can_be_made() {
    let text = "[dataset]\npath = \"nowhere.hdf5\"\n";
    let faults = parse(text).unwrap_err().faults;
    assert_eq!(faults.len(), 1);
    assert_eq!(
        (faults[0].line, faults[0].key.as_str()),
        (2, "dataset.path")
    );
    assert!(faults[0].message.contains("nowhere.hdf5"));
    assert!(parse(GOOD).is_ok());
}

#[test]
fn stages_may_be_taken_from_files_and_cells_left_out() {
    let set = |key: &str, value: &str| {
        let sets = [(key.to_owned(), value.to_owned())];
        CONFIGS.parse(GOOD, "x.toml", "x", &sets)
    };
    let config = set("dataset.leave_out", "[[5, 8], [6, 8]]").unwrap();
    assert!(config.dataset.leaves_out(Some((6, 8))));
    assert!(!config.dataset.leaves_out(Some((8, 6))) && !config.dataset.leaves_out(None));
    for (key, value, told) in [
        (
            "dataset.leave_out",
            "[[5]]",
            "[5] is no cell; cells are [row, column]",
        ),
        ("low.from", "nowhere", "no file 'nowhere'"),
        ("encoder.from", "nowhere", "no file 'nowhere'"),
        (
            "graph.max_nodes",
            "10",
            "less than the 200 nodes to begin with",
        ),
        (
            "encoder.kind",
            "place2",
            "unknown word; did you mean 'place'?",
        ),
        (
            "graph.knowledge",
            "all",
            "unknown word; known are none, data, rollouts",
        ),
    ] {
        let faults = set(key, value).unwrap_err();
        assert_eq!(faults.to_string(), format!("--set {key}: {told}"));
    }
    let places = set("encoder.kind", "place").unwrap();
    let places = &settings(&places).encoder;
    assert_eq!((places.latent, places.hidden.len()), (2, 0));
}

#[test]
fn syntax_errors_have_a_line() {
    let faults = parse("[run]\nseed = \n").unwrap_err().faults;
    assert!(
        faults
            .iter()
            .any(|fault| fault.key.is_empty() && fault.line == 2),
        "{faults:?}"
    );
}

#[test]
fn set_goes_over_the_file_and_is_checked_alike() {
    let set = |key: &str, value: &str| {
        let sets = [(key.to_owned(), value.to_owned())];
        CONFIGS.parse(GOOD, "x.toml", "x", &sets)
    };
    assert_eq!(set("run.seed", "9").unwrap().run.seed, 9);
    assert_eq!(set("maze.layout", "large").unwrap().maze.layout, "large");
    let told = set("run.sed", "9").unwrap_err().to_string();
    assert_eq!(told, "--set run.sed: unknown key; did you mean 'seed'?");
    assert!(set("seed", "9").is_err());
}

#[test]
fn the_resolved_file_reads_back_as_the_same_config() {
    let config = parse(GOOD).unwrap();
    let again = CONFIGS
        .parse(config.resolved(), "x.toml", "other", &[])
        .unwrap();
    assert_eq!(config, again);
    assert_eq!(config.hash(), again.hash());
    assert_ne!(
        config.hash(),
        parse(&GOOD.replace('3', "4")).unwrap().hash()
    );
    // Where its files lie makes no other run of it.
    let set = |path: &str| {
        let sets = [("dataset.path".to_owned(), path.to_owned())];
        CONFIGS.parse(GOOD, "x.toml", "x", &sets).unwrap()
    };
    let (here, there) = (set("a/x.hdf5"), set("/b/x.hdf5"));
    assert_ne!(here.resolved(), there.resolved());
    assert_eq!(here.hash(), there.hash());
    assert_ne!(here.hash(), set("a/y.hdf5").hash());
}

#[test]
fn the_shipped_configs_are_right() {
    // Paths in them start from the project's folder.
    std::env::set_current_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).unwrap();
    let folder = "configs";
    let mut seen = 0;
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_some_and(|e| e == "toml") {
            CONFIGS
                .load(&path, &[])
                .unwrap_or_else(|faults| panic!("{faults}"));
            seen += 1;
        }
    }
    assert!(seen >= 2, "{seen} configs");
}

proptest! {
    #[test]
    fn no_text_makes_it_panic(text in "\\PC{0,200}") {
        let _ = parse(&text);
    }

    #[test]
    fn no_change_of_a_good_file_makes_it_panic(
        at in 0..GOOD.len(), change in "[\\[\\]\"=\\n.a-z0-9-]{0,4}"
    ) {
        let mut text = GOOD.to_owned();
        text.replace_range(at..(at + 1), &change);
        if let Err(Faults { faults, .. }) = parse(&text) {
            let lines = text.lines().count() + 1;
            let placed = |fault: &Fault| (1..=lines).contains(&fault.line);
            prop_assert!(faults.iter().all(placed), "{:?}", faults);
        }
    }
}
