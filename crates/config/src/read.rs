//! Reads every table and key, with its default and its range.

use std::path::Path;

use crate::reader::{Document, Table};
use crate::sections::{
    Collect, Config, Controller, Dataset, Encoder, Evaluation, Execution, Graph, High, Kind,
    Knowledge, Latent, Low, Maze, OnFault, Planner, Rollouts, Run, Seeding, Supervision, Topology,
    Traces, WalkerTraining,
};

const LAYOUTS: [&str; 6] = ["umaze", "medium", "large", "giant", "teleport", "custom"];

const OFFLINE_TABLES: [&str; 10] = [
    "dataset",
    "collect",
    "encoder",
    "graph",
    "low",
    "high",
    "rollouts",
    "execution",
    "evaluation",
    "traces",
];

pub(crate) fn read(d: &mut Document<'_>, stem: &str) -> Config {
    let run = d.table("run", |t| {
        let name = t.value("name", stem.to_owned(), |name| {
            let plain = |b: u8| b.is_ascii_alphanumeric() || b"-_.".contains(&b);
            let good = !name.is_empty() && name.len() <= 64 && !name.starts_with('.');
            if good && name.bytes().all(plain) {
                return Ok(());
            }
            Err("a name has 1 to 64 letters, digits, '-', '_' or '.'".to_owned())
        });
        let seed = t.count("seed", 0, [0, u32::MAX as usize]) as u64;
        let kind = t.word("kind", "offline", &["offline", "walker"]);
        let kind = if kind == "walker" {
            Kind::Walker
        } else {
            Kind::Offline
        };
        Run {
            name,
            seed,
            kind,
            deterministic: t.value("deterministic", false, |_| Ok(())),
            checkpoint_seconds: t.number("checkpoint_seconds", 10.0, [0.0, 86_400.0]),
        }
    });
    let offline = run.kind == Kind::Offline;
    let maze = d.table("maze", |t| {
        let layout = t.word("layout", "medium", &LAYOUTS);
        let rows: Vec<String> = t.value("rows", vec![], |_| Ok(()));
        if (layout == "custom") == rows.is_empty() {
            t.fault(
                "rows",
                "rows go with layout = \"custom\", and with no other",
            );
        }
        Maze { layout, rows }
    });
    let topology = d.table("topology", |t| {
        let actors = t.count("actors", 2, [1, 32]);
        let max_actors = t.count("max_actors", 8.max(actors), [1, 64]);
        if max_actors < actors {
            t.fault(
                "max_actors",
                format!("{max_actors} is less than the {actors} actors"),
            );
        }
        Topology {
            actors,
            max_actors,
            window: t.count("window", 8, [1, 64]),
            max_policy_lag: t.count("max_policy_lag", 200, [1, 1_000_000]),
        }
    });
    let [actor, learner, graph_builder] =
        ["actor", "learner", "graph_builder"].map(|role| d.table(role, read_supervision));
    let has_collect = d.has("collect");
    let dataset = if offline {
        read_dataset(d, has_collect)
    } else {
        Dataset {
            path: String::new(),
            leave_out: vec![],
            on_fault: OnFault::Refuse,
        }
    };
    let collect = (offline && has_collect).then(|| read_collect(d, &maze.layout));
    let encoder = read_encoder(d, offline);
    let graph = read_graph(d, offline);
    let low = read_low(d, offline);
    let high = read_high(d, offline);
    let rollouts = read_rollouts(d, offline);
    let execution = read_execution(d, offline);
    let evaluation = read_evaluation(d, offline, &maze.layout);
    let traces = read_traces(d, offline);
    let walker = read_walker(d, !offline);
    d.finish(if offline {
        &["walker"]
    } else {
        &OFFLINE_TABLES
    });
    Config {
        run,
        maze,
        topology,
        actor,
        learner,
        graph_builder,
        dataset,
        collect,
        encoder,
        graph,
        low,
        high,
        rollouts,
        execution,
        evaluation,
        traces,
        walker,
        resolved: String::new(),
    }
}

/// Tables of the other kind of run are read from nothing: their defaults stand.
fn table<T>(
    d: &mut Document<'_>,
    wanted: bool,
    name: &'static str,
    read: impl FnOnce(&mut Table<'_, '_>) -> T,
) -> T {
    if wanted {
        d.table(name, read)
    } else {
        Document::new("", &[]).table(name, read)
    }
}

fn read_supervision(t: &mut Table<'_, '_>) -> Supervision {
    let day = 86_400.0;
    Supervision {
        restarts: t.count("restarts", 5, [0, 100_000]),
        window_seconds: t.number("window_seconds", 60.0, [1.0, day]),
        pause_seconds: t.number("pause_seconds", 0.5, [0.0, day]),
        longest_pause_seconds: t.number("longest_pause_seconds", 30.0, [0.0, day]),
        hung_seconds: t.number("hung_seconds", 10.0, [2.0, day]),
        start_seconds: t.number("start_seconds", 150.0, [2.0, day]),
        stuck_seconds: t.number("stuck_seconds", 120.0, [2.0, day]),
    }
}

fn read_dataset(d: &mut Document<'_>, has_collect: bool) -> Dataset {
    d.table("dataset", |t| {
        let path: String = t.value("path", String::new(), |_| Ok(()));
        if path.is_empty() {
            t.fault(
                "path",
                "missing; name a D4RL HDF5 file, a Minari folder or an OGBench npz",
            );
        } else if !has_collect && !Path::new(&path).exists() {
            t.fault(
                "path",
                format!("no file '{path}', and no [collect] table that would make it"),
            );
        }
        let cells: Vec<Vec<usize>> = t.value("leave_out", vec![], |cells: &Vec<Vec<usize>>| {
            match cells.iter().find(|cell| cell.len() != 2) {
                Some(cell) => Err(format!("{cell:?} is no cell; cells are [row, column]")),
                None => Ok(()),
            }
        });
        Dataset {
            path,
            leave_out: cells.iter().map(|cell| [cell[0], cell[1]]).collect(),
            on_fault: match t
                .word("on_fault", "refuse", &["refuse", "drop-episode"])
                .as_str()
            {
                "drop-episode" => OnFault::DropEpisode,
                _ => OnFault::Refuse,
            },
        }
    })
}

fn read_collect(d: &mut Document<'_>, layout: &str) -> Collect {
    d.table("collect", |t| {
        let style = t.word("style", "diverse", &["diverse", "play"]);
        let transitions = t.count("transitions", 1_000_000, [1000, 100_000_000]);
        let steps = if layout == "umaze" { 700 } else { 1000 };
        let episode_steps = t.count("episode_steps", steps, [50, 100_000]);
        if transitions < episode_steps {
            t.fault(
                "transitions",
                format!("fewer than the {episode_steps} of one episode"),
            );
        }
        let walker = read_file(t, "walker");
        Collect {
            style,
            transitions,
            episode_steps,
            noise: t.number("noise", 0.2, [0.0, 2.0]),
            walker,
            threads: t.count("threads", 2, [1, 256]),
        }
    })
}

fn read_encoder(d: &mut Document<'_>, wanted: bool) -> Encoder {
    table(d, wanted, "encoder", |t| {
        let places = t.word("kind", "vae", &["vae", "place"]) == "place";
        let mut encoder = read_vae(t, places);
        if places {
            if encoder.latent != 2 {
                t.fault("latent", "kind = \"place\" goes with latent = 2");
            }
            encoder.hidden.clear();
        }
        encoder
    })
}

fn read_vae(t: &mut Table<'_, '_>, places: bool) -> Encoder {
    Encoder {
        kind: if places { Latent::Place } else { Latent::Vae },
        latent: t.count("latent", if places { 2 } else { 8 }, [1, 64]),
        lag: t.count("lag", 15, [1, 1000]),
        beta: t.number("beta", 0.01, [0.0, 100.0]),
        prior_balance: t.number("prior_balance", 0.8, [0.0, 1.0]),
        null_condition: t.number("null_condition", 0.5, [0.0, 1.0]),
        hidden: t.layers("hidden", &[128, 128]),
        learning_rate: t.number("learning_rate", 1e-3, [0.0, 1.0]),
        batch: t.count("batch", 256, [1, 65_536]),
        updates: t.count("updates", 10_000, [1, 100_000_000]),
        from: read_file(t, "from"),
    }
}

/// A file that must be there, where the key is.
fn read_file(t: &mut Table<'_, '_>, key: &'static str) -> Option<String> {
    let path: Option<String> = t.optional(key);
    if let Some(path) = path.as_ref().filter(|path| !Path::new(path).is_file()) {
        t.fault(key, format!("no file '{path}'"));
    }
    path
}

fn read_graph(d: &mut Document<'_>, wanted: bool) -> Graph {
    table(d, wanted, "graph", |t| {
        let nodes = t.count("nodes", 200, [2, 4096]);
        let max_nodes = t.count("max_nodes", (nodes + nodes / 2).min(4096), [2, 4096]);
        if max_nodes < nodes {
            t.fault(
                "max_nodes",
                format!("less than the {nodes} nodes to begin with"),
            );
        }
        Graph {
            nodes,
            lag: t.count("lag", 15, [2, 1000]),
            min_count: t.count("min_count", 3, [1, 1_000_000]),
            min_trajectories: t.count("min_trajectories", 2, [1, 1_000_000]),
            states_per_place: t.count("states_per_place", 50, [1, 1_000_000]),
            refresh_seconds: t.number("refresh_seconds", 5.0, [0.1, 86_400.0]),
            seeding: match t
                .word("seeding", "k-means++", &["k-means++", "random"])
                .as_str()
            {
                "random" => Seeding::Random,
                _ => Seeding::PlusPlus,
            },
            wrong_edges: t.number("wrong_edges", 0.0, [0.0, 10.0]),
            knowledge: match t
                .word("knowledge", "rollouts", &["none", "data", "rollouts"])
                .as_str()
            {
                "none" => Knowledge::Nothing,
                "data" => Knowledge::Data,
                _ => Knowledge::Rollouts,
            },
            online: t.value("online", false, |_| Ok(())),
            max_nodes,
            growth_radius: t.number("growth_radius", 1.0, [0.1, 100.0]),
            growth_states: t.count("growth_states", 20, [1, 1000]),
            least_success: t.number("least_success", 0.1, [0.0, 1.0]),
        }
    })
}

fn read_low(d: &mut Document<'_>, wanted: bool) -> Low {
    table(d, wanted, "low", |t| Low {
        hidden: t.layers("hidden", &[256, 256]),
        learning_rate: t.number("learning_rate", 1e-3, [0.0, 1.0]),
        batch: t.count("batch", 256, [1, 65_536]),
        updates: t.count("updates", 10_000, [1, 100_000_000]),
        expectile: t.number("expectile", 0.7, [0.5, 0.999]),
        discount: t.number("discount", 0.98, [0.0, 0.9999]),
        inverse_temperature: t.number("inverse_temperature", 3.0, [0.0, 100.0]),
        weight_clip: t.number("weight_clip", 100.0, [1.0, 1e6]),
        target_rate: t.number("target_rate", 0.005, [0.0, 1.0]),
        snap: t.number("snap", 0.5, [0.0, 1.0]),
        slack: t.count("slack", 5, [0, 1000]),
        controller: match t
            .word("controller", "learned", &["learned", "walker"])
            .as_str()
        {
            "walker" => Controller::Walker,
            _ => Controller::Learned,
        },
        from: read_file(t, "from"),
    })
}

fn read_high(d: &mut Document<'_>, wanted: bool) -> High {
    table(d, wanted, "high", |t| {
        let high = High {
            hidden: t.layers("hidden", &[128, 128]),
            learning_rate: t.number("learning_rate", 1e-3, [0.0, 1.0]),
            environments: t.count("environments", 512, [1, 65_536]),
            horizon: t.count("horizon", 32, [1, 4096]),
            epochs: t.count("epochs", 3, [1, 100]),
            minibatch: t.count("minibatch", 4096, [1, 1_000_000]),
            clip: t.number("clip", 0.2, [0.01, 1.0]),
            entropy: t.number("entropy", 0.01, [0.0, 10.0]),
            discount: t.number("discount", 0.98, [0.0, 0.9999]),
            gae_lambda: t.number("gae_lambda", 0.95, [0.0, 1.0]),
            arrival_reward: t.number("arrival_reward", 1.0, [0.0, 1000.0]),
            edge_cost: t.number("edge_cost", 0.02, [0.0, 1000.0]),
            max_edges: t.count("max_edges", 64, [1, 100_000]),
            steps: t.count("steps", 3_000_000, [1, 10_000_000_000]),
            physics_share: t.number("physics_share", 0.25, [0.0, 1.0]),
            planner: match t
                .word("planner", "learned", &["learned", "search"])
                .as_str()
            {
                "search" => Planner::Search,
                _ => Planner::Learned,
            },
        };
        let batch = high.environments * high.horizon;
        if high.minibatch > batch {
            let message = format!(
                "{} is more than a batch of environments x horizon = {batch}",
                high.minibatch
            );
            t.fault("minibatch", message);
        }
        high
    })
}

fn read_rollouts(d: &mut Document<'_>, wanted: bool) -> Rollouts {
    table(d, wanted, "rollouts", |t| Rollouts {
        seconds: t.number("seconds", 15.0, [0.0, 86_400.0]),
        test_every: t.count("test_every", 8, [0, 1_000_000]),
        rounds: t.count("rounds", 4, [0, 100_000]),
        episodes: t.count("episodes", 64, [1, 1024]),
    })
}

fn read_execution(d: &mut Document<'_>, wanted: bool) -> Execution {
    table(d, wanted, "execution", |t| Execution {
        reached_radius: t.number("reached_radius", 0.75, [0.1, 10.0]),
        goal_radius: t.number("goal_radius", 2.5, [0.0, 100.0]),
        look_ahead: t.count("look_ahead", 2, [1, 16]),
        timeout_factor: t.number("timeout_factor", 2.0, [1.0, 100.0]),
        max_edge_steps: t.count("max_edge_steps", 40, [1, 10_000]),
    })
}

fn read_evaluation(d: &mut Document<'_>, wanted: bool, layout: &str) -> Evaluation {
    table(d, wanted, "evaluation", |t| Evaluation {
        episodes: t.count("episodes", 100, [1, 1024]),
        max_steps: t.count(
            "max_steps",
            if layout == "umaze" { 700 } else { 1000 },
            [1, 1_000_000],
        ),
        success_radius: t.number("success_radius", 0.5, [0.01, 10.0]),
    })
}

fn read_traces(d: &mut Document<'_>, wanted: bool) -> Traces {
    table(d, wanted, "traces", |t| Traces {
        evaluation: t.value("evaluation", true, |_| Ok(())),
        training_every: t.count("training_every", 0, [0, 1_000_000_000]),
    })
}

fn read_walker(d: &mut Document<'_>, wanted: bool) -> WalkerTraining {
    table(d, wanted, "walker", |t| {
        let walker = WalkerTraining {
            environments: t.count("environments", 32, [1, 1024]),
            segment: t.count("segment", 64, [2, 4096]),
            batch: t.count("batch", 16_384, [64, 10_000_000]),
            epochs: t.count("epochs", 5, [1, 100]),
            minibatch: t.count("minibatch", 2048, [16, 1_000_000]),
            learning_rate: t.number("learning_rate", 3e-4, [0.0, 1.0]),
            clip: t.number("clip", 0.2, [0.01, 1.0]),
            entropy: t.number("entropy", 0.0, [0.0, 10.0]),
            discount: t.number("discount", 0.97, [0.0, 0.9999]),
            gae_lambda: t.number("gae_lambda", 0.95, [0.0, 1.0]),
            hidden: t.layers("hidden", &[128, 128]),
            initial_log_std: t.number("initial_log_std", -0.5, [-2.5, 0.5]),
            target_kl: t.number("target_kl", 0.02, [0.0001, 10.0]),
            steps: t.count("steps", 10_000_000, [1, 10_000_000_000]),
            turn_every: t.number("turn_every", 60.0, [1.0, 100_000.0]),
            maze_share: t.number("maze_share", 0.5, [0.0, 1.0]),
            top_speed: t.number("top_speed", 2.0, [0.1, 10.0]),
            fall_cost: t.number("fall_cost", 3.0, [0.0, 1000.0]),
            tilt_cost: t.number("tilt_cost", 0.3, [0.0, 100.0]),
            start: t.value("start", String::new(), |_| Ok(())),
            output: t.value("output", String::new(), |_| Ok(())),
        };
        if !walker.start.is_empty() && !Path::new(&walker.start).is_file() {
            t.fault("start", format!("no file '{}'", walker.start));
        }
        if walker.minibatch > walker.batch {
            let message = format!(
                "{} is more than the batch of {}",
                walker.minibatch, walker.batch
            );
            t.fault("minibatch", message);
        }
        walker
    })
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::{Fault, Faults};

    fn parse(text: &str) -> Result<Config, Faults> {
        Config::parse(text, "x.toml", "x", &[])
    }

    const GOOD: &str = "[run]\nseed = 3\n[dataset]\npath = \"data/none.hdf5\"\n[collect]\n";

    #[test]
    fn every_fault_is_named_at_once_with_its_line() {
        let text = "[run]\nsead = 3\nkind = \"ofline\"\n[maze]\nlayout = 7\n[topologie]\n\
                    [graph]\nnodes = 1\n[high]\nhorizon = 1\nenvironments = 2\n";
        let faults = parse(text).unwrap_err();
        let told = faults.to_string();
        let lines: Vec<&str> = told.lines().collect();
        assert_eq!(
            lines,
            [
                "x.toml:1: dataset.path: missing; name a D4RL HDF5 file, a Minari folder or an OGBench npz",
                "x.toml:2: run.sead: unknown key; did you mean 'seed'?",
                "x.toml:3: run.kind: unknown word; did you mean 'offline'?",
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
            Config::parse(GOOD, "x.toml", "x", &sets)
        };
        let config = set("dataset.leave_out", "[[5, 8], [6, 8]]").unwrap();
        assert!(config.dataset.leaves_out(Some((6, 8))));
        assert!(!config.dataset.leaves_out(Some((8, 6))) && !config.dataset.leaves_out(None));
        let config = set("dataset.on_fault", "drop-episode").unwrap();
        assert_eq!(config.dataset.on_fault, OnFault::DropEpisode);
        for (key, value, told) in [
            ("dataset.on_fault", "drop", "drop-episode"),
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
        let places = set("encoder.kind", "place").unwrap().encoder;
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
            Config::parse(GOOD, "x.toml", "x", &sets)
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
        let again = Config::parse(config.resolved(), "x.toml", "other", &[]).unwrap();
        assert_eq!(config, again);
        assert_eq!(config.hash(), again.hash());
        assert_ne!(
            config.hash(),
            parse(&GOOD.replace('3', "4")).unwrap().hash()
        );
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
                Config::load(&path, &[]).unwrap_or_else(|faults| panic!("{faults}"));
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
}
