//! Summary of an episode.

use std::collections::BTreeMap;

use maze::FALLEN;
use plot::number::{sum, unsigned_zero};
use serde::Serialize;
use simulator::Body;
use trace::Trace;

use super::notes::{FAR, notes, width};
use super::subgoals::{Subgoal, subgoals};

/// Summary of an episode.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct EpisodeSummary {
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
    /// Why the trace is truncated.
    pub(crate) cut: Option<String>,
    /// Damaged parts.
    pub(crate) damage: Vec<String>,
    /// Sentences about missing and unusable data.
    pub(crate) notes: Vec<String>,
    /// Control steps.
    pub(crate) steps: usize,
    pub(crate) seconds: f64,
    /// `None` if a reward is not finite.
    #[serde(rename = "return")]
    pub(crate) episode_return: Option<f32>,
    /// Start and goal (m).
    pub(crate) start: [f32; 2],
    pub(crate) goal: [f32; 2],
    /// Distance that the torso moved, and its least distance to the goal (m); `None` without positions.
    pub(crate) walked: f32,
    pub(crate) nearest: Option<f32>,
    /// Times that the ant fell on its back, and steps that it lay there.
    pub(crate) falls: usize,
    pub(crate) steps_on_back: usize,
    /// Whether it lay on its back at the end.
    pub(crate) fell: bool,
    pub(crate) subgoals: Vec<Subgoal>,
    /// Position of the torso at each step that has one (m).
    #[serde(skip)]
    pub(crate) path: Vec<[f32; 2]>,
}

impl EpisodeSummary {
    /// Summary of a trace.
    pub fn of(trace: &Trace) -> Self {
        let meta = &trace.meta;
        let last = trace.end.iter().map(|end| &end.observation);
        let states = trace.steps.iter().map(|step| &step.observation);
        let states = states.chain(last).map(Vec::as_slice);
        let body = simulators::body(meta.simulator());
        let observations: Vec<(&dyn Body, &[f32])> = (states.clone())
            .filter_map(|observation| Some((body?, observation)))
            .filter(|(body, observation)| observation.len() == width(*body))
            .collect();
        let path = observations.iter().map(|(body, o)| body.place(o));
        let path: Vec<[f32; 2]> = path.filter(|place| is_position(*place)).collect();
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
            notes: notes(trace, states.count(), observations.len(), path.len()),
            steps: trace.steps.len(),
            seconds: trace.steps.len() as f64 * f64::from(control_seconds(trace)),
            episode_return: Some(sum(trace.steps.iter().map(|step| step.reward)))
                .filter(|value| value.is_finite()),
            start: path.first().unwrap_or(&meta.start).map(unsigned_zero),
            goal: meta.goal.map(unsigned_zero),
            walked: sum(path.windows(2).map(|pair| between(pair[0], pair[1]))),
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

    /// Whether the trace is neither truncated nor damaged.
    pub fn is_whole(&self) -> bool {
        self.cut.is_none() && self.damage.is_empty()
    }

    /// Number of subgoals that were reached.
    pub(crate) fn reached(&self) -> usize {
        let reached = |subgoal: &&Subgoal| subgoal.reached == Some(true);
        self.subgoals.iter().filter(reached).count()
    }

    /// Number of subgoals that were given up.
    pub(crate) fn given_up(&self) -> usize {
        let given_up = |subgoal: &&Subgoal| subgoal.reached == Some(false);
        self.subgoals.iter().filter(given_up).count()
    }
}

/// Simulated time of a step (s).
fn control_seconds(trace: &Trace) -> f32 {
    let spaces = trace.meta.spaces.as_ref();
    spaces.map_or(maze::CONTROL_SECONDS, |spaces| spaces.control_seconds)
}

/// Whether a body can be at a position. Others are left out of sums.
fn is_position([x, y]: [f32; 2]) -> bool {
    x.abs() <= FAR && y.abs() <= FAR
}

#[cfg(test)]
mod tests {
    use maze::OBSERVATION;
    use trace::{Choice, EdgeOutcome, Step};

    use super::*;
    use crate::episode::notes::gap;

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
            // At 10 the first one ends and the second starts. The third has no outcome.
            outcomes: vec![outcome(10, true), outcome(18, false)],
            ..Trace::default()
        };
        let summary = EpisodeSummary::of(&trace);
        let outcomes: Vec<_> = summary
            .subgoals
            .iter()
            .map(|s| (s.reached, s.steps, s.probability))
            .collect();
        assert_eq!(
            outcomes,
            [
                (Some(true), 9, Some(0.75)),
                (Some(false), 9, None),
                (None, 10, Some(0.25)),
                (None, 20, Some(0.25)),
            ]
        );
        assert_eq!((summary.reached(), summary.given_up()), (1, 1));
        assert_eq!(summary.subgoals[0].value, None);
    }

    #[test]
    fn falls_are_counted_and_short_rows_left_out() {
        let mut trace = Trace::default();
        for (x, upside) in [(0.0, 0.0), (3.0, 1.0), (3.0, 1.0), (3.0, 0.0), (7.0, 1.0)] {
            trace.steps.push(step(x, upside));
        }
        trace.steps[2].observation.truncate(3);
        let summary = EpisodeSummary::of(&trace);
        assert_eq!(
            (summary.falls, summary.steps_on_back, summary.fell),
            (2, 2, true)
        );
        assert_eq!((summary.walked, summary.steps), (7.0, 5));
        assert_eq!(summary.episode_return, Some(2.5));
        assert_eq!(summary.outcome, "cut off");
    }

    #[test]
    fn impossible_positions_are_left_out_with_a_note() {
        let mut trace = Trace::default();
        let summary = EpisodeSummary::of(&trace);
        assert_eq!((summary.walked, summary.nearest), (0.0, None));
        assert!(summary.walked.is_sign_positive());
        for x in [0.0, 1.0, f32::NAN, f32::INFINITY, 3e38, 2.0] {
            trace.steps.push(step(x, 0.0));
        }
        trace.steps[1].step = 9;
        trace.steps[5].observation = vec![0.0; 111];
        let summary = EpisodeSummary::of(&trace);
        assert_eq!((summary.walked, summary.nearest), (1.0, Some(0.0)));
        let notes = summary.notes.join("\n");
        assert!(
            notes.contains("1 of 6 states do not have the 29 values"),
            "{notes}"
        );
        assert!(notes.contains("3 of 5 states tell no place"), "{notes}");
        assert_eq!(gap(&trace), Some((1, 8)));
        trace.steps[0].reward = f32::NAN;
        assert_eq!(EpisodeSummary::of(&trace).episode_return, None);
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
        let summary = EpisodeSummary::of(&trace);
        assert_eq!(
            (summary.walked, &*summary.path),
            (1.0, &[[0.0, 2.0], [1.0, 2.0]][..])
        );
        assert!(summary.falls == 0 && summary.notes.is_empty());
        trace.meta.simulator = "flea".to_owned();
        let summary = EpisodeSummary::of(&trace);
        assert!(summary.path.is_empty() && summary.notes[0].contains("no simulator 'flea'"));
    }
}
