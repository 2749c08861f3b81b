//! The tables run, maze, topology, and those of the roles.

use crate::reader::Table;
use crate::sections::{Kind, Maze, Run, Supervision, Topology};

const LAYOUTS: [&str; 6] = ["umaze", "medium", "large", "giant", "teleport", "custom"];

/// `[run]`; `stem` is the default name.
pub(super) fn run(t: &mut Table<'_, '_>, stem: &str) -> Run {
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
}

/// `[maze]`.
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

/// `[topology]`.
pub(super) fn topology(t: &mut Table<'_, '_>) -> Topology {
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
}

/// `[actor]`, `[learner]` or `[graph_builder]`.
pub(super) fn supervision(t: &mut Table<'_, '_>) -> Supervision {
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
