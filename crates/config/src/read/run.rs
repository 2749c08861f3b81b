//! What every run has: `[run]`, `[maze]`, `[topology]`, and how its processes are watched.

use crate::key::OnResume::{Free, Rollouts};
use crate::registry::Registry;
use crate::sections::{Maze, Run, Supervision, Topology};
use crate::table::Table;

const LAYOUTS: [&str; 6] = ["umaze", "medium", "large", "giant", "teleport", "custom"];

pub(super) fn run(t: &mut Table<'_, '_>, stem: &str, registry: &dyn Registry) -> Run {
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

pub(super) fn maze(t: &mut Table<'_, '_>) -> Maze {
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

pub(super) fn topology(t: &mut Table<'_, '_>) -> Topology {
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

pub(super) fn supervision(t: &mut Table<'_, '_>) -> Supervision {
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
