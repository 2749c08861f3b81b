//! What is played with what was trained: `[rollouts]`, `[evaluation]`, `[traces]`.

use crate::key::OnResume::{self, Free, Protocol};
use crate::read::optional::optional_table;
use crate::reader::Document;
use crate::sections::{Evaluation, Rollouts, Traces};

pub(super) fn rollouts(d: &mut Document<'_>, wanted: bool) -> Rollouts {
    optional_table(d, wanted, "rollouts", |t| Rollouts {
        seconds: t
            .on_resume(OnResume::Rollouts)
            .number("seconds", 15.0, [0.0, 86_400.0]),
        test_every: t
            .on_resume(OnResume::Rollouts)
            .count("test_every", 8, [0, 1_000_000]),
        rounds: t
            .on_resume(OnResume::Rollouts)
            .count("rounds", 4, [0, 100_000]),
        episodes: t
            .on_resume(OnResume::Rollouts)
            .count("episodes", 64, [1, 1024]),
    })
}

pub(super) fn evaluation(d: &mut Document<'_>, wanted: bool, layout: &str) -> Evaluation {
    optional_table(d, wanted, "evaluation", |t| Evaluation {
        episodes: t
            .on_resume(OnResume::Episodes)
            .count("episodes", 100, [1, 1024]),
        max_steps: t.on_resume(Protocol).count(
            "max_steps",
            if layout == "umaze" { 700 } else { 1000 },
            [1, 1_000_000],
        ),
        success_radius: t
            .on_resume(Protocol)
            .number("success_radius", 0.5, [0.01, 10.0]),
    })
}

pub(super) fn traces(d: &mut Document<'_>, wanted: bool) -> Traces {
    optional_table(d, wanted, "traces", |t| Traces {
        evaluation: t.on_resume(Free).flag("evaluation", true),
        training_every: t
            .on_resume(Free)
            .count("training_every", 0, [0, 1_000_000_000]),
    })
}
