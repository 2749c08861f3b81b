//! What a trace tells, for people and for programs.

use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::ensure;
use trace::Trace;

use crate::figure::figure;
use crate::floor_plan::floor_plan;
use crate::outputs::{self, Force};
use crate::story::{self, Story, Subgoal};
use crate::table::aligned;
use crate::traces::{self, Named};
use crate::{episode_picture, replay};

#[derive(clap::Args)]
pub(crate) struct Args {
    /// Traces, folders of them, or runs by name or folder
    #[arg(required = true)]
    paths: Vec<PathBuf>,
    /// For programs: an object for a trace, an array for several
    #[arg(long)]
    json: bool,
    /// Write the picture of a trace: maze, graph, chosen nodes, the path walked
    #[arg(long, value_name = "SVG")]
    picture: Option<PathBuf>,
    #[command(flatten)]
    force: Force,
}

/// `formica inspect`: exit code 1 where a trace cannot be read, 3 where one is cut off or damaged.
pub(crate) fn run(args: &Args) -> anyhow::Result<ExitCode> {
    if let [given] = &*args.paths
        && let Named::File(path) = traces::find(given)?
    {
        return inspect(&path, args);
    }
    ensure!(
        args.picture.is_none(),
        "--picture draws one trace; name its file, or see `formica report` for a run's"
    );
    let paths = traces::all(&args.paths)?;
    let stories: Vec<(PathBuf, anyhow::Result<Story>)> = paths
        .into_iter()
        .map(|path| {
            let story = trace::read(&path).map(|trace| Story::of(&trace));
            (path, story.map_err(Into::into))
        })
        .collect();
    if args.json {
        say!("{}", serde_json::to_string_pretty(&json(&stories)?)?);
    } else {
        crate::output::text(overview(&stories));
    }
    let codes = stories.iter().map(|(_, story)| match story {
        Ok(story) => story.code(),
        Err(_) => 1,
    });
    Ok(ExitCode::from(replay::worst(codes)))
}

fn inspect(path: &Path, args: &Args) -> anyhow::Result<ExitCode> {
    let trace = trace::read(path)?;
    let story = Story::of(&trace);
    if let Some(picture) = &args.picture {
        draw(&trace, &story, picture, args.force)?;
    }
    if args.json {
        say!("{}", serde_json::to_string_pretty(&story)?);
    } else {
        crate::output::text(told(path, &trace, &story));
    }
    Ok(ExitCode::from(story.code()))
}

fn draw(trace: &Trace, story: &Story, path: &Path, force: Force) -> anyhow::Result<()> {
    let title = format!("Episode {} of {}", story.episode, story.run);
    let subtitle = format!(
        "{} in {} steps; {} of {} subgoals reached",
        story.outcome,
        story.steps,
        story.reached(),
        story.subgoals.len()
    );
    let picture = episode_picture::svg(trace, story, title, subtitle)?;
    outputs::write(path, force.existing(), picture.as_bytes())
}

/// A trace in words.
fn told(path: &Path, trace: &Trace, story: &Story) -> String {
    let mut text = String::new();
    let mut line = |told: String| {
        let _ = writeln!(text, "{told}");
    };
    let s = story;
    line(path.display().to_string());
    line(format!(
        "episode {} of the run {} ({}, actor {}), maze {}, seed {}",
        s.episode,
        named(&s.run),
        named(&s.purpose),
        s.actor,
        named(&s.maze),
        s.seed
    ));
    line(format!(
        "simulator {}; versions: {}; config {}, formica {}",
        named(&s.simulator),
        versions(s),
        named(&s.config),
        named(&s.formica)
    ));
    let how = match s.outcome {
        "success" => "the goal reached",
        "failure" => "the goal not reached",
        _ => "not known how it ended",
    };
    let return_told = s.episode_return.and_then(|value| short(value.into()));
    let return_told = return_told.unwrap_or("not known".to_owned());
    line(format!(
        "{}: {how} in {} steps ({:.1} s), return {return_told}",
        s.outcome, s.steps, s.seconds
    ));
    if let Some(reason) = &s.cut {
        line(format!("the trace is cut off: {reason}"));
    }
    for damage in &s.damage {
        line(format!("the trace is damaged: {damage}"));
    }
    s.notes.iter().cloned().for_each(&mut line);
    line(format!(
        "from {} towards {}: {}",
        place(s.start),
        place(s.goal),
        way(s)
    ));
    line(format!(
        "{} falls, {} steps on the back{}",
        s.falls,
        s.steps_on_back,
        if s.fell { ", and so at the end" } else { "" }
    ));
    let nodes = story::nodes(trace);
    // Of an algorithm without a graph there is nothing to say.
    if !nodes.is_empty() || !s.subgoals.is_empty() {
        line(format!(
            "{} subgoals: {} reached, {} given up",
            s.subgoals.len(),
            s.reached(),
            s.given_up()
        ));
    }
    if !s.subgoals.is_empty() {
        text += "\n";
        text += &aligned(&subgoals(&s.subgoals));
    }
    let plan = story::layout(trace).ok();
    if let Some(plan) = plan.and_then(|layout| floor_plan(&layout, &nodes, story)) {
        let _ = writeln!(text, "\n{plan}");
    }
    text
}

/// The versions that an episode was played with.
fn versions(story: &Story) -> String {
    let versions = story.versions.iter();
    let versions: Vec<String> = versions
        .map(|(name, n)| format!("{} {n}", named(name)))
        .collect();
    match versions.is_empty() {
        true => "-".to_owned(),
        false => versions.join(", "),
    }
}

/// A name from a trace; some have none, and any may hold what a terminal would obey.
fn named(name: &str) -> String {
    match name {
        "" => "-".to_owned(),
        name => name.escape_debug().to_string(),
    }
}

fn place([x, y]: [f32; 2]) -> String {
    match (figure(x.into(), 1), figure(y.into(), 1)) {
        (Some(x), Some(y)) => format!("({x}, {y})"),
        _ => "a place that is not known".to_owned(),
    }
}

/// How far it walked, and how near it came.
fn way(story: &Story) -> String {
    let walked = figure(story.walked.into(), 1);
    let nearest = story.nearest.and_then(|nearest| figure(nearest.into(), 2));
    match (walked, nearest) {
        (Some(walked), Some(nearest)) => {
            format!("{walked} m walked, {nearest} m from the goal at the nearest")
        }
        _ => "no place of the ant is known".to_owned(),
    }
}

/// A figure as short as it is exact.
fn short(value: f64) -> Option<String> {
    // Negative zero is zero.
    value
        .is_finite()
        .then(|| ((value + 0.0) as f32).to_string())
}

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
        let value = value.and_then(|value| figure(value.into(), 2));
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

/// A line for each trace, and what they come to.
fn overview(stories: &[(PathBuf, anyhow::Result<Story>)]) -> String {
    let header = [
        "trace", "purpose", "outcome", "steps", "return", "subgoals", "reached", "given up",
        "falls", "versions",
    ];
    let mut lines = vec![header.map(str::to_owned).to_vec()];
    let mut notes = String::new();
    for (path, story) in stories {
        let name = path.display().to_string();
        if let Ok(Story { damage, .. }) = story
            && let Some(told) = damage.first()
        {
            let _ = writeln!(notes, "damaged: {name}: {told}");
        }
        match story {
            Ok(s) => lines.push(vec![
                name,
                named(&s.purpose),
                s.outcome.to_owned(),
                s.steps.to_string(),
                s.episode_return
                    .and_then(|value| short(value.into()))
                    .unwrap_or("-".to_owned()),
                s.subgoals.len().to_string(),
                s.reached().to_string(),
                s.given_up().to_string(),
                s.falls.to_string(),
                versions(s),
            ]),
            Err(error) => {
                let _ = writeln!(notes, "unreadable: {error:#}");
            }
        }
    }
    let read: Vec<&Story> = stories
        .iter()
        .filter_map(|(_, s)| s.as_ref().ok())
        .collect();
    let count = |outcome: &str| read.iter().filter(|s| s.outcome == outcome).count();
    let steps: usize = read.iter().map(|story| story.steps).sum();
    let mut text = aligned(&lines);
    let _ = writeln!(
        text,
        "\n{} traces: {} successes, {} failures, {} cut off, {} unreadable; {steps} steps",
        stories.len(),
        count("success"),
        count("failure"),
        count("cut off"),
        stories.len() - read.len()
    );
    text + &notes
}

fn json(stories: &[(PathBuf, anyhow::Result<Story>)]) -> anyhow::Result<serde_json::Value> {
    let of = |(path, story): &(PathBuf, anyhow::Result<Story>)| {
        let mut value = match story {
            Ok(story) => serde_json::to_value(story)?,
            Err(error) => serde_json::json!({ "unreadable": format!("{error:#}") }),
        };
        value["trace"] = path.display().to_string().into();
        anyhow::Ok(value)
    };
    let all: anyhow::Result<Vec<_>> = stories.iter().map(of).collect();
    Ok(all?.into())
}

#[cfg(test)]
mod tests {
    use super::*;

    use proptest::prelude::*;
    use trace::{Choice, EdgeOutcome, End, Step};

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
        fn whatever_a_trace_says_is_told_in_figures_that_are_some(
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
            let story = Story::of(&trace);
            let text = told(Path::new("t.mcap"), &trace, &story);
            let text = text + &overview(&[("t.mcap".into(), Ok(story.clone()))]);
            for word in ["NaN", "inf", "-0.0 ", "-0 ", "\u{1b}"] {
                prop_assert!(!text.contains(word), "{}:\n{}", word, text);
            }
            prop_assert!(serde_json::to_string(&story).is_ok());
            let drawn = episode_picture::svg(&trace, &story, String::new(), String::new());
            prop_assert!(!drawn.unwrap().contains("NaN"));
        }
    }
}
