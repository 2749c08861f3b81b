//! What happened in an episode, as its trace tells it.

use std::collections::BTreeMap;

use anyhow::Context;
use maze::{FALLEN, Layout};
use serde::Serialize;
use simulator::{Body, Dtype};
use trace::Trace;

use crate::figure::{total, unsigned_zero};

/// No maze is so large (m).
const FAR: f32 = 1e6;

/// A choice of the high level and what became of it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(crate) struct Subgoal {
    /// Control step of the choice.
    pub(crate) step: u32,
    /// Node of the choice.
    pub(crate) node: i32,
    /// The node walked to.
    pub(crate) subgoal_node: i32,
    /// Its probability, where it is a neighbour that was open.
    pub(crate) probability: Option<f32>,
    /// The critic's value; none where nobody estimates it.
    pub(crate) value: Option<f32>,
    /// Whether it was reached; none where the episode ended or the goal came near before.
    pub(crate) reached: Option<bool>,
    /// Control steps to there.
    pub(crate) steps: u32,
}

/// An episode.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(crate) struct Story {
    pub(crate) purpose: String,
    pub(crate) episode: u64,
    pub(crate) run: String,
    pub(crate) seed: u64,
    pub(crate) maze: String,
    pub(crate) actor: u32,
    pub(crate) formica: String,
    pub(crate) config: String,
    pub(crate) simulator: String,
    /// Of the networks and the graph, by name.
    pub(crate) versions: BTreeMap<String, u64>,
    /// `success`, `failure` or `cut off`.
    pub(crate) outcome: &'static str,
    /// Why the trace is cut off.
    pub(crate) cut: Option<String>,
    /// What of it is damaged.
    pub(crate) damage: Vec<String>,
    /// What else is to be known of what it tells, a sentence each.
    pub(crate) notes: Vec<String>,
    /// Control steps.
    pub(crate) steps: usize,
    pub(crate) seconds: f64,
    #[serde(rename = "return")]
    /// None where a reward is no number.
    pub(crate) episode_return: Option<f32>,
    /// Where it began and the goal (m).
    pub(crate) start: [f32; 2],
    pub(crate) goal: [f32; 2],
    /// The way that the torso went, and its least distance to the goal (m), where any place is told.
    pub(crate) walked: f32,
    pub(crate) nearest: Option<f32>,
    /// Times that the ant came to lie on its back, and steps that it lay there.
    pub(crate) falls: usize,
    pub(crate) steps_on_back: usize,
    /// Whether it lay there at the end.
    pub(crate) fell: bool,
    pub(crate) subgoals: Vec<Subgoal>,
    /// Where the torso was at each step that tells a place (m).
    #[serde(skip)]
    pub(crate) path: Vec<[f32; 2]>,
}

impl Story {
    /// Of a trace.
    pub(crate) fn of(trace: &Trace) -> Self {
        let meta = &trace.meta;
        let last = trace.end.iter().map(|end| &end.observation);
        let told = trace.steps.iter().map(|step| &step.observation);
        let told = told.chain(last).map(Vec::as_slice);
        let body = simulators::body(meta.simulator());
        let observations: Vec<(&dyn Body, &[f32])> = (told.clone())
            .filter_map(|observation| Some((body?, observation)))
            .filter(|(body, observation)| observation.len() == width(*body))
            .collect();
        let path = observations.iter().map(|(body, o)| body.place(o));
        let path: Vec<[f32; 2]> = path.filter(|place| is_place(*place)).collect();
        let between = |a: [f32; 2], b: [f32; 2]| (a[0] - b[0]).hypot(a[1] - b[1]);
        let down: Vec<bool> = (observations.iter())
            .map(|(body, o)| body.upright(o) < FALLEN)
            .collect();
        let fallen = |pair: &&[bool]| !pair[0] && pair[1];
        let outcome = match (trace.outcome, &trace.cut) {
            (Some(outcome), None) if outcome.success => "success",
            (Some(_), None) => "failure",
            _ => "cut off",
        };
        Self {
            purpose: meta.purpose.clone(),
            episode: meta.episode_index,
            run: meta.run.clone(),
            seed: meta.seed,
            maze: meta.maze.clone(),
            actor: meta.actor,
            formica: meta.version.clone(),
            config: meta.config_hash.clone(),
            simulator: meta.simulator().to_owned(),
            versions: meta.versions.clone(),
            outcome,
            cut: trace.cut.clone(),
            damage: trace.damage.clone(),
            notes: notes(trace, told.count(), observations.len(), path.len()),
            steps: trace.steps.len(),
            seconds: trace.steps.len() as f64 * f64::from(control_seconds(trace)),
            episode_return: Some(total(trace.steps.iter().map(|step| step.reward)))
                .filter(|sum| sum.is_finite()),
            start: path.first().unwrap_or(&meta.start).map(unsigned_zero),
            goal: meta.goal.map(unsigned_zero),
            walked: total(path.windows(2).map(|pair| between(pair[0], pair[1]))),
            nearest: (path.iter())
                .map(|place| between(*place, meta.goal))
                .filter(|distance| distance.is_finite())
                .reduce(f32::min),
            falls: down.windows(2).filter(fallen).count(),
            steps_on_back: down.iter().filter(|down| **down).count(),
            fell: down.last().copied().unwrap_or(false),
            subgoals: subgoals(trace),
            path,
        }
    }

    /// The exit code of a command that shows it: 0, or 3 where the trace is cut off or damaged.
    pub(crate) fn code(&self) -> u8 {
        let whole = self.cut.is_none() && self.damage.is_empty();
        if whole { 0 } else { 3 }
    }

    /// Subgoals that were reached.
    pub(crate) fn reached(&self) -> usize {
        let reached = |subgoal: &&Subgoal| subgoal.reached == Some(true);
        self.subgoals.iter().filter(reached).count()
    }

    /// Subgoals that were given up.
    pub(crate) fn given_up(&self) -> usize {
        let given_up = |subgoal: &&Subgoal| subgoal.reached == Some(false);
        self.subgoals.iter().filter(given_up).count()
    }
}

/// Values of an observation that is floats.
fn width(body: &dyn Body) -> usize {
    let space = body.spaces().observation;
    if space.dtype == Dtype::F32 {
        space.len()
    } else {
        0
    }
}

/// Simulated time of a step (s).
fn control_seconds(trace: &Trace) -> f32 {
    let spaces = trace.meta.spaces.as_ref();
    spaces.map_or(maze::CONTROL_SECONDS, |spaces| spaces.control_seconds)
}

/// Whether a body may be there: figures of another kind are left out rather than added up.
fn is_place([x, y]: [f32; 2]) -> bool {
    x.abs() <= FAR && y.abs() <= FAR
}

/// What is missing or odd in what a trace tells; `told`: states, of which `read` are of the body's
/// width and `places` have a place.
fn notes(trace: &Trace, told: usize, read: usize, places: usize) -> Vec<String> {
    let mut notes = vec![];
    if let Some(lost) = &trace.recovered {
        notes.push(format!(
            "it was recovered from a trace of which was lost: {lost}"
        ));
    }
    if let Some((first, last)) = gap(trace) {
        notes.push(match first == last {
            true => format!("step {first} is missing"),
            false => format!("steps are missing, the first is {first} and the last {last}"),
        });
    }
    if read < told {
        let other = told - read;
        let name = trace.meta.simulator();
        notes.push(match simulators::body(name) {
            Some(body) => format!(
                "{other} of {told} states do not have the {} values of the simulator '{name}', and \
                 are left out: another simulator's, or damaged",
                width(body)
            ),
            None => format!(
                "this version of formica has no simulator '{}', so that its {told} states are left \
                 out",
                name.escape_debug()
            ),
        });
    }
    if places < read {
        let other = read - places;
        notes.push(format!(
            "{other} of {read} states tell no place within {FAR} m, and are left out of the path"
        ));
    }
    notes
}

/// The first and the last step that are missing before another one.
fn gap(trace: &Trace) -> Option<(u32, u32)> {
    let mut gap: Option<(u32, u32)> = None;
    let mut expected = 0;
    for step in &trace.steps {
        if step.step > expected {
            let first = gap.map_or(expected, |(first, _)| first);
            gap = Some((first, step.step - 1));
        }
        expected = step.step.saturating_add(1);
    }
    gap
}

/// Each choice with the outcome that came before the next one.
fn subgoals(trace: &Trace) -> Vec<Subgoal> {
    let mut outcomes = trace.outcomes.iter().peekable();
    let steps = trace.steps.len() as u32;
    let mut subgoals = vec![];
    for (i, choice) in trace.choices.iter().enumerate() {
        let next = trace.choices.get(i + 1).map_or(u32::MAX, |next| next.step);
        // What came before this choice is of none that is known.
        while outcomes.next_if(|o| o.step <= choice.step).is_some() {}
        let outcome = outcomes.next_if(|o| o.step <= next);
        let position = choice
            .neighbours
            .iter()
            .position(|node| i64::from(*node) == i64::from(choice.subgoal_node));
        let probability = position.and_then(|at| choice.probabilities.get(at));
        subgoals.push(Subgoal {
            step: choice.step,
            node: choice.node,
            subgoal_node: choice.subgoal_node,
            probability: (probability.copied().map(unsigned_zero)).filter(|p| p.is_finite()),
            value: Some(unsigned_zero(choice.value)).filter(|value| value.is_finite()),
            reached: outcome.map(|outcome| outcome.reached),
            steps: match outcome {
                Some(outcome) => outcome.steps,
                None => steps.min(next).saturating_sub(choice.step),
            },
        });
    }
    subgoals
}

/// Places of the graph's nodes (m).
pub(crate) fn nodes(trace: &Trace) -> Vec<[f32; 2]> {
    let graph = &trace.graph;
    let places = graph.x.iter().zip(&graph.y);
    places.map(|(x, y)| [*x, *y]).collect()
}

/// The maze of an episode, by the config that its trace holds, or by its name where the config is
/// lost.
pub(crate) fn layout(trace: &Trace) -> anyhow::Result<Layout> {
    if trace.meta.config_toml.is_empty()
        && let Ok(layout) = Layout::named(&trace.meta.maze)
    {
        return Ok(layout);
    }
    layout_of(&trace.meta.config_toml).context("the config.toml that the trace holds")
}

/// The maze of a config. Of that only `[maze]` is read, so that what other versions wrote can be
/// looked at.
pub(crate) fn layout_of(config: &str) -> anyhow::Result<Layout> {
    let told = "it tells no maze";
    let config: toml::Table = toml::from_str(config).context(told)?;
    let maze = config.get("maze").and_then(toml::Value::as_table);
    let maze = maze.context(told)?;
    let name = maze.get("layout").and_then(toml::Value::as_str);
    let rows = maze.get("rows").and_then(toml::Value::as_array);
    let rows = rows.into_iter().flatten();
    let rows: Vec<String> = rows
        .filter_map(|row| row.as_str().map(str::to_owned))
        .collect();
    Ok(Layout::of(name.context(told)?, &rows)?)
}

#[cfg(test)]
mod tests {
    use maze::OBSERVATION;
    use trace::{Choice, EdgeOutcome, Step};

    use super::*;

    fn choice(step: u32, subgoal_node: i32) -> Choice {
        Choice {
            step,
            node: 1,
            subgoal_node,
            value: f32::NAN,
            neighbours: vec![4, 7],
            probabilities: vec![0.25, 0.75],
            ..Choice::default()
        }
    }

    fn step(x: f32, upside: f32) -> Step {
        let mut observation = vec![0.0; OBSERVATION];
        (observation[0], observation[4]) = (x, upside);
        Step {
            observation,
            reward: 0.5,
            ..Step::default()
        }
    }

    #[test]
    fn choices_have_their_own_outcomes() {
        let outcome = |step, reached| EdgeOutcome {
            step,
            reached,
            steps: 9,
            ..EdgeOutcome::default()
        };
        let trace = Trace {
            steps: vec![step(0.0, 0.0); 50],
            choices: vec![choice(0, 7), choice(10, 9), choice(20, 4), choice(30, 4)],
            // At 10 the first one ends and the second begins; of the third nothing is told.
            outcomes: vec![outcome(10, true), outcome(18, false)],
            ..Trace::default()
        };
        let story = Story::of(&trace);
        let told: Vec<_> = story
            .subgoals
            .iter()
            .map(|s| (s.reached, s.steps, s.probability))
            .collect();
        assert_eq!(
            told,
            [
                (Some(true), 9, Some(0.75)),
                (Some(false), 9, None),
                (None, 10, Some(0.25)),
                (None, 20, Some(0.25)),
            ]
        );
        assert_eq!((story.reached(), story.given_up()), (1, 1));
        assert_eq!(story.subgoals[0].value, None);
    }

    #[test]
    fn falls_are_counted_and_strange_rows_left_out() {
        let mut trace = Trace::default();
        for (x, upside) in [(0.0, 0.0), (3.0, 1.0), (3.0, 1.0), (3.0, 0.0), (7.0, 1.0)] {
            trace.steps.push(step(x, upside));
        }
        trace.steps[2].observation.truncate(3);
        let story = Story::of(&trace);
        assert_eq!((story.falls, story.steps_on_back, story.fell), (2, 2, true));
        assert_eq!((story.walked, story.steps), (7.0, 5));
        assert_eq!(story.episode_return, Some(2.5));
        assert_eq!(story.outcome, "cut off");
    }

    #[test]
    fn what_is_no_place_is_left_out_and_said_so() {
        let mut trace = Trace::default();
        let story = Story::of(&trace);
        assert_eq!((story.walked, story.nearest), (0.0, None));
        assert!(story.walked.is_sign_positive());
        for x in [0.0, 1.0, f32::NAN, f32::INFINITY, 3e38, 2.0] {
            trace.steps.push(step(x, 0.0));
        }
        trace.steps[1].step = 9;
        trace.steps[5].observation = vec![0.0; 111];
        let story = Story::of(&trace);
        assert_eq!((story.walked, story.nearest), (1.0, Some(0.0)));
        let told = story.notes.join("\n");
        assert!(
            told.contains("1 of 6 states do not have the 29 values"),
            "{told}"
        );
        assert!(told.contains("3 of 5 states tell no place"), "{told}");
        assert_eq!(gap(&trace), Some((1, 8)));
        trace.steps[0].reward = f32::NAN;
        assert_eq!(Story::of(&trace).episode_return, None);
    }

    #[test]
    fn states_are_read_as_those_of_their_simulator() {
        let mut trace = Trace::default();
        trace.meta.simulator = "point".to_owned();
        for x in [0.0, 1.0] {
            trace.steps.push(Step {
                observation: vec![x, 2.0, 0.5, 0.5],
                ..Step::default()
            });
        }
        let story = Story::of(&trace);
        assert_eq!(
            (story.walked, &*story.path),
            (1.0, &[[0.0, 2.0], [1.0, 2.0]][..])
        );
        assert!(story.falls == 0 && story.notes.is_empty());
        trace.meta.simulator = "flea".to_owned();
        let story = Story::of(&trace);
        assert!(story.path.is_empty() && story.notes[0].contains("no simulator 'flea'"));
    }

    #[test]
    fn the_maze_is_read_whatever_else_the_config_says() {
        let mut trace = Trace::default();
        assert!(layout(&trace).is_err());
        trace.meta.config_toml = "[future]\nx = 1\n[maze]\nlayout = \"large\"\nrows = []\n".into();
        let large = Layout::named("large").unwrap();
        assert_eq!(layout(&trace).unwrap().boxes(), large.boxes());
        trace.meta.config_toml = "[maze]\nlayout = \"nowhere\"\n".into();
        assert!(layout(&trace).is_err());
    }
}
