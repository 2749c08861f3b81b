//! Reads every table and key, with its default and its range.

mod data;
mod play;

use crate::reader::{Document, Table};
use crate::registry::Registry;
use crate::resume::OnResume::{Free, Rollouts};
use crate::sections::{Config, Dataset, Maze, Misfit, OnFault, Run, Supervision, Topology};

const LAYOUTS: [&str; 6] = ["umaze", "medium", "large", "giant", "teleport", "custom"];

pub(crate) fn read(d: &mut Document<'_>, stem: &str, registry: &dyn Registry) -> Config {
    let run = d.table("run", |t| run(t, stem, registry));
    let offline = registry.is_offline(&run.algorithm);
    let maze = d.table("maze", maze);
    let topology = d.table("topology", topology);
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
    let settings = registry.read(&run.algorithm, d);
    let rollouts = play::rollouts(d, offline);
    let evaluation = play::evaluation(d, offline, &maze.layout);
    let traces = play::traces(d, offline);
    d.finish();
    Config {
        run,
        maze,
        topology,
        actor,
        learner,
        graph_builder,
        dataset,
        collect,
        rollouts,
        evaluation,
        traces,
        settings,
        resolved: String::new(),
        portable: String::new(),
        keys: vec![],
    }
}

fn run(t: &mut Table<'_, '_>, stem: &str, registry: &dyn Registry) -> Run {
    // The folder keeps its name; `mv` gives it another one.
    let name = t.run_name("name", stem);
    let seed = t.count("seed", 0, [0, u32::MAX as usize]) as u64;
    t.replaced(
        "kind",
        "was replaced in version 0.2: write algorithm = \"lg-h-ppo\" for \"offline\", and \
         algorithm = \"walker\" for \"walker\"",
    );
    let mut one_of = |key, names: Vec<&'static str>| {
        let default = names.first().copied().unwrap_or_default();
        t.word(key, default, &names)
    };
    Run {
        name,
        seed,
        algorithm: one_of("algorithm", registry.algorithms()),
        simulator: one_of("simulator", registry.simulators()),
        deterministic: t.flag("deterministic", false),
        checkpoint_seconds: t
            .on_resume(Free)
            .number("checkpoint_seconds", 10.0, [0.0, 86_400.0]),
    }
}

fn maze(t: &mut Table<'_, '_>) -> Maze {
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
}

fn topology(t: &mut Table<'_, '_>) -> Topology {
    let actors = t.on_resume(Free).count("actors", 2, [1, 32]);
    let max_actors = t
        .on_resume(Free)
        .count("max_actors", 8.max(actors), [1, 64]);
    if max_actors < actors {
        t.fault(
            "max_actors",
            format!("{max_actors} is less than the {actors} actors"),
        );
    }
    Topology {
        actors,
        max_actors,
        window: t.on_resume(Free).count("window", 8, [1, 64]),
        // What is too old is not learned from, which steers like the number of actors does.
        max_policy_lag: t
            .on_resume(Rollouts)
            .count("max_policy_lag", 200, [1, 1_000_000]),
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
        Document::new("", &[], &[], &[]).table(name, read)
    }
}

fn supervision(t: &mut Table<'_, '_>) -> Supervision {
    let day = 86_400.0;
    Supervision {
        restarts: t.on_resume(Free).count("restarts", 5, [0, 100_000]),
        window_seconds: t.on_resume(Free).number("window_seconds", 60.0, [1.0, day]),
        pause_seconds: t.on_resume(Free).number("pause_seconds", 0.5, [0.0, day]),
        longest_pause_seconds: t
            .on_resume(Free)
            .number("longest_pause_seconds", 30.0, [0.0, day]),
        hung_seconds: t.on_resume(Free).number("hung_seconds", 10.0, [2.0, day]),
        start_seconds: t.on_resume(Free).number("start_seconds", 150.0, [2.0, day]),
        stuck_seconds: t.on_resume(Free).number("stuck_seconds", 120.0, [2.0, day]),
    }
}
