//! Reads every table and key, with its default and its range.

mod data;
mod optional;
mod play;
mod run;
mod training;
mod walker;

use crate::reader::Document;
use crate::sections::{Config, Dataset, Kind, Misfit, OnFault};

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

/// Reads a run file; `stem` is the default name of the run.
pub(crate) fn read(d: &mut Document<'_>, stem: &str) -> Config {
    let run = d.table("run", |t| run::run(t, stem));
    let offline = run.kind == Kind::Offline;
    let maze = d.table("maze", run::maze);
    let topology = d.table("topology", run::topology);
    let [actor, learner, graph_builder] =
        ["actor", "learner", "graph_builder"].map(|role| d.table(role, run::supervision));
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
