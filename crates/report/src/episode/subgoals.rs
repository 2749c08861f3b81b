//! The subgoals of an episode.

use plot::number::unsigned_zero;
use serde::Serialize;
use trace::Trace;

/// A subgoal that the high level chose, and its outcome.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(crate) struct Subgoal {
    /// Control step of the choice.
    pub(crate) step: u32,
    /// Node at that step.
    pub(crate) node: i32,
    /// The chosen node.
    pub(crate) subgoal_node: i32,
    /// Its probability; `None` if it is not an open neighbour.
    pub(crate) probability: Option<f32>,
    /// The critic's value; `None` without a critic.
    pub(crate) value: Option<f32>,
    /// Whether it was reached; `None` if the episode ended or the goal came near before.
    pub(crate) reached: Option<bool>,
    /// Control steps towards it.
    pub(crate) steps: u32,
}

/// Each choice with the outcome that came before the next one.
pub(super) fn subgoals(trace: &Trace) -> Vec<Subgoal> {
    let mut outcomes = trace.outcomes.iter().peekable();
    let steps = trace.steps.len() as u32;
    let mut subgoals = vec![];
    for (i, choice) in trace.choices.iter().enumerate() {
        let next = trace.choices.get(i + 1).map_or(u32::MAX, |next| next.step);
        // Outcomes before this choice belong to an unknown one.
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
