//! Reads every table and key, with its default and its range.

mod data;
mod play;
mod training;
mod walker;

use crate::reader::{Document, Table};
use crate::sections::{Config, Dataset, Kind, Maze, Misfit, OnFault, Run, Supervision, Topology};

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
        let name = t.run_name("name", stem);
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
            deterministic: t.flag("deterministic", false),
            checkpoint_seconds: t.number("checkpoint_seconds", 10.0, [0.0, 86_400.0]),
        }
    });
    let offline = run.kind == Kind::Offline;
    let maze = d.table("maze", |t| {
        let layout = t.word("layout", "medium", &LAYOUTS);
        let rows: Vec<String> = t.value("rows", vec![], |_| Ok(()));
        if layout == "custom" && rows.is_empty() {
            t.absent(
                "rows",
                "missing; layout = \"custom\" needs the rows of its map, as in rows = [\"111\", ...]",
            );
        }
        if layout != "custom" && !rows.is_empty() {
            let message = format!("the layout '{layout}' has rows of its own; use layout = \"custom\"");
            t.fault("rows", message);
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
        ["actor", "learner", "graph_builder"].map(|role| d.table(role, supervision));
    let has_collect = d.has("collect");
    let dataset = if offline {
        data::dataset(d, has_collect)
    } else {
        Dataset {
            path: String::new(),
            leave_out: vec![],
            fit: Misfit::Refuse,
            on_fault: OnFault::Refuse,
        }
    };
    let collect = (offline && has_collect).then(|| data::collect(d, &maze.layout));
    let encoder = training::encoder(d, offline);
    let graph = training::graph(d, offline);
    let low = training::low(d, offline);
    let high = training::high(d, offline);
    let rollouts = play::rollouts(d, offline);
    let execution = play::execution(d, offline);
    let evaluation = play::evaluation(d, offline, &maze.layout);
    let traces = play::traces(d, offline);
    let walker = walker::walker(d, !offline);
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
        portable: String::new(),
    }
}

/// Tables of the other kind of run are read from nothing: their defaults stand.
fn optional_table<T>(
    d: &mut Document<'_>,
    wanted: bool,
    name: &'static str,
    read: impl FnOnce(&mut Table<'_, '_>) -> T,
) -> T {
    if wanted {
        d.table(name, read)
    } else {
        Document::new("", &[], &[]).table(name, read)
    }
}

fn supervision(t: &mut Table<'_, '_>) -> Supervision {
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
