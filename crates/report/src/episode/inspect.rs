//! An episode as text, for `formica inspect`.

use std::fmt::Write;
use std::path::Path;

use plot::number::fixed;
use plot::table::aligned;
use trace::Trace;

use super::layout::layout;
use super::subgoals::Subgoal;
use super::summary::EpisodeSummary;
use super::svg_map::{self, nodes};
use super::text_map::text_map;

/// The map of an episode as SVG, with its outcome.
///
/// # Errors
/// The config in the trace has no valid maze.
pub fn svg(trace: &Trace, summary: &EpisodeSummary) -> anyhow::Result<String> {
    let title = format!("Episode {} of {}", summary.episode, summary.run);
    let subtitle = format!(
        "{} in {} steps; {} of {} subgoals reached",
        summary.outcome,
        summary.steps,
        summary.reached(),
        summary.subgoals.len()
    );
    svg_map::svg(trace, summary, title, subtitle)
}

/// A trace as text: what it is of, outcome, subgoals, map.
pub fn text(path: &Path, trace: &Trace, summary: &EpisodeSummary) -> String {
    let mut text = String::new();
    let with_graph = !nodes(trace).is_empty();
    let lines = origin(path, summary).into_iter();
    for line in lines.chain(outcome(summary, with_graph)) {
        let _ = writeln!(text, "{line}");
    }
    if !summary.subgoals.is_empty() {
        text += "\n";
        text += &aligned(&subgoals(&summary.subgoals));
    }
    let map = layout(trace).ok();
    if let Some(map) = map.and_then(|layout| text_map(&layout, &nodes(trace), summary)) {
        let _ = writeln!(text, "\n{map}");
    }
    text
}

/// Lines about where a trace comes from.
fn origin(path: &Path, s: &EpisodeSummary) -> [String; 3] {
    [
        path.display().to_string(),
        format!(
            "episode {} of the run {} ({}, actor {}), maze {}, seed {}",
            s.episode,
            named(&s.run),
            named(&s.purpose),
            s.actor,
            named(&s.maze),
            s.seed
        ),
        format!(
            "simulator {}; versions: {}; config {}, formica {}",
            named(&s.simulator),
            versions(s),
            named(&s.config),
            named(&s.formica)
        ),
    ]
}

/// Lines about what happened.
fn outcome(s: &EpisodeSummary, with_graph: bool) -> Vec<String> {
    let how = match s.outcome {
        "success" => "the goal reached",
        "failure" => "the goal not reached",
        _ => "not known how it ended",
    };
    let episode_return = s.episode_return.and_then(|value| short(value.into()));
    let episode_return = episode_return.unwrap_or("not known".to_owned());
    let mut lines = vec![format!(
        "{}: {how} in {} steps ({:.1} s), return {episode_return}",
        s.outcome, s.steps, s.seconds
    )];
    if let Some(reason) = &s.cut {
        lines.push(format!("the trace is cut off: {reason}"));
    }
    let damage = s.damage.iter();
    lines.extend(damage.map(|damage| format!("the trace is damaged: {damage}")));
    lines.extend(s.notes.iter().cloned());
    lines.extend([
        format!(
            "from {} towards {}: {}",
            position(s.start),
            position(s.goal),
            distances(s)
        ),
        format!(
            "{} falls, {} steps on the back{}",
            s.falls,
            s.steps_on_back,
            if s.fell { ", and so at the end" } else { "" }
        ),
    ]);
    // Of an algorithm without a graph there is nothing to say.
    if with_graph || !s.subgoals.is_empty() {
        lines.push(format!(
            "{} subgoals: {} reached, {} given up",
            s.subgoals.len(),
            s.reached(),
            s.given_up()
        ));
    }
    lines
}

/// The versions that an episode was played with.
pub(super) fn versions(summary: &EpisodeSummary) -> String {
    let versions = summary.versions.iter();
    let versions: Vec<String> = versions
        .map(|(name, n)| format!("{} {n}", named(name)))
        .collect();
    match versions.is_empty() {
        true => "-".to_owned(),
        false => versions.join(", "),
    }
}

/// A name from a trace, which may be empty or contain control characters.
pub(super) fn named(name: &str) -> String {
    match name {
        "" => "-".to_owned(),
        name => name.escape_debug().to_string(),
    }
}

fn position([x, y]: [f32; 2]) -> String {
    match (fixed(x.into(), 1), fixed(y.into(), 1)) {
        (Some(x), Some(y)) => format!("({x}, {y})"),
        _ => "a place that is not known".to_owned(),
    }
}

/// Distance walked, and least distance to the goal.
fn distances(summary: &EpisodeSummary) -> String {
    let walked = fixed(summary.walked.into(), 1);
    let nearest = summary.nearest.and_then(|nearest| fixed(nearest.into(), 2));
    match (walked, nearest) {
        (Some(walked), Some(nearest)) => {
            format!("{walked} m walked, {nearest} m from the goal at the nearest")
        }
        _ => "no place of the ant is known".to_owned(),
    }
}

/// A number in its shortest exact form.
pub(super) fn short(value: f64) -> Option<String> {
    // Negative zero is zero.
    value
        .is_finite()
        .then(|| ((value + 0.0) as f32).to_string())
}

/// A row for each subgoal, after the header.
fn subgoals(subgoals: &[Subgoal]) -> Vec<Vec<String>> {
    let header = [
        "step",
        "at node",
        "to node",
        "probability",
        "value",
        "outcome",
        "steps",
    ];
    let number = |value: Option<f32>| {
        let value = value.and_then(|value| fixed(value.into(), 2));
        value.unwrap_or("-".to_owned())
    };
    let rows = subgoals.iter().map(|subgoal| {
        vec![
            subgoal.step.to_string(),
            subgoal.node.to_string(),
            subgoal.subgoal_node.to_string(),
            number(subgoal.probability),
            number(subgoal.value),
            match subgoal.reached {
                Some(true) => "reached",
                Some(false) => "given up",
                None => "-",
            }
            .to_owned(),
            subgoal.steps.to_string(),
        ]
    });
    let header = header.map(str::to_owned).to_vec();
    std::iter::once(header).chain(rows).collect()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use trace::{Choice, EdgeOutcome, End, Step};

    use super::*;
    use crate::episode::overview::overview;

    fn any_value() -> impl Strategy<Value = f32> {
        prop_oneof![
            any::<f32>(),
            -10.0_f32..10.0,
            Just(-0.0),
            Just(f32::NAN),
            Just(f32::INFINITY),
            Just(f32::MAX),
        ]
    }

    fn any_step() -> impl Strategy<Value = Step> {
        let values = |most| prop::collection::vec(any_value(), most);
        let observation = prop_oneof![values(29..30), values(0..40)];
        (any::<u32>(), any_value(), observation, values(0..9)).prop_map(
            |(step, reward, observation, action)| Step {
                step: step % 50,
                reward,
                observation,
                action,
                ..Step::default()
            },
        )
    }

    proptest! {
        #[test]
        fn any_trace_has_a_text_with_finite_numbers(
            steps in prop::collection::vec(any_step(), 0..20),
            value in any_value(),
            numbers in prop::collection::vec(any::<u32>(), 4),
            cut in any::<bool>(),
        ) {
            let mut trace = Trace { steps, ..Trace::default() };
            trace.meta.goal = [value, 3.0];
            trace.meta.success_radius = value;
            trace.meta.maze = "umaze".to_owned();
            trace.meta.run = "a\u{1b}[31m".to_owned();
            trace.cut = cut.then(|| "it ends".to_owned());
            trace.graph.x = vec![value, 1.0];
            trace.graph.y = vec![1.0, value];
            trace.graph.from = numbers.clone();
            trace.graph.to = vec![0, 1, 2, 3];
            let [step, node, subgoal, steps] = [0, 1, 2, 3].map(|i| numbers[i]);
            trace.choices = vec![Choice {
                step,
                node: node as i32,
                subgoal_node: subgoal as i32,
                value,
                neighbours: vec![subgoal],
                probabilities: vec![value],
                ..Choice::default()
            }];
            trace.outcomes = vec![EdgeOutcome { step, steps, ..EdgeOutcome::default() }];
            trace.end = Some(End { observation: vec![value; 29], ..End::default() });
            let summary = EpisodeSummary::of(&trace);
            let text = text(Path::new("t.mcap"), &trace, &summary);
            let text = text + &overview(&[("t.mcap".into(), Ok(summary.clone()))]);
            for word in ["NaN", "inf", "-0.0 ", "-0 ", "\u{1b}"] {
                prop_assert!(!text.contains(word), "{}:\n{}", word, text);
            }
            prop_assert!(serde_json::to_string(&summary).is_ok());
            let drawn = svg(&trace, &summary);
            prop_assert!(!drawn.unwrap().contains("NaN"));
        }
    }
}
