//! Missing and unusable data in a trace.

use simulator::{Body, Dtype};
use trace::Trace;

/// No maze is larger (m).
pub(super) const FAR: f32 = 1e6;

/// Values of an observation that is floats.
pub(super) fn width(body: &dyn Body) -> usize {
    let space = body.spaces().observation;
    if space.dtype == Dtype::F32 {
        space.len()
    } else {
        0
    }
}

/// Sentences about missing and unusable data in a trace. Of `all` states, `read` have the width of the body's
/// observation, and `positions` of these have a position.
pub(super) fn notes(trace: &Trace, all: usize, read: usize, positions: usize) -> Vec<String> {
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
    if read < all {
        let other = all - read;
        let name = trace.meta.simulator();
        notes.push(match simulators::body(name) {
            Some(body) => format!(
                "{other} of {all} states do not have the {} values of the simulator '{name}', and \
                 are left out: another simulator's, or damaged",
                width(body)
            ),
            None => format!(
                "this version of formica has no simulator '{}', so that its {all} states are left \
                 out",
                name.escape_debug()
            ),
        });
    }
    if positions < read {
        let other = read - positions;
        notes.push(format!(
            "{other} of {read} states tell no place within {FAR} m, and are left out of the path"
        ));
    }
    notes
}

/// The first and the last missing step.
pub(super) fn gap(trace: &Trace) -> Option<(u32, u32)> {
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
