//! Reads every table and key, with its default and its range.

mod data;
mod optional;
mod play;
mod run;

use crate::reader::Document;
use crate::registry::Registry;
use crate::sections::{Config, Dataset, Misfit, OnFault};

pub(crate) fn read(d: &mut Document<'_>, stem: &str, registry: &dyn Registry) -> Config {
    let run = d.table("run", |t| run::run(t, stem, registry));
    let offline = registry.is_offline(&run.algorithm);
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
        offline,
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
