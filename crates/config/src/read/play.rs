//! What is played with what was trained: `[rollouts]`, `[execution]`, `[evaluation]`, `[traces]`.

use crate::read::optional::optional_table;
use crate::reader::Document;
use crate::sections::{Evaluation, Execution, Rollouts, Traces};

pub(super) fn rollouts(d: &mut Document<'_>, wanted: bool) -> Rollouts {
    optional_table(d, wanted, "rollouts", |t| Rollouts {
        seconds: t.number("seconds", 15.0, [0.0, 86_400.0]),
        test_every: t.count("test_every", 8, [0, 1_000_000]),
        rounds: t.count("rounds", 4, [0, 100_000]),
        episodes: t.count("episodes", 64, [1, 1024]),
    })
}

pub(super) fn execution(d: &mut Document<'_>, wanted: bool) -> Execution {
    optional_table(d, wanted, "execution", |t| Execution {
        reached_radius: t.number("reached_radius", 0.75, [0.1, 10.0]),
        goal_radius: t.number("goal_radius", 2.5, [0.0, 100.0]),
        look_ahead: t.count("look_ahead", 2, [1, 16]),
        timeout_factor: t.number("timeout_factor", 2.0, [1.0, 100.0]),
        max_edge_steps: t.count("max_edge_steps", 40, [1, 10_000]),
    })
}

pub(super) fn evaluation(d: &mut Document<'_>, wanted: bool, layout: &str) -> Evaluation {
    optional_table(d, wanted, "evaluation", |t| Evaluation {
        episodes: t.count("episodes", 100, [1, 1024]),
        max_steps: t.count(
            "max_steps",
            if layout == "umaze" { 700 } else { 1000 },
            [1, 1_000_000],
        ),
        success_radius: t.number("success_radius", 0.5, [0.01, 10.0]),
    })
}

pub(super) fn traces(d: &mut Document<'_>, wanted: bool) -> Traces {
    optional_table(d, wanted, "traces", |t| Traces {
        evaluation: t.flag("evaluation", true),
        training_every: t.count("training_every", 0, [0, 1_000_000_000]),
    })
}
